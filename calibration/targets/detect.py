"""Find a target in a picture and say why not.

Corners are refined in a window that never reaches the next corner: its half-width is a
fixed part of the distance to the nearest neighbour, corner by corner (a window that is
too wide for a tilted or distant board spoils corners by more than a pixel).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial import cKDTree

from calibration.planar import homography
from calibration.targets.discs import disc_centres, find_discs
from calibration.targets.layout import Charuco, Chessboard, CircleGrid
from calibration.targets.not_found import why_no_board
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from calibration.targets.layout import Target
    from mvp.geometry import FloatArray, IntArray

_WINDOW_SHARE = 0.3
_WINDOW_PX = (2, 15)
_REFINE = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
_LEAST_POINTS = 6


@dataclass(frozen=True, eq=False)
class Detection:
    """The points found.

    Attributes:
        ids: (m,), rows of the target's ``points_mm``.
        points_mm: (m, 3) in the target frame.
        pixels: (m, 2).
        spacing_px: (m,), distance to where the nearest neighbour lies, found or not.
        half_window_px: (m,), of the refinement; 0 for discs.
    """

    ids: IntArray
    points_mm: FloatArray
    pixels: FloatArray
    spacing_px: FloatArray
    half_window_px: IntArray


@dataclass(frozen=True)
class Rejection:
    """Why a picture is not used.

    Attributes:
        code: stable name for programs.
        reason: what was found.
        action: what to do.
    """

    code: str
    reason: str
    action: str


def detect(grey: NDArray[np.uint8], target: Target) -> Detection | Rejection:
    """Find the points of a target.

    Args:
        grey: (rows, columns), one channel of 8 bits.
        target: what is in the picture.

    Raises:
        ValueError: not a grey picture of 8 bits.
    """
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise ValueError("a grey picture of 8 bits is needed")
    if isinstance(target, CircleGrid):
        middles = find_discs(grey, target)
        found = None if middles is None else (np.arange(len(middles)), middles)
    elif isinstance(target, Charuco):
        found = _charuco(grey, target)
    else:
        found = _chessboard(grey, target)
    if found is None:
        return _not_found(grey, target)
    ids, pixels = found
    points = target.points_mm[ids]
    try:
        spacing = _spacing(target, ids, pixels)
    except ValueError:
        return Rejection(
            "points-on-a-line",
            f"the {len(ids)} points of the target that were found lie on a line",
            "show more of it; find out what hides the rest",
        )
    if isinstance(target, CircleGrid):
        centres = disc_centres(target, points, pixels)
        return Detection(ids, points, centres, spacing, np.zeros(len(ids), np.int64))
    half = half_windows(spacing, _free_share(target))
    return Detection(ids, points, _refined(grey, pixels, half), spacing, half)


def _not_found(grey: NDArray[np.uint8], target: Target) -> Rejection:
    reason, action = "", ""
    if isinstance(target, Charuco):
        reason, action = why_no_board(grey, target)
    return Rejection(
        "target-not-found",
        "the target was not found" + (f": {reason}" if reason else ""),
        action
        or "show all of it, evenly lit and sharp; check that rows, columns and "
        "kind are those of the print",
    )


def half_windows(spacing_px: FloatArray, share: float = _WINDOW_SHARE) -> IntArray:
    """Half-width of the refinement window for each corner, px."""
    return np.clip(share * spacing_px, *_WINDOW_PX).astype(np.int64)


def _free_share(target: Chessboard | Charuco) -> float:
    """Part of a square around a corner that shows nothing but the corner."""
    if isinstance(target, Chessboard):
        return _WINDOW_SHARE
    margin = (1 - target.marker_mm / target.square.mm) / 2
    return min(_WINDOW_SHARE, margin)


def _chessboard(
    grey: NDArray[np.uint8], target: Chessboard
) -> tuple[IntArray, FloatArray] | None:
    size = (target.columns, target.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(grey, size, flags=flags)
    if not found:
        found, corners = cv2.findChessboardCornersSB(grey, size)
    if not found:
        return None
    return np.arange(target.columns * target.rows), _flat(corners)


def charuco_board(target: Charuco) -> cv2.aruco.CharucoBoard:
    """OpenCV's board.

    Raises:
        CalibrationError: a dictionary that OpenCV does not know, or with too few markers.
    """
    number = getattr(cv2.aruco, f"DICT_{target.dictionary}", None)
    if not isinstance(number, int):
        raise CalibrationError(
            f"OpenCV has no marker dictionary {target.dictionary!r}",
            hint="OpenCV's names without DICT_, such as 5X5_250",
        )
    dictionary = cv2.aruco.getPredefinedDictionary(number)
    needed, there = target.markers, len(dictionary.bytesList)
    if needed > there:
        raise CalibrationError(
            f"{target.dictionary} has {there} markers, the board needs {needed}",
            hint="choose a larger dictionary, or fewer squares",
        )
    board = cv2.aruco.CharucoBoard(
        (target.columns, target.rows),
        target.square.mm,
        target.marker_mm,
        dictionary,
    )
    board.setLegacyPattern(target.legacy)
    return board


def _charuco(
    grey: NDArray[np.uint8], target: Charuco
) -> tuple[IntArray, FloatArray] | None:
    detector = cv2.aruco.CharucoDetector(charuco_board(target))
    corners, ids, _, _ = detector.detectBoard(grey)
    if ids is None or len(ids) < _LEAST_POINTS:
        return None
    return np.asarray(ids, dtype=np.int64).ravel(), _flat(corners)


def _spacing(target: Target, ids: IntArray, pixels: FloatArray) -> FloatArray:
    """(m,) px to the nearest neighbour on the target; it may be hidden or too dark."""
    points = np.column_stack([target.points_mm[:, :2], np.ones(len(target.points_mm))])
    images = points @ homography(points[ids, :2], pixels).T
    places = images[:, :2] / images[:, 2:]
    return np.asarray(cKDTree(places).query(places[ids], k=2)[0][:, 1])


def _refined(grey: NDArray[np.uint8], pixels: FloatArray, half: IntArray) -> FloatArray:
    refined = pixels.astype(np.float32)
    for size in np.unique(half):
        rows = half == size
        window = (int(size), int(size))
        corners = np.array(refined[rows], order="C").reshape(-1, 1, 2)
        refined[rows] = cv2.cornerSubPix(
            grey, corners, window, (-1, -1), _REFINE
        ).reshape(-1, 2)
    return refined.astype(np.float64)


def _flat(corners: ArrayLike) -> FloatArray:
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2)
