"""Which pieces of the sharp lines show in a picture, and what lies on either side.

Each projected line is probed with two rays, just left and just right of it, about once
per pixel; where what they hit changes, the place is found by bisection. A piece is kept
when the two sides lie in different planes and the nearer one holds the line, so every
border of the picture is owned by exactly one line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.render_texture import print_albedo

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.imaging.light import Float32Array
    from mvp.imaging.render_view import CameraView

_PROBE_STEP_PX = 1.0
_PROBE_ASIDE_PX = 0.02
_BISECTIONS = 9
_PIECE_PX = 16.0
_NEAR_MM = 1.0
_ON_PLANE_MM = 2e-3
_ON_PLANE_RELATIVE = 2e-6
_FRAME_SAMPLES = 33
_FAINTEST_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class Pieces:
    """Short straight pieces of visible borders, n of them.

    Attributes:
        start_px, end_px: (n, 2) in the picture.
        step: (n, 2) grey on the right minus grey on the left, at both ends.
        depth_mm: (n,) z of the line itself, which decides its blur.
    """

    start_px: FloatArray
    end_px: FloatArray
    step: FloatArray
    depth_mm: FloatArray

    def strong(self) -> Pieces:
        """The pieces whose two sides differ."""
        seen = (np.abs(self.step) > _FAINTEST_STEP).any(axis=1)
        ends = self.start_px[seen], self.end_px[seen]
        return Pieces(*ends, self.step[seen], self.depth_mm[seen])


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines in normalised coordinates: start + t * along, 1 / z linear in t."""

    start: FloatArray
    along: FloatArray
    inverse_z: FloatArray
    length_px: FloatArray

    def at(self, line: IntArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normalised coordinates (n, 2) and depth (n,) of places on lines."""
        ends = self.inverse_z[line]
        inverse = ends[:, 0] + t * (ends[:, 1] - ends[:, 0])
        return self.start[line] + t[:, None] * self.along[line], 1.0 / inverse


@dataclass(frozen=True, eq=False)
class _Probe:
    """What lies right and left of places on lines; label -1: no border there."""

    right: IntArray
    left: IntArray
    label: IntArray


def visible_pieces(view: CameraView, margin_px: float) -> Pieces:
    """All visible border pieces within the frame grown by a margin."""
    lines = _projected(view, margin_px)
    if not len(lines.start):
        none = np.zeros((0, 2))
        return Pieces(none, none, none, np.zeros(0))
    cells = np.maximum(1, np.ceil(lines.length_px / _PROBE_STEP_PX)).astype(np.int64)
    line = np.repeat(np.arange(len(cells)), cells)
    number = np.arange(len(line)) - np.repeat(np.cumsum(cells) - cells, cells)
    middle = (number + 0.5) / cells[line]
    probe = _probe(view, lines, line, middle)
    changes = (probe.label[1:] != probe.label[:-1]) & (line[1:] == line[:-1])
    border = _bisected(view, lines, probe, line, middle, np.flatnonzero(changes))
    heads = np.flatnonzero(np.append(True, changes | (line[1:] != line[:-1])))
    tails = np.append(heads[1:], len(line)) - 1
    begin = np.where(number[heads] == 0, 0.0, border[np.maximum(heads - 1, 0)])
    finish = np.where(number[tails] == cells[line[tails]] - 1, 1.0, border[tails])
    kept = probe.label[heads] >= 0
    heads = heads[kept]
    sides = (probe.right[heads], probe.left[heads])
    return _pieces(view, lines, line[heads], begin[kept], finish[kept], sides)


def _bisected(
    view: CameraView,
    lines: _Lines,
    probe: _Probe,
    line: IntArray,
    middle: FloatArray,
    changes: IntArray,
) -> FloatArray:
    """(n,) place of the change after each cell; meaningful at ``changes`` only."""
    low, high = middle[changes], middle[np.minimum(changes + 1, len(middle) - 1)]
    label = probe.label[changes]
    for _ in range(_BISECTIONS):
        half = (low + high) / 2
        same = _probe(view, lines, line[changes], half).label == label
        low, high = np.where(same, half, low), np.where(same, high, half)
    border = np.ones(len(line))
    border[changes] = (low + high) / 2
    return border


def _probe(view: CameraView, lines: _Lines, line: IntArray, t: FloatArray) -> _Probe:
    """Cast one ray on either side of places on lines."""
    place, depth = lines.at(line, t)
    scale = view.optics.f_cal_mm / view.pitch_mm
    along = lines.along[line] * scale
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    # Right of the direction of travel in a picture whose y axis points down.
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1) * _PROBE_ASIDE_PX / scale
    rays = np.ones((2, len(t), 3), dtype=np.float32)
    rays[0, :, :2], rays[1, :, :2] = place + aside, place - aside
    hit = view.scene.hit(view.world_from_camera, rays.reshape(-1, 3))
    right, left = hit.reshape(2, -1)
    points = np.column_stack([place, np.ones(len(t))]) * depth[:, None]
    planes = view.scene.plane_ids
    owned = _owned(view, rays, right, left, points)
    border = owned & (planes[right] != planes[left])
    label = np.where(border, planes[right] * len(planes) + planes[left], -1)
    # Plane -1 (nothing hit) must not make a label negative.
    label = np.where(border, label + len(planes) + 1, -1)
    return _Probe(right, left, label)


def _owned(
    view: CameraView,
    rays: Float32Array,
    right: IntArray,
    left: IntArray,
    points: FloatArray,
) -> BoolArray:
    """Whether the nearer of the two surfaces holds the point of the line."""
    on_right = _on_plane(view, right, points)
    on_left = _on_plane(view, left, points)
    nearer = view.depths(right, rays[0]) < view.depths(left, rays[1])
    return np.where(nearer, on_right, on_left) | (on_right & on_left)


def _on_plane(view: CameraView, triangles: IntArray, points: FloatArray) -> BoolArray:
    offset = view.planes.offsets_mm[triangles]
    gap = np.einsum("nk,nk->n", view.planes.normals[triangles], points) - offset
    limit = _ON_PLANE_MM + _ON_PLANE_RELATIVE * np.abs(points).max(axis=1)
    return np.asarray((triangles >= 0) & (np.abs(gap) < limit))


def _pieces(
    view: CameraView,
    lines: _Lines,
    line: IntArray,
    begin: FloatArray,
    finish: FloatArray,
    sides: tuple[IntArray, IntArray],
) -> Pieces:
    """Cut runs into short pieces and shade both sides at every cut."""
    length = lines.length_px[line] * (finish - begin)
    parts = np.maximum(1, np.ceil(length / _PIECE_PX)).astype(np.int64)
    run = np.repeat(np.arange(len(line)), parts)
    number = np.arange(len(run)) - np.repeat(np.cumsum(parts) - parts, parts)
    width = (finish - begin)[run] / parts[run]
    first = begin[run] + number * width
    ends, steps, depths = [], [], []
    for t in (first, first + width):
        place, depth = lines.at(line[run], t)
        ends.append(view.intrinsics.to_pixels(place, view.optics.f_cal_mm))
        right, left = (_grey(view, side[run], place, depth) for side in sides)
        steps.append(right - left)
        depths.append(depth)
    middle_depth = 2 / (1 / depths[0] + 1 / depths[1])
    return Pieces(ends[0], ends[1], np.stack(steps, axis=1), middle_depth)


def _grey(
    view: CameraView, triangles: IntArray, place: FloatArray, depth: FloatArray
) -> FloatArray:
    """Grey of the surface on one side, at the line."""
    directions = np.column_stack([place, np.ones(len(place))])
    on_line = directions * depth[:, None]
    other = view.depths(triangles, directions.astype(np.float32))
    there = _on_plane(view, triangles, on_line) | ~np.isfinite(other) | (other <= 0)
    points = directions * np.where(there, depth, other)[:, None]
    points = points.astype(np.float32)
    grey = view.shade(triangles, points) * print_albedo(view, triangles, points)
    return grey.astype(np.float64)


def _projected(view: CameraView, margin_px: float) -> _Lines:
    """Lines of the scene, clipped to the near plane and the grown frame."""
    camera_from_world = view.world_from_camera.inverse()
    ends = camera_from_world.apply(view.scene.lines_mm)
    ends = _clipped_near(ends)
    normalised = ends[..., :2] / ends[..., 2:]
    low, high = _frame(view, margin_px)
    start, along = normalised[:, 0], normalised[:, 1] - normalised[:, 0]
    enter, leave = _clip_range(start, along, low, high)
    inside = enter < leave
    inverse = 1.0 / ends[inside, :, 2]
    enter, leave = enter[inside], leave[inside]
    start, along = start[inside], along[inside]
    slope = inverse[:, 1] - inverse[:, 0]
    scale = view.optics.f_cal_mm / view.pitch_mm
    cut = along * (leave - enter)[:, None]
    return _Lines(
        start + enter[:, None] * along,
        cut,
        np.stack(
            [inverse[:, 0] + enter * slope, inverse[:, 0] + leave * slope], axis=1
        ),
        np.linalg.norm(cut * scale, axis=1),
    )


def _clipped_near(ends: FloatArray) -> FloatArray:
    """Segments (k, 2, 3) cut at z = near; those behind it are dropped."""
    ends = ends[(ends[..., 2] > _NEAR_MM).any(axis=1)]
    z = ends[..., 2]
    drop = z[:, 1] - z[:, 0]
    safe = np.where(np.abs(drop) > 0, drop, 1.0)
    t = np.clip((_NEAR_MM - z[:, 0]) / safe, 0.0, 1.0)[:, None]
    cut = ends[:, 0] + t * (ends[:, 1] - ends[:, 0])
    cut[:, 2] = _NEAR_MM
    behind = z <= _NEAR_MM
    first = np.where(behind[:, :1], cut, ends[:, 0])
    second = np.where(behind[:, 1:], cut, ends[:, 1])
    return np.stack([first, second], axis=1)


def _frame(view: CameraView, margin_px: float) -> tuple[FloatArray, FloatArray]:
    """Bounds of the grown frame in normalised coordinates."""
    rows, columns = view.shape
    x = np.linspace(-margin_px, columns - 1 + margin_px, _FRAME_SAMPLES)
    y = np.linspace(-margin_px, rows - 1 + margin_px, _FRAME_SAMPLES)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    normalised = view.intrinsics.to_normalised(grid, view.optics.f_cal_mm)
    return normalised.min(axis=0), normalised.max(axis=0)


def _clip_range(
    start: FloatArray, along: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Part (enter, leave) of each line within a box (Liang-Barsky)."""
    still = np.abs(along) < 1e-15
    safe = np.where(still, 1.0, along)
    to_low, to_high = (low - start) / safe, (high - start) / safe
    outside = still & ((start < low) | (start > high))
    enter = np.where(still, 0.0, np.minimum(to_low, to_high))
    leave = np.where(still, 1.0, np.maximum(to_low, to_high))
    leave = np.where(outside, -1.0, leave)
    return (
        np.maximum(enter.max(axis=1), 0.0),
        np.minimum(leave.min(axis=1), 1.0),
    )
