"""What is printed on a calibration target: numbers only."""

from __future__ import annotations

from typing import Literal, Self, TypeAlias

from pydantic import Field, model_validator

from mvp.fileedge import FileModel

TargetKind: TypeAlias = Literal["charuco", "chessboard", "circle-grid"]


class TargetPrint(FileModel):
    """The layout of a printed target.

    ``columns`` and ``rows``: inner corners of a chessboard, squares of a ChArUco board,
    discs of a circle grid. ``square_mm``: side of a square, or the distance of
    neighbouring discs. ``marker_mm``: side of a ChArUco marker. ``dictionary``: OpenCV's
    name without ``DICT_``. ``legacy``: a ChArUco board as OpenCV before 4.6 drew it,
    whose first square is white where the rows are even. ``disc_mm``: diameter of a disc;
    left out, half the distance. ``asymmetric``: every second row of discs is shifted, of
    an odd number of rows; ``square_mm`` is then the distance of two rows, and half that of
    two discs of a row.
    """

    kind: TargetKind
    columns: int = Field(ge=3, le=100)
    rows: int = Field(ge=3, le=100)
    square_mm: float = Field(gt=0)
    marker_mm: float | None = Field(default=None, gt=0)
    dictionary: str = "5X5_250"
    legacy: bool = False
    disc_mm: float | None = Field(default=None, gt=0)
    asymmetric: bool = False

    @model_validator(mode="after")
    def _drawable(self) -> Self:
        if self.kind == "charuco" and self.marker_mm is None:
            raise ValueError("a ChArUco board needs marker_mm")
        if self.marker_mm is not None and self.marker_mm >= self.square_mm:
            raise ValueError("marker_mm must be below square_mm")
        if self.disc_mm is not None and self.disc_mm >= self.nearest_mm:
            most = "1.4 square_mm" if self.asymmetric else "square_mm"
            raise ValueError(f"disc_mm must be below {most}")
        if self.legacy and self.kind != "charuco":
            raise ValueError("only a ChArUco board can be legacy")
        if self.asymmetric and self.kind != "circle-grid":
            raise ValueError("only a circle grid can be asymmetric")
        if self.asymmetric and self.rows % 2 == 0:
            raise ValueError(
                "an asymmetric grid needs an odd number of rows: with an even one it "
                "looks the same after half a turn"
            )
        return self

    @property
    def nearest_mm(self) -> float:
        """Distance of the nearest two discs; asymmetric: a little less."""
        return self.square_mm * (1.4 if self.asymmetric else 1.0)

    @property
    def diameter_mm(self) -> float:
        """Of a disc."""
        return self.square_mm / 2 if self.disc_mm is None else self.disc_mm


class MeasuredTarget(FileModel):
    """How large a print truly is, by caliper; kept beside the cell's calibrations.

    ``kind``, ``columns``, ``rows``, ``stated_mm``: of which print, as ``[target]`` says.
    ``readings_mm``: over ``squares`` squares each; ``square_mm`` follows from them, with
    one sigma.
    """

    schema_: Literal["mvp-cell/target-size/1"] = Field(
        default="mvp-cell/target-size/1", alias="schema"
    )
    date: str
    kind: TargetKind
    columns: int
    rows: int
    stated_mm: float
    readings_mm: list[float] = Field(min_length=1)
    squares: int = Field(ge=1)
    square_mm: float = Field(gt=0)
    square_sigma_mm: float = Field(gt=0)

    def is_of(self, target: TargetPrint) -> bool:
        """It was this print, as its cell file describes it."""
        mine = self.kind, self.columns, self.rows, self.stated_mm
        return mine == (target.kind, target.columns, target.rows, target.square_mm)
