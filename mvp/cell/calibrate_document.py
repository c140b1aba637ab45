"""What ``mvp-cell calibrate`` says about a session: for programs, and for its folder."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, JsonValue

from mvp.calibrated import PointResiduals, Quality, ResultComparison
from mvp.fileedge import FileModel

CALIBRATE_SCHEMA: Literal["mvp-cell/calibrate/1"] = "mvp-cell/calibrate/1"


class CalibrateDocument(FileModel):
    """``calibrate --json``, and ``result.json`` of a session.

    ``document``: the calibration file, as it is or would be put in place. ``placed``:
    where it was put; null when nothing was. ``kept``: where the calibration that it
    replaced is kept. ``same_numbers``: of a session that was computed again: whether the
    result is the one that its ``result.json`` has; null when there is none. ``points``:
    residuals of every point of every view. ``comparison``: with the result that was in
    place when the session began; null without a result.
    """

    schema_: Literal["mvp-cell/calibrate/1"] = Field(
        default=CALIBRATE_SCHEMA, alias="schema"
    )
    key: str
    cell: str
    simulated: bool
    session: str
    verdict: Literal["go", "marginal", "no-go"]
    samples: int
    input_sha256: str
    lines: list[str]
    quality: Quality
    document: JsonValue = None
    comparison: ResultComparison | None = None
    points: list[PointResiduals] = Field(default_factory=list)
    placed: str | None = None
    kept: str | None = None
    report: str | None = None
    same_numbers: bool | None = None
