"""Straight lines of a mesh along which a picture may change: its creases and borders.

Found once per scene. Collinear pieces are joined and overlaps are counted once, so
that a soup of abutting plates draws like the solid it stands for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray, TriangleMesh

_WELD_MM = 1e-5
_DIRECTION_STEP = 1e-6
_MOMENT_STEP_MM = 1e-3
_LATTICE_SHIFT = 0.1234  # CAD numbers sit on round values; keep them off the ties


def sharp_lines(mesh: TriangleMesh, plane_ids: IntArray) -> FloatArray:
    """Maximal segments (k, 2, 3), mm, between triangles of different planes.

    Args:
        mesh: the triangles.
        plane_ids: (m,) equal for coplanar triangles of one body.
    """
    vertices, edges, triangles = _half_edges(mesh)
    if not len(edges):
        return np.zeros((0, 2, 3))
    unique, inverse, counts = np.unique(
        edges, axis=0, return_inverse=True, return_counts=True
    )
    planes = plane_ids[triangles]
    inverse = inverse.reshape(-1)
    low = np.full(len(unique), np.iinfo(np.int64).max)
    high = np.full(len(unique), -1)
    np.minimum.at(low, inverse, planes)
    np.maximum.at(high, inverse, planes)
    sharp = unique[(low != high) | (counts == 1)]
    return _joined(vertices[sharp])


def _half_edges(mesh: TriangleMesh) -> tuple[FloatArray, IntArray, IntArray]:
    """Welded vertices, edges (k, 2) with the smaller index first, their triangles."""
    lattice = np.round(mesh.vertices_mm / _WELD_MM + _LATTICE_SHIFT)
    _, first, inverse = np.unique(
        lattice, axis=0, return_index=True, return_inverse=True
    )
    faces = inverse.reshape(-1)[mesh.faces]
    edges = np.sort(
        np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1
    )
    triangles = np.repeat(np.arange(len(faces)), 3)
    good = (mesh.areas_mm2[triangles] > 0) & (edges[:, 0] != edges[:, 1])
    return mesh.vertices_mm[first], edges[good], triangles[good]


def _joined(segments: FloatArray) -> FloatArray:
    """Union of the segments on each common straight line."""
    if not len(segments):
        return segments
    along = segments[:, 1] - segments[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    along *= _canonical_sign(along)[:, None]
    moment = np.cross(segments[:, 0], along)
    keys = np.column_stack([along / _DIRECTION_STEP, moment / _MOMENT_STEP_MM])
    _, first, group = np.unique(
        np.round(keys + _LATTICE_SHIFT), axis=0, return_index=True, return_inverse=True
    )
    group = group.reshape(-1)
    places = np.einsum("nkj,nj->nk", segments, along)
    start, end, owner = _interval_union(places.min(axis=1), places.max(axis=1), group)
    direction, foot = along[first], np.cross(along[first], moment[first])
    return np.stack(
        [
            foot[owner] + start[:, None] * direction[owner],
            foot[owner] + end[:, None] * direction[owner],
        ],
        axis=1,
    )


def _canonical_sign(vectors: FloatArray) -> FloatArray:
    leading = np.argmax(np.abs(vectors) > 1e-7, axis=1)
    return np.where(vectors[np.arange(len(vectors)), leading] < 0, -1.0, 1.0)


def _interval_union(
    start: FloatArray, end: FloatArray, group: IntArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Union of 1-D intervals within each group: starts, ends, groups."""
    order = np.lexsort((start, group))
    start, end, group = start[order], end[order], group[order]
    span = 2 * (np.abs(start).max() + np.abs(end).max()) + 1.0
    reach = np.maximum.accumulate(end + span * group)
    fresh = np.ones(len(start), dtype=bool)
    fresh[1:] = start[1:] + span * group[1:] > reach[:-1] + _WELD_MM
    heads = np.flatnonzero(fresh)
    tails = np.append(heads[1:], len(start)) - 1
    return start[heads], reach[tails] - span * group[heads], group[heads]
