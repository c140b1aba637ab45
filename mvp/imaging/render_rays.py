"""Chief-ray directions of all pixels, distortion included.

Distortion is a property of the rays: the undistorted normalised coordinates of each
pixel are computed once per intrinsics and principal distance and kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray
    from mvp.imaging.light import Float32Array
    from mvp.optics import Intrinsics

_KNOT_STEP_PX = 16


@dataclass(frozen=True, eq=False)
class PixelRays:
    """Chief rays (x, y, 1) of a pixel raster, z = 1.

    A cubic spline through exact values at knots about 16 pixels apart.

    Attributes:
        knots: (ky, kx, 2) exact normalised coordinates.
        knots_x_px: (kx,) columns of the knots.
        knots_y_px: (ky,) rows of the knots.
    """

    knots: FloatArray
    knots_x_px: FloatArray
    knots_y_px: FloatArray

    @cached_property
    def directions(self) -> Float32Array:
        """(rows, columns, 3) float32, z = 1."""
        across, down = _spline_matrix(self.knots_x_px), _spline_matrix(self.knots_y_px)
        fields = [down @ self.knots[..., k] @ across.T for k in (0, 1)]
        value = np.stack(fields, axis=-1).astype(np.float32)
        directions = np.ones((*value.shape[:2], 3), dtype=np.float32)
        directions[..., :2] = value
        return directions

    def within(self, pixels: IntArray, shift_px: FloatArray) -> Float32Array:
        """Rays (n, 3) at places (n, 2) off the centres of pixels (flat index)."""
        rows, columns = self.directions.shape[:2]
        shift = np.asarray(shift_px, dtype=np.float32)
        row, column = pixels // columns, pixels % columns
        rays = self.directions[row, column]
        left, right = np.maximum(column - 1, 0), np.minimum(column + 1, columns - 1)
        above, below = np.maximum(row - 1, 0), np.minimum(row + 1, rows - 1)
        across = self.directions[row, right] - self.directions[row, left]
        down = self.directions[below, column] - self.directions[above, column]
        rays += across * (shift[:, 0] / (right - left).astype(np.float32))[:, None]
        rays += down * (shift[:, 1] / (below - above).astype(np.float32))[:, None]
        return np.asarray(rays)


@lru_cache(maxsize=4)
def pixel_rays(intrinsics: Intrinsics, f_cal_mm: float) -> PixelRays:
    """The rays of a whole sensor."""
    knots_x = _knots(intrinsics.sensor.width_px)
    knots_y = _knots(intrinsics.sensor.height_px)
    grid = np.stack(np.meshgrid(knots_x, knots_y), axis=-1)
    return PixelRays(intrinsics.to_normalised(grid, f_cal_mm), knots_x, knots_y)


def _knots(count: int) -> FloatArray:
    pieces = max(4, -(-(count - 1) // _KNOT_STEP_PX))
    return np.linspace(0.0, count - 1.0, pieces + 1)


def _spline_matrix(knots: FloatArray) -> FloatArray:
    """(pixels, knots): values at knots to the spline's values at pixels."""
    places = np.arange(round(knots[-1]) + 1, dtype=np.float64)
    return np.asarray(CubicSpline(knots, np.eye(len(knots)))(places))
