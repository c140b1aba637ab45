"""Which triangles meet at which edge, and at what angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry.arrays import BoolArray, FloatArray, IntArray
    from mvp.geometry.mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """The undirected edges of a mesh, sorted by their vertex indices.

    Attributes:
        vertices: (k, 2) vertex indices. Where ``faces[:, 0]`` is a triangle the order
            is the one in which that triangle runs through the edge.
        faces: (k, 2) triangles left and right of the edge, -1 for none. An edge with
            more than two triangles, or two that run the same way, names two of them
            and is ``non_manifold``.
        angle_rad: (k,) angle between the two normals, > 0 convex, < 0 reflex, 0 where
            the edge has not exactly two consistently oriented triangles.
        boundary: (k,) exactly one triangle.
        non_manifold: (k,) more than two triangles, or two of opposite orientation.
    """

    vertices: IntArray
    faces: IntArray
    angle_rad: FloatArray
    boundary: BoolArray
    non_manifold: BoolArray

    @property
    def regular(self) -> BoolArray:
        """(k,) exactly two triangles that agree on inside and outside."""
        return np.asarray(~self.boundary & ~self.non_manifold)


def edge_table(mesh: TriangleMesh) -> EdgeTable:
    """Find all edges of a mesh whose triangles share vertex indices.

    Degenerate triangles (two equal indices) contribute no edge of length zero.
    """
    directed = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(mesh.faces)), 3)
    proper = directed[:, 0] != directed[:, 1]
    directed, owner = directed[proper], owner[proper]
    forward = directed[:, 0] < directed[:, 1]
    ordered = np.sort(directed, axis=1)
    key = ordered[:, 0] * np.int64(len(mesh.vertices_mm)) + ordered[:, 1]
    order = np.lexsort((~forward, key))
    key, forward, owner = key[order], forward[order], owner[order]
    directed = directed[order]
    first = np.flatnonzero(np.r_[True, key[1:] != key[:-1]]) if len(key) else key
    count = np.diff(np.r_[first, len(key)])
    second = np.minimum(first + 1, len(key) - 1)
    pair = (count == 2) & (forward[first] != forward[second])
    faces = np.stack([owner[first], np.where(count >= 2, owner[second], -1)], axis=1)
    vertices = directed[first]
    return EdgeTable(
        vertices,
        faces,
        np.where(pair, _signed_angle(mesh, vertices, faces), 0.0),
        np.asarray(count == 1),
        np.asarray((count > 2) | ((count == 2) & ~pair)),
    )


def _signed_angle(
    mesh: TriangleMesh, vertices: IntArray, faces: IntArray
) -> FloatArray:
    """Angle from the first to the second normal about the edge, > 0 convex."""
    ends = mesh.vertices_mm[vertices]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = along / np.where(length > 0, length, 1.0)
    normal_a, normal_b = mesh.normals[faces[:, 0]], mesh.normals[faces[:, 1]]
    sine = np.einsum("ij,ij->i", np.cross(normal_a, normal_b), along)
    cosine = np.einsum("ij,ij->i", normal_a, normal_b)
    return np.asarray(np.arctan2(sine, cosine))
