"""Chief-ray directions of all pixels, distortion included.

Distortion is a property of the rays: the undistorted normalised coordinates of each
pixel are computed once per intrinsics and principal distance and kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import RectBivariateSpline

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.imaging.light import Float32Array
    from mvp.optics import Intrinsics

_KNOT_STEP_PX = 16


@dataclass(frozen=True, eq=False)
class PixelRays:
    """Chief rays (x, y, 1) of a pixel raster and how they change across a pixel.

    Attributes:
        directions: (rows, columns, 3) float32.
        along_x: (rows, columns, 2) change of (x, y) per pixel to the right.
        along_y: (rows, columns, 2) change of (x, y) per pixel downwards.
    """

    directions: Float32Array
    along_x: Float32Array
    along_y: Float32Array


@lru_cache(maxsize=4)
def pixel_rays(intrinsics: Intrinsics, f_cal_mm: float) -> PixelRays:
    """The rays of a whole sensor; a cubic spline between exact knots."""
    columns = np.arange(intrinsics.sensor.width_px, dtype=np.float64)
    rows = np.arange(intrinsics.sensor.height_px, dtype=np.float64)
    knots_x, knots_y = _knots(len(columns)), _knots(len(rows))
    grid = np.stack(np.meshgrid(knots_x, knots_y), axis=-1)
    exact = intrinsics.to_normalised(grid, f_cal_mm)
    fields = [_fields(knots_x, knots_y, exact[..., k], columns, rows) for k in (0, 1)]
    value, along_x, along_y = (
        np.stack(pair, axis=-1).astype(np.float32) for pair in zip(*fields, strict=True)
    )
    directions = np.concatenate([value, np.ones_like(value[..., :1])], axis=-1)
    return PixelRays(directions, along_x, along_y)


def _knots(count: int) -> FloatArray:
    pieces = max(4, -(-(count - 1) // _KNOT_STEP_PX))
    return np.linspace(0.0, count - 1.0, pieces + 1)


def _fields(
    knots_x: FloatArray,
    knots_y: FloatArray,
    values: FloatArray,
    columns: FloatArray,
    rows: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Value and both derivatives on the pixel raster."""
    spline = RectBivariateSpline(knots_y, knots_x, values, s=0)
    return (
        spline(rows, columns),
        spline(rows, columns, dy=1),
        spline(rows, columns, dx=1),
    )
