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
from mvp.imaging.render_texture import print_albedo

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.imaging.light import Float32Array
    from mvp.imaging.render_kernel import WedgeTables
    from mvp.imaging.render_view import CameraView
    from mvp.imaging.render_visible import Pieces

_TIE_PX = 0.004
# A pixel whose sides differ by less counts as square.
_SQUARE = 1.005
_COARSE = 8
_PAIRS_PER_CHUNK = 2_000_000


@dataclass(frozen=True, eq=False)
class Spread:
    """How far and how border pieces spread.

    Attributes:
        level: (n,) row of the tables for each piece.
        tables: what each level does.
        parts: a pixel's smaller side is cut into this many parts.
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
    coarse = view.triangles[::_COARSE, ::_COARSE].reshape(-1)
    rays = view.rays.directions[::_COARSE, ::_COARSE].reshape(-1, 3)
    depth = view.depths(coarse, rays)
    depth = depth[np.isfinite(depth)]
    ends = np.array([depth.min(), depth.max()]) if depth.size else np.ones(1)
    blur = view.optics.blur_mm(ends) / pitch * float(defocus)
    return float(spread_radius_px(blur, airy, 1).max()) + 2.0


def mix_borders(
    view: CameraView,
    grey: Float32Array,
    pieces: Pieces,
    spread: Spread,
    near: BoolArray,
) -> None:
    """Draw the borders into a picture of one ray per pixel, in place.

    Args:
        view: camera and scene.
        grey: (rows, columns) the picture.
        pieces: visible border pieces.
        spread: their spread.
        near: (rows, columns) pixels that a border may cross. In the others all parts of
            a pixel lie on one side, and slopes cancel between opposite parts.
    """
    pairs = _pairs(view, pieces, spread)
    pixels = _touched(view, pairs)
    if not len(pixels):
        return
    total = np.zeros(len(pixels))
    flat = grey.reshape(-1)
    crossed = np.flatnonzero(near.reshape(-1)[pixels])
    shifts_px = _part_centres(spread)
    for shift in shifts_px:
        base = flat[pixels]
        if len(shifts_px) > 1:
            shifts = np.broadcast_to(shift, (len(crossed), 2))
            base[crossed] = _base(view, pixels[crossed], shifts, base[crossed])
        total += _mixed(view, pixels, shift, base, _Borders(pieces, spread, pairs))
    flat[pixels] = total / len(shifts_px)


def _part_centres(spread: Spread) -> FloatArray:
    """Places (n, 2) within a pixel, px, at which its parts are drawn.

    Every part is drawn as round as one of the smaller pitch. Along the larger pitch the
    places lie so far apart that the variance of the pixel's area comes out right.
    """
    x, y = (_centres_along(float(side), spread.parts) for side in spread.scale)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _centres_along(side: float, parts: int) -> FloatArray:
    """Places along one side of a pixel, which is ``side`` smaller pitches long."""
    count = max(round(parts * side), 2) if side > _SQUARE else parts
    if count == 1:
        return np.zeros(1)
    gap = np.sqrt((1 - 1 / (parts * side) ** 2) / (count**2 - 1))
    return np.asarray((np.arange(count) - (count - 1) / 2) * gap)


def _mixed(
    view: CameraView,
    pixels: IntArray,
    shift: FloatArray,
    base: Float32Array,
    borders: _Borders,
) -> FloatArray:
    """Grey (n,) at one place within all touched pixels."""
    change, tied = _changes(view, pixels, shift, borders)
    mixed = base + change
    if not len(tied.pixel):
        return np.asarray(mixed)
    # On a border a ray cannot tell the sides apart: take the mean of both.
    where = np.searchsorted(pixels, tied.pixel)
    mixed[where] = 0.0
    for side in (1.0, -1.0):
        moved = shift + side * tied.aside
        fresh = _base(view, tied.pixel, moved, base[where])
        again, _ = _changes(view, tied.pixel, moved, borders)
        mixed[where] += 0.5 * (fresh + again)
    return np.asarray(mixed)


@dataclass(frozen=True, eq=False)
class _Borders:
    """Pieces, their spread, and the chunks of (piece, pixel) pairs within reach."""

    pieces: Pieces
    spread: Spread
    pairs: list[tuple[IntArray, IntArray]]


@dataclass(frozen=True, eq=False)
class _Ties:
    """Pixels whose place lies on a border, and a short way off it (n, 2)."""

    pixel: IntArray
    aside: FloatArray


def _base(
    view: CameraView, pixels: IntArray, shift: FloatArray, centre: Float32Array
) -> Float32Array:
    """Grey under single rays at places within pixels; prints stay as averaged."""
    directions = view.rays.within(pixels, shift)
    triangles = view.scene.hit(view.world_from_camera, directions)
    same = (
        view.scene.plane_ids[triangles]
        == view.scene.plane_ids[view.triangles.reshape(-1)[pixels]]
    )
    depth = view.depths(triangles, directions)
    points = directions * np.where(triangles < 0, np.float32(1), depth)[:, None]
    grey = view.shade(triangles, points) * print_albedo(view, triangles, points)
    return np.where(same & view.has_prints, centre, grey)


def _touched(view: CameraView, pairs: list[tuple[IntArray, IntArray]]) -> IntArray:
    """Flat indices, sorted, of all pixels within reach of any piece."""
    seen = np.zeros(view.shape, dtype=bool)
    for _, pixel in pairs:
        seen.reshape(-1)[pixel] = True
    return np.flatnonzero(seen)


def _changes(
    view: CameraView,
    pixels: IntArray,
    shift: FloatArray,
    borders: _Borders,
) -> tuple[FloatArray, _Ties]:
    """What the borders add at places within pixels, and the places on a border."""
    change = np.zeros(len(pixels))
    slot = np.full(view.shape[0] * view.shape[1], -1, dtype=np.int64)
    slot[pixels] = np.arange(len(pixels))
    shifts = np.broadcast_to(shift, (len(pixels), 2))
    ties: list[_Ties] = []
    for pair_piece, pair_pixel in borders.pairs:
        slots = slot[pair_pixel]
        known = np.flatnonzero(slots >= 0)
        piece, index = pair_piece[known], slots[known]
        near, amount, tie, aside = _pair_changes(
            view, pixels[index], shifts[index], borders.pieces, piece, borders.spread
        )
        index = index[near]
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
) -> tuple[IntArray, FloatArray, BoolArray, FloatArray]:
    """Pairs within reach: index, change, whether tied, and the way off the border."""
    geometry = _place(view, pixel, shift, pieces, piece, spread)
    height, passed, length, normal = geometry
    level = spread.level[piece]
    above = np.abs(height)
    near = np.flatnonzero(above < spread.tables.radius_px[level])
    over, which = above[near].astype(np.float32), level[near]
    ahead = (length - passed)[near].astype(np.float32)
    wedge = spread.tables.wedge(which, over, ahead)
    height, passed, length = height[near], passed[near], length[near]
    wedge += spread.tables.wedge(which, over, passed.astype(np.float32))
    share = np.clip(passed / length, 0.0, 1.0)
    step = pieces.step[piece[near]]
    step = step[:, 0] + share * (step[:, 1] - step[:, 0])
    # Positive height is the right side: from there the step to the far side is minus.
    amount = -np.sign(height) * step * wedge
    tie = (over < _TIE_PX) & (passed > -_TIE_PX) & (passed < length + _TIE_PX)
    aside = normal[piece[near[tie]]] * (3 * _TIE_PX)
    return near, amount, tie, aside


def _place(
    view: CameraView,
    pixel: IntArray,
    shift: FloatArray,
    pieces: Pieces,
    piece: IntArray,
    spread: Spread,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Height over the piece and way along it per pair, its length; normals per piece."""
    start = pieces.start_px * spread.scale
    along = pieces.end_px * spread.scale - start
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-12)
    unit = along / length[:, None]
    columns = view.shape[1]
    gap_x = (pixel % columns + shift[:, 0]) * spread.scale[0] - start[piece, 0]
    gap_y = (pixel // columns + shift[:, 1]) * spread.scale[1] - start[piece, 1]
    unit_x, unit_y = unit[piece, 0], unit[piece, 1]
    passed = gap_x * unit_x + gap_y * unit_y
    height = gap_y * unit_x - gap_x * unit_y
    normal = np.column_stack([-unit[:, 1], unit[:, 0]]) / spread.scale
    return height, passed, length[piece], normal


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
