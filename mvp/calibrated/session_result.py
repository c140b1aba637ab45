"""What a calibration session says beside the file that it puts in place: data only."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from mvp.fileedge import FileModel


class PointResiduals(FileModel):
    """What one view leaves unexplained, point by point: foretold less found.

    ``ids``: of corners as numbered on the target, or names of edges and holes of a part.
    Of an edge only the part square to it counts.
    """

    view: str
    ids: list[str]
    dx_px: list[float]
    dy_px: list[float]

    @model_validator(mode="after")
    def _even(self) -> Self:
        if not len(self.ids) == len(self.dx_px) == len(self.dy_px):
            raise ValueError("ids, dx_px and dy_px must be equally long")
        return self


class ResultDifference(FileModel):
    """One difference to the result before: new less previous, with one sigma of it."""

    name: str
    change: float
    sigma: float | None
    unit: str


class ResultComparison(FileModel):
    """A result beside the one that was in place when its session began.

    ``sigmas``: of all differences together; null where one of the two does not say how
    good it is. ``alarm``: more than three.
    """

    previous_date: str
    alarm: bool
    sigmas: float | None
    differences: list[ResultDifference] = Field(default_factory=list)
    remarks: list[str] = Field(default_factory=list)
    words: str
