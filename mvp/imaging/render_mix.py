"""Blur, diffraction and pixel area at the borders of a picture, in closed form.

A pixel near a border is the grey under its own ray plus, for every border piece within
reach, the step to the far side times the share of the spread that lies beyond it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.render_kernel import (
    blur_levels,
    spread_radius_px,
    subpixels_needed,
    wedge_tables,
)
from mvp.imaging.render_sampled import chief_directions
from mvp.imaging.render_texture import print_albedo

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.imaging.light import Float32Array
    from mvp.imaging.render_kernel import WedgeTables
    from mvp.imaging.render_view import CameraView
    from mvp.imaging.render_visible import Pieces

_TIE_PX = 0.004
_PAIRS_PER_CHUNK = 2_000_000


@dataclass(frozen=True, eq=False)
class Spread:
    """How far and how border pieces spread.

    Attributes:
        level: (n,) row of the tables for each piece.
        tables: what each level does.
        parts: a pixel's side is cut into this many parts.
        scale: (2,) from pixels to units of the smaller pitch.
    """

    level: IntArray
    tables: WedgeTables
    parts: int
    scale: FloatArray


def spread_of(
    view: CameraView, pieces: Pieces, *, defocus: bool, diffraction: bool
) -> Spread:
    """The spread of every piece at its own depth."""
    pitch = float(view.pitch_mm.min())
    blur = view.optics.blur_mm(pieces.depth_mm) / pitch * float(defocus)
    airy = view.optics.airy_unit_mm / pitch * float(diffraction)
    blurs, level = blur_levels(blur)
    sharpest = float(blurs.min(initial=np.inf)) if len(blurs) else 0.0
    parts = subpixels_needed(sharpest, airy)
    tables = wedge_tables(tuple(blurs.tolist()) or (0.05,), airy, parts)
    return Spread(level, tables, parts, view.pitch_mm / pitch)


def margin_px(view: CameraView, *, defocus: bool, diffraction: bool) -> float:
    """How far outside the frame a border may still matter."""
    pitch = float(view.pitch_mm.min())
    airy = view.optics.airy_unit_mm / pitch * float(diffraction)
    depth = view.depth_mm[np.isfinite(view.depth_mm)]
    ends = np.array([depth.min(), depth.max()]) if depth.size else np.ones(1)
    blur = view.optics.blur_mm(ends) / pitch * float(defocus)
    return float(spread_radius_px(blur, airy, 1).max()) + 2.0


def mix_borders(
    view: CameraView, grey: Float32Array, pieces: Pieces, spread: Spread
) -> None:
    """Draw the borders into a picture of one ray per pixel, in place."""
    pixels = _touched(view, pieces, spread)
    if not len(pixels):
        return
    total = np.zeros(len(pixels))
    flat = grey.reshape(-1)
    for shift in _part_centres(spread.parts):
        base = flat[pixels]
        if spread.parts > 1:
            base = _base(view, pixels, np.broadcast_to(shift, (len(pixels), 2)), base)
        total += _mixed(view, pixels, shift, base, pieces, spread)
    flat[pixels] = total / spread.parts**2


def _part_centres(parts: int) -> FloatArray:
    place = (np.arange(parts) + 0.5) / parts - 0.5
    return np.stack(np.meshgrid(place, place), axis=-1).reshape(-1, 2)


def _mixed(
    view: CameraView,
    pixels: IntArray,
    shift: FloatArray,
    base: Float32Array,
    pieces: Pieces,
    spread: Spread,
) -> FloatArray:
    """Grey (n,) at one place within all touched pixels."""
    change, tied = _changes(view, pixels, shift, pieces, spread)
    mixed = base + change
    if not len(tied.pixel):
        return np.asarray(mixed)
    # On a border a ray cannot tell the sides apart: take the mean of both.
    where = np.searchsorted(pixels, tied.pixel)
    mixed[where] = 0.0
    for side in (1.0, -1.0):
        moved = shift + side * tied.aside
        fresh = _base(view, tied.pixel, moved, base[where])
        again, _ = _changes(view, tied.pixel, moved, pieces, spread)
        mixed[where] += 0.5 * (fresh + again)
    return np.asarray(mixed)


@dataclass(frozen=True, eq=False)
class _Ties:
    """Pixels whose place lies on a border, and a short way off it (n, 2)."""

    pixel: IntArray
    aside: FloatArray


def _base(
    view: CameraView, pixels: IntArray, shift: FloatArray, centre: Float32Array
) -> Float32Array:
    """Grey under single rays at places within pixels; prints stay as averaged."""
    directions = chief_directions(view, pixels, shift)
    triangles = view.scene.hit(view.world_from_camera, directions)
    same = (
        view.scene.plane_ids[triangles]
        == view.scene.plane_ids[view.triangles.reshape(-1)[pixels]]
    )
    depth = view.depths(triangles, directions)
    points = directions * np.where(triangles < 0, np.float32(1), depth)[:, None]
    grey = view.shade(triangles, points) * print_albedo(view, triangles, points)
    return np.where(same & view.has_prints, centre, grey)


def _touched(view: CameraView, pieces: Pieces, spread: Spread) -> IntArray:
    """Flat indices, sorted, of all pixels within reach of any piece."""
    seen = np.zeros(view.shape, dtype=bool)
    for _, pixel in _pairs(view, pieces, spread):
        seen.reshape(-1)[pixel] = True
    return np.flatnonzero(seen)


def _changes(
    view: CameraView,
    pixels: IntArray,
    shift: FloatArray,
    pieces: Pieces,
    spread: Spread,
) -> tuple[FloatArray, _Ties]:
    """What the borders add at places within pixels, and the places on a border."""
    change = np.zeros(len(pixels))
    slot = np.full(view.shape[0] * view.shape[1], -1, dtype=np.int64)
    slot[pixels] = np.arange(len(pixels))
    shifts = np.broadcast_to(shift, (len(pixels), 2))
    ties: list[_Ties] = []
    for piece, pixel in _pairs(view, pieces, spread):
        index = slot[pixel]
        known = index >= 0
        piece, index = piece[known], index[known]
        amount, tie, aside = _pair_changes(
            view, pixels[index], shifts[index], pieces, piece, spread
        )
        change += np.bincount(index, amount, minlength=len(pixels))
        ties.append(_Ties(pixels[index[tie]], aside))
    pixel = np.concatenate([t.pixel for t in ties] or [np.zeros(0, np.int64)])
    aside = np.concatenate([t.aside for t in ties] or [np.zeros((0, 2))])
    unique, first = np.unique(pixel, return_index=True)
    return change, _Ties(unique, aside[first])


def _pair_changes(
    view: CameraView,
    pixel: IntArray,
    shift: FloatArray,
    pieces: Pieces,
    piece: IntArray,
    spread: Spread,
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Change per (place, piece) pair, which pairs tie, and the way off the border."""
    columns = view.shape[1]
    x = pixel % columns + shift[:, 0]
    y = pixel // columns + shift[:, 1]
    start, along = pieces.start_px[piece], (pieces.end_px - pieces.start_px)[piece]
    along_x, along_y = along[:, 0] * spread.scale[0], along[:, 1] * spread.scale[1]
    length = np.maximum(np.hypot(along_x, along_y), 1e-12)
    unit_x, unit_y = along_x / length, along_y / length
    gap_x = (x - start[:, 0]) * spread.scale[0]
    gap_y = (y - start[:, 1]) * spread.scale[1]
    passed = gap_x * unit_x + gap_y * unit_y
    height = gap_y * unit_x - gap_x * unit_y
    level = spread.level[piece]
    above = np.abs(height)
    wedge = spread.tables.wedge(level, above, length - passed)
    wedge += spread.tables.wedge(level, above, passed)
    share = np.clip(passed / length, 0.0, 1.0)
    step = pieces.step[piece]
    step = step[:, 0] + share * (step[:, 1] - step[:, 0])
    # Positive height is the right side: from there the step to the far side is minus.
    amount = -np.sign(height) * step * wedge
    tie = (above < _TIE_PX) & (passed > -_TIE_PX) & (passed < length + _TIE_PX)
    normal = np.column_stack([-unit_y[tie], unit_x[tie]]) / spread.scale
    return amount, tie, normal * (3 * _TIE_PX)


def _pairs(
    view: CameraView, pieces: Pieces, spread: Spread
) -> list[tuple[IntArray, IntArray]]:
    """Chunks of (piece, flat pixel) with the pixel in the piece's grown box."""
    rows, columns = view.shape
    reach = (spread.tables.radius_px[spread.level] + 0.5)[:, None] / spread.scale
    low = np.ceil(np.minimum(pieces.start_px, pieces.end_px) - reach).astype(np.int64)
    high = np.floor(np.maximum(pieces.start_px, pieces.end_px) + reach).astype(np.int64)
    low = np.maximum(low, 0)
    high = np.minimum(high, np.array([columns - 1, rows - 1]))
    size = np.maximum(high - low + 1, 0)
    count = size[:, 0] * size[:, 1]
    ends = np.cumsum(count)
    cuts = np.searchsorted(ends, np.arange(0, ends[-1:].sum(), _PAIRS_PER_CHUNK))
    bounds = np.unique(np.append(cuts, len(count)))
    chunks = []
    for begin, stop in itertools.pairwise(bounds):
        number = count[begin:stop]
        piece = np.repeat(np.arange(begin, stop), number)
        inner = np.arange(len(piece)) - np.repeat(np.cumsum(number) - number, number)
        width = size[piece, 0]
        pixel = (
            (low[piece, 1] + inner // width) * columns + low[piece, 0] + inner % width
        )
        chunks.append((piece, pixel))
    return chunks
