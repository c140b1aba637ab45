"""Is a picture of a target good enough: sharp, well exposed, flat, inside the frame.

Each check gives the reason, with the figure and the limit. The limits are relative to
what is in the picture (contrast, distance of the points), so that they hold for any
camera and board.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from calibration.planar import homography
from calibration.targets.detect import Rejection

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calibration.targets.detect import Detection
    from mvp.geometry import FloatArray

_WHITE = 254
_SATURATED_SHARE = 0.2
_LEAST_CONTRAST = 25.0
_BLUR_SHARE = 0.35
_BLUR_PX = 8.0
_FLAT_SHARE = 0.35
_DUPLICATE_SHARE = 0.02


@dataclass(frozen=True)
class PictureFigures:
    """What was measured in one picture.

    Attributes:
        rise_px: width of an edge, from its contrast and steepest slope.
        contrast: bright less dark inside the target, grey levels of 255.
        saturated: part of the target's pixels at the end of the scale.
        homography_px: largest distance of a point from the best plane image.
        border_px: smallest distance of a point from the frame.
    """

    rise_px: float
    contrast: float
    saturated: float
    homography_px: float
    border_px: float


def measure_picture(grey: NDArray[np.uint8], found: Detection) -> PictureFigures:
    """All figures of one picture."""
    inside = _hull_pixels(grey, found.pixels)
    values = grey[inside].astype(np.float64)
    dark, bright = np.percentile(values, [5, 95])
    return PictureFigures(
        _rise_px(grey, found.pixels, float(bright - dark)),
        float(bright - dark),
        float((values >= _WHITE).mean()),
        float(_homography_errors(found).max()),
        _border_px(grey, found.pixels),
    )


def check_picture(figures: PictureFigures, found: Detection) -> Rejection | None:
    """The first thing that is wrong with a picture; None if nothing is."""
    spacing = float(np.median(found.spacing_px))
    blur = min(_BLUR_SHARE * spacing, _BLUR_PX)
    if figures.homography_px > _FLAT_SHARE * spacing:
        return Rejection(
            "not-a-plane",
            f"a point lies {figures.homography_px:.1f} px from where a flat target would "
            f"have it (limit {_FLAT_SHARE * spacing:.1f} px)",
            "check rows and columns of the target; a wrong point was taken for a corner",
        )
    if figures.saturated > _SATURATED_SHARE:
        return Rejection(
            "overexposed",
            f"{100 * figures.saturated:.0f} % of the target is at the end of the scale",
            "shorten the exposure until white is at about 80 % of the scale",
        )
    if figures.contrast < _LEAST_CONTRAST:
        return Rejection(
            "too-little-contrast",
            f"bright and dark differ by {figures.contrast:.0f} of 255 grey levels",
            "add light or lengthen the exposure",
        )
    if figures.rise_px > blur:
        return Rejection(
            "blurred",
            f"edges are {figures.rise_px:.1f} px wide (limit {blur:.1f} px)",
            "focus, stop down, or wait until camera and target stand still",
        )
    needed = float(found.half_window_px.max()) + 1
    if figures.border_px < needed:
        return Rejection(
            "too-close-to-the-border",
            f"a point lies {figures.border_px:.1f} px from the frame "
            f"({needed:.0f} px are needed)",
            "move the target a little inwards",
        )
    return None


def same_picture(one: Detection, other: Detection) -> bool:
    """The target did not move between two pictures, by 2 % of a square."""
    common, rows, others = np.intersect1d(one.ids, other.ids, return_indices=True)
    if common.size < min(len(one.ids), len(other.ids)) / 2:
        return False
    moved = np.linalg.norm(one.pixels[rows] - other.pixels[others], axis=1)
    return bool(
        np.sqrt((moved**2).mean()) < _DUPLICATE_SHARE * np.median(one.spacing_px)
    )


def _hull_pixels(grey: NDArray[np.uint8], pixels: FloatArray) -> NDArray[np.bool_]:
    mask = np.zeros(grey.shape, dtype=np.uint8)
    hull = cv2.convexHull(np.round(pixels).astype(np.int32))
    cv2.fillConvexPoly(mask, hull, 1)
    return np.asarray(mask, dtype=np.bool_)


def _rise_px(grey: NDArray[np.uint8], pixels: FloatArray, contrast: float) -> float:
    """Contrast divided by the steepest slopes near the points."""
    smooth = cv2.GaussianBlur(grey, (3, 3), 0).astype(np.float32)
    across = cv2.Scharr(smooth, cv2.CV_32F, 1, 0) / 32
    down = cv2.Scharr(smooth, cv2.CV_32F, 0, 1) / 32
    slope = np.hypot(across, down)[_hull_pixels(grey, pixels)]
    steepest = float(np.percentile(slope, 98))
    return contrast / max(steepest, 1e-6)


def _homography_errors(found: Detection) -> FloatArray:
    plane = np.column_stack([found.points_mm[:, :2], np.ones(len(found.ids))])
    try:
        matrix = homography(found.points_mm[:, :2], found.pixels)
    except ValueError:
        return np.array([np.inf])
    there = plane @ matrix.T
    return np.asarray(
        np.linalg.norm(there[:, :2] / there[:, 2:] - found.pixels, axis=1)
    )


def _border_px(grey: NDArray[np.uint8], pixels: FloatArray) -> float:
    far = np.array([grey.shape[1] - 1, grey.shape[0] - 1]) - pixels
    return float(min(pixels.min(), far.min()))
