"""Discs of a circle grid: found as blobs, then their centres from all of their pixels.

The contour of a blob moves with the light and the blur across a disc, by about the same
over a part of the picture; a calibration takes that for the lens. The centre of what a
disc darkens does not: every pixel is divided by the white around its disc. Where that is not evenly
white the blob's own middle stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial import cKDTree

from calibration.planar import homography

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calibration.targets.layout import CircleGrid
    from mvp.geometry import FloatArray

# White of one disc alone, however blurred: parts of the gap between two discs; what is
# printed around the outermost discs has half a pitch of white.
_WHITE_FROM, _WHITE_TO, _MARGIN, _BLURRED_TO = 0.25, 0.6, 0.45, 0.5
_NARROWEST_GAP_PX = 4.0
_ROUNDS = 2
_FEWEST_WHITE = 12
# Farther off than this share of the step to black, white is something else: a shadow's
# edge, the table beside the print.
_EVEN_SHARE = 0.25
_FARTHEST_SHARE = 0.25


def find_discs(grey: NDArray[np.uint8], target: CircleGrid) -> FloatArray | None:
    """Middles (n, 2) of all discs of a grid, px, row by row; None: not found."""
    kind = (
        cv2.CALIB_CB_ASYMMETRIC_GRID
        if target.asymmetric
        else cv2.CALIB_CB_SYMMETRIC_GRID
    )
    size = (target.columns, target.rows)
    found, centres = cv2.findCirclesGrid(grey, size, flags=kind)
    if not found:
        return None
    return refined_middles(grey, target, np.asarray(centres, np.float64).reshape(-1, 2))


def refined_middles(
    grey: NDArray[np.uint8], target: CircleGrid, pixels: FloatArray
) -> FloatArray:
    """The middles (n, 2) of what the discs darken, from middles (n, 2) of blobs.

    A disc stays as it is when it is too close to the border of the picture or to its
    neighbours, or when what lies around it is not evenly white.
    """
    points = target.points_mm
    rings = _Rings.of(target)
    for _ in range(_ROUNDS):
        slopes = _slopes(homography(points[:, :2], pixels), points)
        discs = zip(pixels, slopes, strict=True)
        pixels = np.array([_middle(grey, rings, *disc) for disc in discs])
    return pixels


def disc_centres(
    target: CircleGrid, points: FloatArray, pixels: FloatArray
) -> FloatArray:
    """From the middle of the ellipse to the image of the disc's centre.

    A tilted disc is an ellipse whose middle is not the image of the centre. The
    difference follows from the plane's homography H: the conic of a disc becomes
    H^-T C H^-1, and the middle of an ellipse is the pole of the line at infinity.
    """
    matrix = homography(points[:, :2], pixels)
    radius = target.diameter_mm / 2
    x, y = points[:, 0], points[:, 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    dual = np.stack(
        [
            np.stack([x * x - radius**2, x * y, x], axis=-1),
            np.stack([x * y, y * y - radius**2, y], axis=-1),
            np.stack([x, y, one], axis=-1),
        ],
        axis=-2,
    )
    pole = matrix @ dual @ matrix.T @ np.array([0, 0, 1.0])
    centre = np.stack([x, y, one + zero], axis=-1) @ matrix.T
    bias = pole[:, :2] / pole[:, 2:] - centre[:, :2] / centre[:, 2:]
    return np.asarray(pixels - bias)


def _slopes(matrix: FloatArray, points: FloatArray) -> FloatArray:
    """(n, 2, 2) px per mm of the target at its points."""
    images = np.column_stack([points[:, :2], np.ones(len(points))]) @ matrix.T
    places = images[:, :2] / images[:, 2:]
    return np.asarray(
        (matrix[:2, :2] - places[:, :, None] * matrix[2, :2]) / images[:, 2, None, None]
    )


@dataclass(frozen=True)
class _Rings:
    """Radii on the target, mm: of a disc, and between which it is white around it.

    ``gap``: between two discs.
    """

    disc: float
    inner: float
    outer: float
    gap: float

    @classmethod
    def of(cls, target: CircleGrid) -> _Rings:
        radius = target.diameter_mm / 2
        points = target.points_mm
        gap = float(cKDTree(points).query(points[0], k=2)[0][1]) - 2 * radius
        inner = radius + min(_WHITE_FROM * gap, _BLURRED_TO * radius)
        outer = radius + min(_WHITE_TO * gap, _MARGIN * target.pitch.mm)
        return cls(radius, inner, outer, gap)


def _middle(
    grey: NDArray[np.uint8], rings: _Rings, pixel: FloatArray, slope: FloatArray
) -> FloatArray:
    """Of one disc, (2,)."""
    smallest = float(np.linalg.svd(slope)[1][1])
    reach = np.linalg.norm(slope, axis=1)
    whole = (rings.inner * reach + 1 < _room(grey, pixel)).all()
    if not whole or rings.gap * smallest < _NARROWEST_GAP_PX:
        return pixel
    low = np.maximum(np.floor(pixel - rings.outer * reach), 0).astype(int)
    high = np.ceil(pixel + rings.outer * reach).astype(int) + 1
    high = np.minimum(high, grey.shape[::-1])
    patch = grey[low[1] : high[1], low[0] : high[0]].astype(np.float64)
    y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
    off = np.stack([x - pixel[0], y - pixel[1]], axis=-1)
    away = np.linalg.norm(off @ np.linalg.inv(slope).T, axis=-1)
    white = (away > rings.inner) & (away < rings.outer)
    black = away < rings.disc / 2
    if white.sum() < _FEWEST_WHITE or not black.any():
        return pixel
    plane = np.concatenate([np.ones((*off.shape[:2], 1)), off], axis=-1)
    level = plane @ np.linalg.lstsq(plane[white], patch[white], rcond=None)[0]
    step = float((level - patch)[black].mean())
    if np.abs(patch - level)[white].max() > _EVEN_SHARE * step:
        return pixel
    darkened = np.where(away < rings.inner, 1 - patch / np.maximum(level, 1.0), 0.0)
    move = np.einsum("ij,ijk->k", darkened, off) / darkened.sum()
    far = np.linalg.norm(move) > _FARTHEST_SHARE * rings.disc * smallest
    return pixel if far else np.asarray(pixel + move)


def _room(grey: NDArray[np.uint8], pixel: FloatArray) -> FloatArray:
    """Distance (2,) of a place to the nearest border, px."""
    size = np.array(grey.shape[::-1]) - 1
    return np.asarray(np.minimum(pixel, size - pixel))
