"""Conservative occluders for dense curved parts: hulls of gently bent groups."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from mvp.visibility.shadows import separation_mm

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray
    from mvp.visibility.polygons import ConvexPatches

_BEND_COS = np.cos(np.radians(25.0))
_KEEP_AWAY = 50.0


@dataclass(frozen=True, eq=False)
class ClusterRule:
    """How far a group of triangles may be from the hull that replaces it.

    Attributes:
        thickness_mm: spread of its vertices along the mean normal, and depth of the
            bays of its outline that the hull fills.
        feature_mm: (n, 3) the feature; groups close to it stay exact, because a shadow
            magnifies an error by distance over distance.
    """

    thickness_mm: float
    feature_mm: FloatArray

    def allows(self, points_mm: FloatArray, normal: FloatArray, area: float) -> bool:
        """Whether the hull of a group's vertices may replace it.

        Args:
            points_mm: (n, 3) vertices of the group.
            normal: (3,) sum of the normals, weighted by area.
            area: area of the group projected along the normal, mm^2.
        """
        axis = normal / max(float(np.linalg.norm(normal)), 1e-300)
        if separation_mm(points_mm, self.feature_mm) <= 0:
            return False
        if np.ptp(points_mm @ axis) > self.thickness_mm:
            return False
        hull_area, outline = _outline(points_mm, axis)
        return hull_area - area <= self.thickness_mm * outline / 2

    def far_enough(self, points_mm: FloatArray) -> bool:
        """Whether a group keeps away from the feature."""
        middle = self.feature_mm.mean(axis=0)
        radius = np.linalg.norm(self.feature_mm - middle, axis=1).max()
        distance = np.linalg.norm(points_mm - middle, axis=1).min()
        return bool(distance > 2 * radius + _KEEP_AWAY * self.thickness_mm)


def _outline(points: FloatArray, axis: FloatArray) -> tuple[float, float]:
    """Area, mm^2, and length, mm, of the hull of points seen along an axis."""
    side = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    side /= np.linalg.norm(side)
    flat = points @ np.stack([side, np.cross(axis, side)], axis=1)
    try:
        hull = ConvexHull(flat)
    except QhullError:
        return 0.0, 0.0
    return float(hull.volume), float(hull.area)


@dataclass
class _Group:
    """Vertices of some polygons and the sum of their area vectors."""

    vertices: set[int]
    area_vector: FloatArray


def clustered(
    vertices_mm: FloatArray,
    patches: ConvexPatches,
    normals: FloatArray,
    edge_faces: IntArray,
    rule: ClusterRule,
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Polygons that stay, and point sets whose hulls replace the others.

    Neighbours are joined over the flattest edges first.
    """
    groups = [_group(vertices_mm, loop) for loop in patches.loops]
    allowed = [rule.far_enough(vertices_mm[list(g.vertices)]) for g in groups]
    parent = list(range(len(groups)))
    a, b = edge_faces[:, 0], edge_faces[:, 1]
    cosine = np.einsum("ij,ij->i", normals[a], normals[b])
    pairs = patches.polygon_of[edge_faces]
    use = (cosine > _BEND_COS) & (pairs[:, 0] != pairs[:, 1])
    order = np.flatnonzero(use)[np.argsort(-cosine[use], kind="stable")]
    joined: set[int] = set()
    for left, right in pairs[order].tolist():
        i, j = _root(parent, left), _root(parent, right)
        if i == j or not (allowed[i] and allowed[j]):
            continue
        both = groups[i].vertices | groups[j].vertices
        vector = groups[i].area_vector + groups[j].area_vector
        area = float(np.linalg.norm(vector))
        if rule.allows(vertices_mm[sorted(both)], vector, area):
            groups[i], parent[j] = _Group(both, vector), i
            joined.add(i)
    roots = [i for i in range(len(groups)) if parent[i] == i]
    alone = [vertices_mm[patches.loops[i]] for i in roots if i not in joined]
    hulls = [vertices_mm[sorted(groups[i].vertices)] for i in roots if i in joined]
    return alone, hulls


def _group(vertices_mm: FloatArray, loop: IntArray) -> _Group:
    corners = vertices_mm[loop]
    vector = np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0]).sum(axis=0)
    return _Group(set(loop.tolist()), vector / 2)


def _root(parent: list[int], item: int) -> int:
    while parent[item] != item:
        parent[item] = parent[parent[item]]
        item = parent[item]
    return item
