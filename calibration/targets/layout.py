"""What is printed: chessboard, ChArUco board, circle grid, with the measured size.

Target frame: x to the right, y down, z into the board, as seen by somebody who looks at
the print; the z axis then points away from the camera. Lengths in mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.calibrated import TargetPrint
    from mvp.geometry import FloatArray

_PRINT_SIGMA = 0.002


@dataclass(frozen=True)
class MeasuredLength:
    """A length with one standard deviation.

    Attributes:
        mm: the length.
        sigma_mm: of it.
    """

    mm: float
    sigma_mm: float

    def __post_init__(self) -> None:
        if not (self.mm > 0 and self.sigma_mm >= 0):
            raise ValueError("a length is positive, its deviation not negative")
        if not np.isfinite([self.mm, self.sigma_mm]).all():
            raise ValueError("a length and its deviation are finite")

    @property
    def relative(self) -> float:
        """Sigma / length: all lengths found with the target share this error."""
        return self.sigma_mm / self.mm


def nominal(mm: float) -> MeasuredLength:
    """A size as it should have been printed: office printers are off by about 0.2 %."""
    return MeasuredLength(mm, _PRINT_SIGMA * mm)


def caliper(
    readings_mm: Sequence[float], *, across: int, accuracy_mm: float = 0.02
) -> MeasuredLength:
    """The size of one square from readings over several.

    Args:
        readings_mm: distances over ``across`` squares, at several places.
        across: squares (or circle spacings) between the jaws.
        accuracy_mm: one standard deviation that all readings share.

    Raises:
        ValueError: no reading, or readings that differ by more than 2 %.
    """
    readings = np.asarray(readings_mm, dtype=np.float64)
    if readings.size == 0 or across < 1:
        raise ValueError("at least one reading over at least one square is needed")
    mean = float(readings.mean())
    if np.ptp(readings) > 0.02 * mean:
        raise ValueError(
            f"the readings {readings.min():.2f} to {readings.max():.2f} mm differ by "
            "more than 2 %: were they all taken over the same number of squares?"
        )
    scatter = float(readings.std(ddof=1)) if readings.size > 1 else 0.0
    sigma = float(np.hypot(accuracy_mm, scatter / np.sqrt(readings.size)))
    return MeasuredLength(mean / across, sigma / across)


@dataclass(frozen=True)
class Chessboard:
    """Inner corners, where two black and two white squares meet.

    One of the numbers should be odd and the other even: otherwise the board looks the
    same after half a turn.

    Attributes:
        columns: inner corners along x.
        rows: inner corners along y.
        square: side of a square.
    """

    columns: int
    rows: int
    square: MeasuredLength

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise ValueError("a chessboard has at least 3 x 3 inner corners")

    @property
    def spacing(self) -> MeasuredLength:
        """Distance of neighbours."""
        return self.square

    @property
    def points_mm(self) -> FloatArray:
        """(rows * columns, 3), row by row, the first corner at the origin."""
        return _grid(self.columns, self.rows, self.square.mm)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the print."""
        side = self.square.mm
        return (self.columns + 1) * side, (self.rows + 1) * side


@dataclass(frozen=True)
class Charuco:
    """A chessboard whose white squares carry markers: seen in part it still serves.

    Attributes:
        columns: squares along x.
        rows: squares along y.
        square: side of a square.
        marker_mm: side of a marker.
        dictionary: OpenCV's name without ``DICT_``, such as ``6X6_250``.
        legacy: the layout of OpenCV before 4.6 (first square white for even rows).
    """

    columns: int
    rows: int
    square: MeasuredLength
    marker_mm: float
    dictionary: str = "5X5_250"
    legacy: bool = False

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise ValueError("a ChArUco board has at least 3 x 3 squares")
        if not 0 < self.marker_mm < self.square.mm:
            raise ValueError("a marker is smaller than its square")

    @property
    def markers(self) -> int:
        """How many there are, one to a white square."""
        return self.columns * self.rows // 2

    @property
    def spacing(self) -> MeasuredLength:
        """Distance of neighbours."""
        return self.square

    @property
    def points_mm(self) -> FloatArray:
        """(corners, 3) in the order of their ids; the board's corner at the origin."""
        side = self.square.mm
        first = np.array([side, side, 0.0])
        return np.asarray(_grid(self.columns - 1, self.rows - 1, side) + first)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the print."""
        return self.columns * self.square.mm, self.rows * self.square.mm


@dataclass(frozen=True)
class CircleGrid:
    """Black discs on white, in rows, or with every second row shifted by half.

    Attributes:
        columns: discs of one row.
        rows: rows.
        pitch: symmetric: distance of neighbours; asymmetric: half the distance of two
            discs of a row, which is also the distance of two rows.
        diameter_mm: of a disc.
        asymmetric: every second row is shifted by the pitch.
    """

    columns: int
    rows: int
    pitch: MeasuredLength
    diameter_mm: float
    asymmetric: bool = False

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise ValueError("a circle grid has at least 3 x 3 discs")
        if not 0 < self.diameter_mm < self.pitch.mm * (1.4 if self.asymmetric else 1):
            raise ValueError("the discs overlap")

    @property
    def spacing(self) -> MeasuredLength:
        """Distance of neighbours (asymmetric: of two rows)."""
        return self.pitch

    @property
    def points_mm(self) -> FloatArray:
        """(rows * columns, 3), row by row, the first disc at the origin."""
        if not self.asymmetric:
            return _grid(self.columns, self.rows, self.pitch.mm)
        row, column = np.divmod(np.arange(self.rows * self.columns), self.columns)
        points = np.stack([2 * column + row % 2, row, np.zeros_like(row)], axis=1)
        return np.asarray(points * self.pitch.mm, dtype=np.float64)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the print, with half a pitch of white around."""
        reach = np.ptp(self.points_mm, axis=0) + self.diameter_mm + self.pitch.mm
        return float(reach[0]), float(reach[1])


Target: TypeAlias = Chessboard | Charuco | CircleGrid


def target_of_print(printed: TargetPrint, square_sigma_mm: float) -> Target:
    """The target that a cell file describes.

    Args:
        printed: its layout.
        square_sigma_mm: one standard deviation of its squares' side (or pitch).
    """
    side = MeasuredLength(printed.square_mm, square_sigma_mm)
    size = printed.columns, printed.rows
    if printed.kind == "chessboard":
        return Chessboard(*size, side)
    if printed.kind == "circle-grid":
        return CircleGrid(*size, side, printed.diameter_mm, printed.asymmetric)
    marker = printed.marker_mm or 0.7 * printed.square_mm
    return Charuco(*size, side, marker, printed.dictionary, printed.legacy)


def _grid(columns: int, rows: int, spacing_mm: float) -> FloatArray:
    row, column = np.divmod(np.arange(rows * columns), columns)
    points = np.stack([column, row, np.zeros_like(row)], axis=1)
    return np.asarray(points * spacing_mm, dtype=np.float64)
