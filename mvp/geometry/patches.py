"""Planar patches of a mesh, and a name for every CAD face it does not name itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry.edges import EdgeTable, edge_table

if TYPE_CHECKING:
    from mvp.geometry.arrays import BoolArray, FloatArray, IntArray
    from mvp.geometry.mesh import TriangleMesh

# Triangles belong to one plane when normals and corners agree this well.
_COPLANAR_RAD = np.deg2rad(0.05)
_COPLANAR_MM = 1e-3
# Facets of a tessellated curved face meet at up to about this angle.
_SMOOTH_RAD = np.deg2rad(32.0)


def connected_labels(pairs: IntArray, count: int) -> IntArray:
    """Label (count,) of the connected component of each node, from pairs (p, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])),
        shape=(count, count),
    )
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def planar_patches(mesh: TriangleMesh, table: EdgeTable | None = None) -> IntArray:
    """Label (m,) of the connected coplanar patch that each triangle is part of.

    Where connected flat triangles creep out of one plane (a finely tessellated
    cylinder) the patch is grown again from its largest triangle, corner by corner.
    """
    table = table or edge_table(mesh)
    flat = table.regular & (np.abs(table.angle_rad) < _COPLANAR_RAD)
    pairs = table.faces[flat]
    label = connected_labels(pairs, len(mesh.faces))
    bent = _bent(mesh, label)
    if bent.any():
        label = _grown(mesh, pairs[bent[pairs[:, 0]]], label, bent)
    return np.asarray(np.unique(label, return_inverse=True)[1], dtype=np.int64)


def face_groups(mesh: TriangleMesh) -> IntArray:
    """Label (m,) that joins planar patches, and facets of curved surfaces, to faces.

    A patch of at most two triangles that meets another such patch at a small angle is
    taken for a facet of a curved face.
    """
    table = edge_table(mesh)
    label = planar_patches(mesh, table)
    size = np.bincount(label)
    pair = label[np.maximum(table.faces, 0)]
    smooth = table.regular & (np.abs(table.angle_rad) < _SMOOTH_RAD)
    smooth &= (size[pair] <= 2).all(axis=1)
    return connected_labels(pair[smooth], len(size))[label]


def _bent(mesh: TriangleMesh, label: IntArray) -> BoolArray:
    """Which triangles (m,) are in a patch that leaves the plane of its largest one."""
    order = np.lexsort((-mesh.areas_mm2, label))
    first = np.r_[True, np.diff(label[order]) > 0] if len(order) else order > 0
    seed = order[first][label]
    height = _height(mesh, np.arange(len(label)), seed)
    bent_label = np.zeros(len(seed), dtype=bool)
    bent_label[label[height > _COPLANAR_MM]] = True
    return np.asarray(bent_label[label])


def _height(mesh: TriangleMesh, triangles: IntArray, seeds: IntArray) -> FloatArray:
    """How far corners of triangles are from the planes of their seeds, mm."""
    offset = mesh.triangles_mm[triangles] - mesh.triangles_mm[seeds][:, :1]
    return np.asarray(
        np.abs(np.einsum("nij,nj->ni", offset, mesh.normals[seeds])).max(axis=1)
    )


def _grown(
    mesh: TriangleMesh, pairs: IntArray, label: IntArray, bent: BoolArray
) -> IntArray:
    """Labels in which the bent patches are grown again plane by plane."""
    both = np.vstack([pairs, pairs[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    start = np.searchsorted(both[:, 0], np.arange(len(label) + 1))
    label = np.where(bent, -1, label)
    fresh = int(label.max(initial=-1)) + 1
    members = np.flatnonzero(bent)
    for seed in members[np.argsort(-mesh.areas_mm2[members], kind="stable")]:
        if label[seed] >= 0:
            continue
        label[seed] = fresh
        stack = [int(seed)]
        while stack:
            here = stack.pop()
            there = both[start[here] : start[here + 1], 1]
            there = there[label[there] < 0]
            there = there[
                _height(mesh, there, np.full(len(there), seed)) <= _COPLANAR_MM
            ]
            label[there] = fresh
            stack += there.tolist()
        fresh += 1
    return label
