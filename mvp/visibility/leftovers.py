"""Which triangles still reach into the open region: the step that makes it exact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import igl
import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray

_SHRINK = 1e-7
_PAIRS_AT_ONCE = 1 << 21


def reaching_into(
    triangles_mm: FloatArray, vertices_mm: FloatArray, faces: IntArray
) -> BoolArray:
    """Which triangles (m, 3, 3) meet the open solid bounded by a closed mesh.

    Each is shrunk by 1e-7 towards its middle, so that touching neighbours do not
    count. Doubtful cases count as meeting.

    Args:
        triangles_mm: the triangles in question, mm.
        vertices_mm: (n, 3) vertices of the solid, mm.
        faces: (k, 3) faces of the solid.
    """
    meets = np.zeros(len(triangles_mm), dtype=np.bool_)
    if not len(triangles_mm) or not len(faces):
        return meets
    middle = triangles_mm.mean(axis=1)
    shrunk = middle[:, None] + (1 - _SHRINK) * (triangles_mm - middle[:, None])
    inside = igl.fast_winding_number(vertices_mm, faces, middle) > 0.5
    meets |= inside
    tree = igl.AABB()
    tree.init(vertices_mm, faces)
    squared = np.asarray(tree.squared_distance(vertices_mm, faces, middle)[0])
    radius = np.linalg.norm(shrunk - middle[:, None], axis=2).max(axis=1)
    doubtful = np.flatnonzero(~meets & (np.sqrt(squared) <= radius))
    meets[doubtful] = _crossing(shrunk[doubtful], vertices_mm[faces])
    return meets


def _crossing(triangles: FloatArray, walls: FloatArray) -> BoolArray:
    """Which triangles (m, 3, 3) cross any triangle of ``walls`` (k, 3, 3)."""
    crossing = np.zeros(len(triangles), dtype=np.bool_)
    step = max(1, _PAIRS_AT_ONCE // max(1, 3 * len(walls)))
    for start in range(0, len(triangles), step):
        some = slice(start, start + step)
        crossing[some] = _crossing_block(triangles[some], walls)
    return crossing


def _crossing_block(triangles: FloatArray, walls: FloatArray) -> BoolArray:
    pairs_t, pairs_w = _near_pairs(triangles, walls)
    hit = edges_cross(triangles[pairs_t], walls[pairs_w])
    rest = np.flatnonzero(~hit)
    hit[rest] = edges_cross(walls[pairs_w[rest]], triangles[pairs_t[rest]])
    crossing = np.zeros(len(triangles), dtype=np.bool_)
    crossing[pairs_t[hit]] = True
    return crossing


def _near_pairs(triangles: FloatArray, walls: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs that no box and neither of the two planes separates."""
    low_t, high_t = triangles.min(axis=1), triangles.max(axis=1)
    low_w, high_w = walls.min(axis=1), walls.max(axis=1)
    near = np.ones((len(triangles), len(walls)), dtype=np.bool_)
    for axis in range(3):
        near &= low_t[:, None, axis] <= high_w[None, :, axis]
        near &= high_t[:, None, axis] >= low_w[None, :, axis]
    rows, columns = np.nonzero(near)
    straddle = _straddles(triangles[rows], walls[columns])
    rows, columns = rows[straddle], columns[straddle]
    straddle = _straddles(walls[columns], triangles[rows])
    return rows[straddle], columns[straddle]


def _straddles(triangles: FloatArray, planes_of: FloatArray) -> BoolArray:
    """Pairwise (p,): not strictly on one side of the other triangle's plane."""
    a, b, c = np.moveaxis(planes_of, 1, 0)
    normal = np.cross(b - a, c - a)
    height = np.einsum("pcd,pd->pc", triangles - a[:, None], normal)
    return np.asarray((height.min(axis=1) <= 0) & (height.max(axis=1) >= 0))


def edges_cross(triangles: FloatArray, others: FloatArray) -> BoolArray:
    """Pairwise (p,): an edge of the first (p, 3, 3) meets the second (p, 3, 3)."""
    a, b, c = np.moveaxis(others, 1, 0)
    normal = np.cross(b - a, c - a)
    height = np.einsum("pcd,pd->pc", triangles - a[:, None], normal)
    crossing = np.zeros(len(triangles), dtype=np.bool_)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start, along = triangles[:, i], triangles[:, j] - triangles[:, i]
        sides = [
            np.einsum("pd,pd->p", along, np.cross(u - start, v - start))
            for u, v in ((a, b), (b, c), (c, a))
        ]
        same = np.minimum.reduce(sides) * np.maximum.reduce(sides) >= 0
        crossing |= same & (height[:, i] * height[:, j] <= 0)
    return crossing
