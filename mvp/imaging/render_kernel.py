"""The lens' point spread function, as what it does to a straight border.

A point at distance h from a border sees the other side through the rays of its spread
that cross it. For a border piece that ends sideways at radius rho and angle phi from
the perpendicular, the light beyond is W = 1/(2 pi) int_0^phi E(h / cos t) dt, with E(r)
the share of the spread outside radius r. Sums of W over the border pieces are exact for
any polygon, corners and crossings included.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import j0, j1

from mvp.imaging.diffraction import THIRD_RING, airy_transfer

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray
    from mvp.imaging.light import Float32Array

_LEVEL_STEP = 0.03  # blur diameters are rounded: at most 1.5 % or 0.01 px off
_LEVEL_KNEE_PX = 0.7
_SMALLEST_BLUR_PX = 0.01
_RADIAL_STEPS = 96
_ANGULAR_STEPS = 48
_FINE_ANGLES = 129
_FINE_HEIGHTS = 97
_TAIL = 1e-6
_SUBPIXEL_ERROR = 0.003
_SHARPEST_PARTS = 8


@dataclass(frozen=True, eq=False)
class WedgeTables:
    """W for several blur diameters.

    Attributes:
        radius_px: (levels,) where each spread ends.
        values: (levels, radial + 1, angular + 1) over sqrt(rho / radius) and phi.
    """

    radius_px: Float32Array
    values: Float32Array

    def wedge(
        self, level: IntArray, height_px: Float32Array, along_px: Float32Array
    ) -> Float32Array:
        """W (n,) of end points along a border at height >= 0; odd in ``along``."""
        radius = self.radius_px[level]
        squared = height_px * height_px
        limit = np.sqrt(np.maximum(radius * radius - squared, 0))
        reach = np.minimum(np.abs(along_px), limit)
        rho = np.sqrt(squared + reach * reach) / radius
        phi = np.arctan2(reach, height_px) * np.float32(_ANGULAR_STEPS * 2 / np.pi)
        u = np.minimum(np.sqrt(rho) * _RADIAL_STEPS, _RADIAL_STEPS - 1e-4)
        v = np.minimum(phi, _ANGULAR_STEPS - 1e-4)
        return np.asarray(np.sign(along_px) * self._bilinear(level, u, v))

    def _bilinear(
        self, level: IntArray, u: Float32Array, v: Float32Array
    ) -> Float32Array:
        row, column = u.astype(np.int32), v.astype(np.int32)
        u, v = u - row, v - column
        width = _ANGULAR_STEPS + 1
        base = (level * (_RADIAL_STEPS + 1) + row) * width + column
        flat = self.values.reshape(-1)
        near = flat[base] + v * (flat[base + 1] - flat[base])
        far = flat[base + width] + v * (flat[base + width + 1] - flat[base + width])
        return np.asarray(near + u * (far - near))


def blur_levels(blur_px: FloatArray) -> tuple[FloatArray, IntArray]:
    """Distinct rounded blur diameters, and which of them each value takes."""
    steps = np.round(np.arcsinh(blur_px / _LEVEL_KNEE_PX) / _LEVEL_STEP)
    unique, level = np.unique(steps, return_inverse=True)
    blurs = np.sinh(unique * _LEVEL_STEP) * _LEVEL_KNEE_PX
    return np.maximum(blurs, _SMALLEST_BLUR_PX), level.reshape(-1)


def subpixels_needed(blur_px: float, airy_px: float) -> int:
    """Into how many parts to cut a pixel's side so that each counts as round.

    The square of a part is drawn as a Gaussian of the same variance; what that changes
    in the profile of an edge is bounded by the transfer functions.
    """
    nu = np.linspace(0.02, 8.0, 400)
    optical = np.abs(_disc_transfer(nu * blur_px)) * airy_transfer(nu * airy_px)
    for parts in (1, 2, 3, 4):
        square = np.sinc(nu / parts)
        gap = np.abs(square - np.exp(-((np.pi * nu / parts) ** 2) / 6))
        inner = np.abs(np.sinc(nu)) / np.maximum(np.abs(square), 0.05)
        error = np.sum(gap * np.minimum(inner, 1.0) * optical / (np.pi * nu)) * nu[0]
        if error < _SUBPIXEL_ERROR:
            return parts
    return _SHARPEST_PARTS


def spread_radius_px(blur_px: FloatArray, airy_px: float, parts: int) -> FloatArray:
    """Radius that holds a spread: disc, three Airy rings, 4 sigma of a pixel part."""
    sigma = 1 / (parts * np.sqrt(12))
    return np.asarray(blur_px / 2 + THIRD_RING * airy_px + 4 * sigma)


@lru_cache(maxsize=8)
def wedge_tables(
    blurs_px: tuple[float, ...], airy_px: float, parts: int
) -> WedgeTables:
    """Tables for blur diameters (px), lambda N_w (px, 0: none) and pixel parts."""
    blurs = np.array(blurs_px)
    radii = spread_radius_px(blurs, airy_px, parts)
    grid = np.linspace(0.0, radii.max(), 1 + int(np.ceil(radii.max() * 16 * parts)))
    outside = _energy_outside(blurs, airy_px, parts, grid)
    crossing, u, v = _wedge_grids()
    energy = np.empty((len(blurs), *crossing.shape))
    for k, radius in enumerate(radii):
        # The rings beyond the radius are laid thinly over it, so that none is lost.
        last = np.interp(radius, grid, outside[k])
        share = np.where(grid < radius, outside[k] - last * grid / radius, 0.0)
        energy[k] = np.interp(crossing * radius, grid, share, right=0.0)
    running = _running_integral(energy)
    values = _sampled(running, u, v).astype(np.float32)
    return WedgeTables(radii.astype(np.float32), values)


def _energy_outside(
    blurs: FloatArray, airy_px: float, parts: int, grid: FloatArray
) -> FloatArray:
    """E (levels, len(grid)): Hankel transform of the product of transfer functions.

    EE(r) = 2 pi r int T(nu) J1(2 pi r nu) d nu, integrated by parts in the form
    1 - EE(r) = -int T'(nu) J0(2 pi r nu) d nu - ... of a T that ends in zero.
    """
    sigma = 1 / (parts * np.sqrt(12))
    highest = np.sqrt(-np.log(_TAIL) / 2) / (np.pi * sigma)
    if airy_px > 0:
        highest = min(highest, 1 / airy_px)
    count = int(np.ceil(highest * (grid[-1] * 8 + 16))) + 1
    edges = np.linspace(0.0, highest, count)
    transfer = _disc_transfer(edges * blurs[:, None]) * airy_transfer(edges * airy_px)
    transfer *= np.exp(-2 * (np.pi * sigma * edges) ** 2)
    middle = (edges[1:] + edges[:-1]) / 2
    # EE(r) = -int T' (1 - J0(2 pi r nu)) d nu, so E(r) = -int T' J0(2 pi r nu) d nu.
    return np.asarray(
        -np.diff(transfer, axis=1) @ j0(2 * np.pi * np.outer(middle, grid))
    )


def _disc_transfer(argument: FloatArray) -> FloatArray:
    """2 J1(pi x) / (pi x) of a disc of diameter 1."""
    x = np.pi * np.maximum(np.abs(argument), 1e-9)
    return np.asarray(2 * j1(x) / x)


def _fine_angles() -> FloatArray:
    """Angles 0 .. pi/2, denser towards the border's direction."""
    turn = np.linspace(0.0, 1.0, _FINE_ANGLES)
    return np.asarray(np.pi / 2 * (1 - (1 - turn) ** 2))


@lru_cache(maxsize=1)
def _wedge_grids() -> tuple[FloatArray, FloatArray, FloatArray]:
    """In units of the spread's radius: where rays cross, and indices of the table."""
    heights = np.linspace(0.0, 1.0, _FINE_HEIGHTS)[:, None] ** 2
    crossing = heights / np.maximum(np.cos(_fine_angles()), 1e-12)
    rho = np.linspace(0.0, 1.0, _RADIAL_STEPS + 1)[:, None] ** 2
    phi = np.linspace(0.0, np.pi / 2, _ANGULAR_STEPS + 1)[None]
    u = np.sqrt((rho * np.cos(phi)).clip(0, 1)) * (_FINE_HEIGHTS - 1)
    v = (1 - np.sqrt(1 - phi * 2 / np.pi)) * (_FINE_ANGLES - 1) + 0 * rho
    return crossing, u, v


def _running_integral(energy: FloatArray) -> FloatArray:
    """Integral over the angle from 0, divided by 2 pi: (levels, heights, angles)."""
    slabs = (energy[..., 1:] + energy[..., :-1]) * (np.diff(_fine_angles()) / 2)
    running = np.zeros_like(energy)
    np.cumsum(slabs, axis=-1, out=running[..., 1:])
    return running / (2 * np.pi)


def _sampled(tables: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Bilinear lookup of every table at fractional indices."""
    row = np.minimum(u.astype(np.int64), tables.shape[1] - 2)
    column = np.minimum(v.astype(np.int64), tables.shape[2] - 2)
    u, v = u - row, v - column
    base = row * tables.shape[2] + column
    flat = tables.reshape(len(tables), -1)
    near = flat[:, base] * (1 - v) + flat[:, base + 1] * v
    base = base + tables.shape[2]
    far = flat[:, base] * (1 - v) + flat[:, base + 1] * v
    return np.asarray(near * (1 - u) + far * u)
