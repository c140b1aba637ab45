"""The pupil stays inside the workspace: six walls, a bound of their own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints.base import SHIFT, Kind, Report, Rows, worst_of
from mvp.constraints.derivatives import empty_gradient
from mvp.geometry import Pose

if TYPE_CHECKING:
    from mvp.geometry import Box
    from mvp.optics import Views


@dataclass(frozen=True, eq=False)
class Workspace:
    """Rows in mm: distance from each wall of a box.

    Attributes:
        box: the workspace, in the target frame of ``box_from_part``.
        box_from_part: where the part lies in the frame of the box; the box is in the
            part frame if left out.
    """

    box: Box
    box_from_part: Pose = field(default_factory=lambda: Pose.identity("part", "part"))
    kind: Kind = field(default="workspace", init=False)
    unit: str = field(default="mm", init=False)
    labels: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        names = (f"{axis} {end}" for end in ("low", "high") for axis in "xyz")
        object.__setattr__(self, "labels", tuple(f"wall {name}" for name in names))

    def rows(self, views: Views, *, gradient: bool = True) -> Rows:
        """X - low, high - x, (N, 6) mm; no kink."""
        position = self.box_from_part.apply(views.position_mm)
        value = np.hstack([position - self.box.low_mm, self.box.high_mm - position])
        if not gradient:
            return Rows(value, None)
        slopes = empty_gradient(value.shape)
        rotation = self.box_from_part.rotation
        slopes[..., SHIFT] = np.vstack([rotation, -rotation])
        return Rows(value, slopes)

    def report(self, views: Views) -> Report:
        """Distance from the nearest wall, mm."""
        return worst_of("mm", self.rows(views, gradient=False).value, self.labels)
