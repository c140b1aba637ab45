"""The files of a session as data: ``session.json`` and the lines of ``samples.jsonl``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field, JsonValue

from mvp.fileedge import FileModel
from mvp.geometry import Pose
from mvp.wizard.facts import SessionFacts

if TYPE_CHECKING:
    from mvp.geometry import FloatArray

SAMPLE_SCHEMA: Literal["mvp-cell/calibration-sample/1"] = (
    "mvp-cell/calibration-sample/1"
)


class SessionFile(FileModel):
    """``session.json``: the cell as it was, and answers that the result depends on."""

    facts: SessionFacts
    remembered: dict[str, JsonValue] = Field(default_factory=dict)


class Sample(FileModel):
    """One picture and everything known about it.

    ``role``: what it is for, such as ``calibration`` or ``verification``. ``ids``,
    ``points_mm``, ``pixels``: what was found in it, (m,), (m, 3), (m, 2). ``extra``: what
    only this wizard understands. ``base_from_tool``: as the arm told.
    """

    schema_: Literal["mvp-cell/calibration-sample/1"] = Field(
        default=SAMPLE_SCHEMA, alias="schema"
    )
    number: int = Field(ge=1)
    name: str
    role: str = "calibration"
    image: str
    sha256: str
    usable: bool
    reason: str = ""
    action: str = ""
    ids: list[int] = Field(default_factory=list)
    points_mm: list[tuple[float, float, float]] = Field(default_factory=list)
    pixels: list[tuple[float, float]] = Field(default_factory=list)
    joints: list[float]
    base_from_tool: list[list[float]]
    lens_steps: dict[str, int]
    full_scale: int
    exposure_s: float
    gain: float
    times_s: dict[str, float]
    settled: bool
    extra: dict[str, JsonValue] = Field(default_factory=dict)

    @property
    def pose(self) -> Pose:
        """``base_from_tool``."""
        return Pose.from_matrix("base", "tool", np.asarray(self.base_from_tool))

    @property
    def found_points_mm(self) -> FloatArray:
        """(m, 3), target frame."""
        return np.asarray(self.points_mm, dtype=np.float64).reshape(-1, 3)

    @property
    def found_pixels(self) -> FloatArray:
        """(m, 2)."""
        return np.asarray(self.pixels, dtype=np.float64).reshape(-1, 2)
