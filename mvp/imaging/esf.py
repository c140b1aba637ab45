"""Edge spread functions: what a sharp step looks like behind lens and pixel.

Built in the Fourier domain: blur disc x pixel aperture x diffraction of a circular
pupil. Lengths are in row pitches of the ideal (undistorted) picture. The blur enters
as q = b^2 (b the diameter of the blur circle): every transfer function is analytic in
q, so estimates near b = 0 stay unbiased and q may come out slightly negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import j1

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray
from mvp.imaging.diffraction import airy_transfer

STEP_PX = 1 / 16
HALF_SPAN_PX = 40.0
BLUR_STEP_PX = 0.125
BLUR_MAX_PX = 28.0
_ANGLE_BINS = 46


@dataclass(frozen=True)
class Optics:
    """What the spread depends on besides the blur.

    Attributes:
        pixel_x_px: pixel width over row pitch.
        diffraction_px: lambda N_w over row pitch, N_w = d / a; 0 switches it off.
    """

    pixel_x_px: float
    diffraction_px: float


@dataclass(frozen=True)
class SpreadValues:
    """The spread function at n samples and its derivatives, each (n,).

    ``edge`` runs from 0 to 1 across the step, ``by_t`` is d/dt in 1/px, ``by_q`` is
    d/d(b^2) in 1/px^2.
    """

    edge: FloatArray
    by_t: FloatArray
    by_q: FloatArray


def angle_bin(normals: FloatArray) -> IntArray:
    """Table index of edge normals (..., 2): orientation folded to the first quadrant."""
    angle = np.arctan2(np.abs(normals[..., 1]), np.abs(normals[..., 0]))
    return np.asarray(np.rint(angle / (np.pi / 2) * (_ANGLE_BINS - 1)), np.int64)


def spread_at(
    optics: Optics, t_px: FloatArray, q_px2: float, bins: IntArray
) -> SpreadValues:
    """Evaluate at signed distances t (n,) from the edge, one blur, bins (n,)."""
    if len(bins) and (bins == bins[0]).all():
        return SpreadValues(*_one_angle(optics, t_px, q_px2, int(bins[0])))
    out = np.empty((3, len(t_px)))
    for index in np.unique(bins):
        chosen = bins == index
        out[:, chosen] = _one_angle(optics, t_px[chosen], q_px2, int(index))
    return SpreadValues(out[0], out[1], out[2])


def _one_angle(
    optics: Optics, t_px: FloatArray, q_px2: float, index: int
) -> FloatArray:
    edge, line = _tables(optics, index)
    blur = np.sqrt(max(q_px2, 0.0))
    node = min(int(blur / BLUR_STEP_PX), len(edge) - 2)
    low, high = (node * BLUR_STEP_PX) ** 2, ((node + 1) * BLUR_STEP_PX) ** 2
    weight = (q_px2 - low) / (high - low)
    place = np.clip((t_px + HALF_SPAN_PX) / STEP_PX, 0, edge.shape[1] - 1.001)
    left = place.astype(np.int64)
    part = place - left
    change = edge[node + 1] - edge[node]
    rows = (
        edge[node] + weight * change,
        line[node] + weight * (line[node + 1] - line[node]),
        change / (high - low),
    )
    return np.stack([row[left] + part * (row[left + 1] - row[left]) for row in rows])


@lru_cache(maxsize=64)
def _tables(optics: Optics, index: int) -> tuple[FloatArray, FloatArray]:
    """Edge and line spread (blur nodes, t nodes) for one orientation."""
    count = round(2 * HALF_SPAN_PX / STEP_PX)
    frequency = np.asarray(np.fft.rfftfreq(count, STEP_PX), np.float64)
    angle = index / (_ANGLE_BINS - 1) * np.pi / 2
    fixed = (
        np.sinc(frequency * optics.pixel_x_px * np.cos(angle))
        * np.sinc(frequency * np.sin(angle))
        * airy_transfer(frequency * optics.diffraction_px)
    )
    line = np.fft.irfft(_disc_transfer() * fixed, n=count, axis=1) / STEP_PX
    line = np.fft.fftshift(line, axes=1)
    # Trapezoid sum: exact to the table's own bandwidth, 0.5 at the step itself.
    edge = (np.cumsum(line, axis=1) - line / 2) * STEP_PX
    edge = edge - edge[:, [count // 2]] + 0.5
    edge.setflags(write=False)
    line.setflags(write=False)
    return edge, line


@lru_cache(maxsize=1)
def _disc_transfer() -> FloatArray:
    """2 J1(pi b nu) / (pi b nu) for all blur nodes (rows) and frequencies."""
    count = round(2 * HALF_SPAN_PX / STEP_PX)
    frequency = np.fft.rfftfreq(count, STEP_PX)
    blur = np.arange(round(BLUR_MAX_PX / BLUR_STEP_PX) + 1) * BLUR_STEP_PX
    x = np.pi * blur[:, None] * frequency[None]
    safe = np.where(x > 1e-6, x, 1.0)
    return np.asarray(np.where(x > 1e-6, 2 * j1(safe) / safe, 1.0))
