"""Greedy merging of coplanar triangles into convex polygons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray

_FLAT_COS = 1.0 - 5e-11
_CONVEX_SINE = 1e-9


@dataclass(frozen=True, eq=False)
class ConvexPatches:
    """Convex polygons that cover a set of triangles exactly.

    Attributes:
        loops: one array of vertex indices per polygon, in order.
        polygon_of: (m,) polygon of every triangle.
    """

    loops: tuple[IntArray, ...]
    polygon_of: IntArray


def convex_patches(
    vertices_mm: FloatArray,
    faces: IntArray,
    normals: FloatArray,
    edge_vertices: IntArray,
    edge_faces: IntArray,
) -> ConvexPatches:
    """Merge coplanar neighbours, longest shared edge first, while convex.

    Args:
        vertices_mm: (n, 3).
        faces: (m, 3) indices of vertices.
        normals: (m, 3) unit normals.
        edge_vertices: (e, 2) shared edges, along the first of their two faces.
        edge_faces: (e, 2) those faces.
    """
    cosine = np.einsum("ij,ij->i", normals[edge_faces[:, 0]], normals[edge_faces[:, 1]])
    flat = np.flatnonzero(cosine > _FLAT_COS)
    ends = vertices_mm[edge_vertices[flat]]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    order = flat[np.argsort(-length, kind="stable")]
    merger = _Merger(vertices_mm, faces, normals)
    for (a, b), (left, right) in zip(
        edge_vertices[order].tolist(), edge_faces[order].tolist(), strict=True
    ):
        merger.merge(a, b, left, right)
    return merger.patches()


class _Merger:
    """Union-find over polygons; plain lists, as every merge touches few vertices."""

    def __init__(
        self, vertices_mm: FloatArray, faces: IntArray, normals: FloatArray
    ) -> None:
        self._points = vertices_mm.tolist()
        self._loops: list[list[int]] = faces.tolist()
        self._normals = normals.tolist()
        self._parent = list(range(len(faces)))

    def find(self, face: int) -> int:
        """Polygon that a triangle is now part of."""
        parent = self._parent
        while parent[face] != face:
            parent[face] = parent[parent[face]]
            face = parent[face]
        return face

    def merge(self, a: int, b: int, left: int, right: int) -> None:
        """Join the polygons on both sides of the edge a -> b if the result is convex."""
        left, right = self.find(left), self.find(right)
        if left == right:
            return
        joined = _joined(self._loops[left], self._loops[right], a, b)
        if len(set(joined)) != len(joined) or not self._convex(joined, left):
            return
        self._loops[left] = joined
        self._parent[right] = left

    def _convex(self, loop: list[int], face: int) -> bool:
        """Whether the loop turns left at every corner, seen against its normal."""
        nx, ny, nz = self._normals[face]
        corners = [self._points[i] for i in loop]
        before = corners[-2:] + corners[:-2]
        middle = corners[-1:] + corners[:-1]
        for p, q, r in zip(before, middle, corners, strict=True):
            ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
            vx, vy, vz = r[0] - q[0], r[1] - q[1], r[2] - q[2]
            turn = (
                nx * (uy * vz - uz * vy)
                + ny * (uz * vx - ux * vz)
                + nz * (ux * vy - uy * vx)
            )
            size = (ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz)
            if turn < 0 and turn * turn > _CONVEX_SINE * _CONVEX_SINE * size:
                return False
        return True

    def patches(self) -> ConvexPatches:
        """The polygons that are left."""
        roots = [self.find(face) for face in range(len(self._parent))]
        used, polygon_of = np.unique(roots, return_inverse=True)
        loops = tuple(np.array(self._loops[root]) for root in used.tolist())
        return ConvexPatches(loops, np.asarray(polygon_of, dtype=np.int64).reshape(-1))


def _joined(left: list[int], right: list[int], a: int, b: int) -> list[int]:
    """Loop around both polygons; ``left`` runs a -> b, ``right`` runs b -> a."""
    i, j = left.index(b), right.index(a)
    joined = left[i:] + left[:i] + (right[j:] + right[:j])[1:-1]
    return _without_spikes(joined)


def _without_spikes(loop: list[int]) -> list[int]:
    """Remove x, y, x detours, left where the polygons share more than one edge."""
    at = 0
    while at < len(loop) and len(loop) > 3:
        if loop[at - 2] == loop[at]:
            del loop[at - 1]
            del loop[(at - 1) % len(loop)]
            at = 0
        else:
            at += 1
    return loop
