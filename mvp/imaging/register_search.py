"""Coarse registration: gradient directions against predicted lines, by FFT.

Both are expanded in even harmonics of the direction (0, 2, 4 times the angle), so that
the correlation weighs the angle between gradient and predicted normal with cos^4.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from mvp.imaging.register import Alignment

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.imaging.edge_samples import Picture
    from mvp.imaging.expectation import DrawnEdges

_TARGET_CELLS = 160
_ROLLS_RAD = np.deg2rad(np.arange(-4.0, 4.1, 1.0))
_SCALES = 1.0 + np.arange(-0.16, 0.161, 0.04)
_SHIFT_SHARE = 0.18
_COS4 = (3 / 8, 1 / 2, 1 / 8)
Complex = NDArray[np.complex64]


@dataclass(frozen=True)
class CoarseMatch:
    """Best place found, its score and the score of the prediction as it is."""

    alignment: Alignment
    score: float
    score_unmoved: float


@dataclass(frozen=True, eq=False)
class _Grid:
    cell_px: float
    shape: tuple[int, int]
    padded: tuple[int, int]


def coarse_match(picture: Picture, drawn: DrawnEdges) -> CoarseMatch:
    """Search shift, roll (+-4 deg) and scale (0.84..1.16) of the predicted lines."""
    grid = _grid(picture)
    image = _harmonics_of_picture(picture, grid)
    points, angles = _points(drawn, grid.cell_px)
    best = (-np.inf, Alignment())
    for roll, scale in product(_ROLLS_RAD, _SCALES):
        best = max(
            best, _best_shift(image, points, angles, roll, scale, grid), key=_first
        )
    centre = best[1]
    for roll, scale in product((-0.5, 0.0, 0.5), (-0.02, 0.0, 0.02)):
        turn = centre.roll_rad + np.deg2rad(roll)
        finer = _best_shift(image, points, angles, turn, centre.scale + scale, grid)
        best = max(best, finer, key=_first)
    still = _correlation(image, points, angles, 0.0, 1.0, grid)[0, 0]
    return CoarseMatch(best[1], float(best[0]), float(still))


def _first(pair: tuple[float, Alignment]) -> float:
    return pair[0]


def _grid(picture: Picture) -> _Grid:
    rows, columns = picture.grey.shape
    width = columns * picture.plane.optics.pixel_x_px
    cell = max(1.0, round(min(rows, width) / _TARGET_CELLS))
    shape = (int(rows / cell), int(width / cell))
    padded = tuple(
        fft.next_fast_len(int(n * (1 + _SHIFT_SHARE)), real=True) for n in shape
    )
    return _Grid(cell, shape, (padded[0], padded[1]))


def _harmonics_of_picture(picture: Picture, grid: _Grid) -> list[Complex]:
    rows, columns = grid.shape
    y, x = np.mgrid[:rows, :columns].astype(np.float64)
    centre = np.array([columns - 1, rows - 1]) / 2
    places = (np.stack([x, y], axis=-1) - centre) * grid.cell_px
    smooth = cv2.GaussianBlur(picture.single, (0, 0), 0.5 * grid.cell_px)
    raw = picture.plane.raw(places).astype(np.float32)
    small = cv2.remap(
        smooth,
        raw[..., 0],
        raw[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    by_y, by_x = np.gradient(small)
    size = np.hypot(by_x, by_y)
    weight = (size / (size + np.percentile(size, 90) + 1e-6)) ** 2
    turn = np.exp(1j * np.arctan2(by_y, by_x))
    layers = [weight - weight.mean(), weight * turn**2, weight * turn**4]
    return [fft.fft2(layer.astype(np.complex64), grid.padded) for layer in layers]


def _points(drawn: DrawnEdges, cell_px: float) -> tuple[FloatArray, FloatArray]:
    """Points at half a cell along all lines, and the angle of their normals."""
    points, angles = [np.zeros((0, 2))], [np.zeros(0)]
    for start, end in zip(drawn.start_px, drawn.end_px, strict=True):
        along = end - start
        count = int(np.linalg.norm(along) / (0.5 * cell_px)) + 1
        share = (np.arange(count) + 0.5)[:, None] / count
        points.append(start + share * along)
        angles.append(np.full(count, np.arctan2(along[0], -along[1])))
    return np.concatenate(points), np.concatenate(angles)


def _correlation(
    image: list[Complex],
    points: FloatArray,
    angles: FloatArray,
    roll: float,
    scale: float,
    grid: _Grid,
) -> FloatArray:
    """Mean agreement of all points for every shift, cyclic, in cells."""
    moved = Alignment(0.0, 0.0, roll, scale).apply(points) / grid.cell_px
    cell = np.rint(moved + (np.array(grid.shape[::-1]) - 1) / 2).astype(np.int64)
    inside = ((cell >= 0) & (cell < np.array(grid.shape[::-1]))).all(axis=1)
    flat = cell[inside, 1] * grid.padded[1] + cell[inside, 0]
    turn = np.exp(1j * (angles[inside] + roll))
    size = grid.padded[0] * grid.padded[1]
    total = np.zeros(grid.padded, dtype=np.complex64)
    for order, (factor, layer) in enumerate(zip(_COS4, image, strict=True)):
        value = turn ** (2 * order)
        drawn = np.bincount(flat, value.real, size) + 1j * np.bincount(
            flat, value.imag, size
        )
        spectrum = fft.fft2(drawn.reshape(grid.padded).astype(np.complex64))
        total += np.float32(factor) * layer * np.conj(spectrum)
    return np.asarray(fft.ifft2(total).real / max(len(points), 1))


def _best_shift(
    image: list[Complex],
    points: FloatArray,
    angles: FloatArray,
    roll: float,
    scale: float,
    grid: _Grid,
) -> tuple[float, Alignment]:
    value = _correlation(image, points, angles, roll, scale, grid)
    reach = [int(n * _SHIFT_SHARE) for n in grid.shape]
    rows = np.arange(-reach[0], reach[0] + 1)
    columns = np.arange(-reach[1], reach[1] + 1)
    window = value[np.ix_(rows % grid.padded[0], columns % grid.padded[1])]
    y, x = np.unravel_index(int(window.argmax()), window.shape)
    shift = np.array([columns[x], rows[y]]) * grid.cell_px
    alignment = Alignment(float(shift[0]), float(shift[1]), roll, scale)
    return float(window[y, x]), alignment
