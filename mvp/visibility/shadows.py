"""The occluded solid of one convex occluder and one convex feature.

With occluder P and feature F it is { p + t (p - q) : p in P, q in F, t >= 0 }, which is
P + cone(P - F), always convex. One hull of P and its copies pushed away from every
vertex of F is enough once the push reaches past the workspace.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from manifold3d import Error, Manifold, Mesh64
from scipy.spatial import ConvexHull, QhullError

if TYPE_CHECKING:
    from mvp.geometry import Box, FloatArray

# A hull of points p is good to 1e-7 max |p|, so the far points must stay near.
_NEAR_SCALE = 5.0
_MOST_POINTS = 256
# Beyond this scale even the careful hull would lose digits.
_LONGEST_PUSH = 2e3
_TOUCHING = 1e-10


@dataclass(frozen=True, eq=False)
class Caster:
    """Casts the shadows of convex polygons behind one feature piece.

    Attributes:
        feature_mm: (n, 3) vertices of the convex feature.
        box: the workspace and the feature: what shadows must fill.
        reach_mm: longest distance from an occluder to a point of the workspace, mm.
    """

    feature_mm: FloatArray
    box: Box
    reach_mm: float

    def shadow(self, occluder_mm: FloatArray) -> Manifold:
        """Occluded solid of a convex polygon (k, 3); exact inside the workspace."""
        away = occluder_mm[:, None] - self.feature_mm[None]
        length = np.linalg.norm(away, axis=2)
        longest = float(length.max())
        axis = away.reshape(-1, 3).mean(axis=0)
        axis /= max(float(np.linalg.norm(axis)), 1e-300)
        along = away @ axis
        if along.min() * _NEAR_SCALE > longest:
            push = 1.01 * self.reach_mm / float(along.min())
            return self._hull(_pushed(occluder_mm, away, push))
        rays = (away / np.maximum(length, 1e-300)[..., None])[length > 0]
        opening = float((rays @ axis).min(initial=1.0))
        few = len(occluder_mm) * (len(rays) + 1) <= _MOST_POINTS
        if few and opening * _NEAR_SCALE > 1:
            far = 1.01 * self.reach_mm / opening * rays
            points = np.concatenate([np.zeros((1, 3)), far]) + occluder_mm[:, None]
            return self._hull(points.reshape(-1, 3))
        push = self._push(occluder_mm, longest)
        solid = None
        if push * longest <= _LONGEST_PUSH * self.reach_mm:
            solid = careful_hull(_pushed(occluder_mm, away, push))
        return self._by_planes(occluder_mm) if solid is None else solid

    def _hull(self, points_mm: FloatArray) -> Manifold:
        """Hull, in coordinates about the workspace's middle to keep digits."""
        centre = self.box.centre_mm
        return Manifold.hull_points(points_mm - centre).translate(tuple(centre))

    def shadow_of_hull(self, points_mm: FloatArray) -> Manifold:
        """Occluded solid of the hull of points (k, 3) that keeps off the feature.

        Raises:
            ValueError: no plane across the line of middles separates the two.
        """
        gap = separation_mm(points_mm, self.feature_mm)
        if gap <= 0:
            raise ValueError("the hull is not separated from the feature")
        away = points_mm[:, None] - self.feature_mm[None]
        push = 1.01 * self.reach_mm / gap
        if gap * _NEAR_SCALE > np.linalg.norm(away, axis=2).max():
            return self._hull(_pushed(points_mm, away, push))
        solid = careful_hull(_pushed(points_mm, away, push))
        return self._hull(_pushed(points_mm, away, push)) if solid is None else solid

    def _push(self, occluder_mm: FloatArray, longest_mm: float) -> float:
        """Multiple of p - q that passes the workspace.

        The outermost multiple of a direction u inside P - F is where u leaves it, at
        one of its faces that do not contain the origin; no face is nearer to the origin
        than its plane, so reach over the nearest such plane suffices.
        """
        away = (occluder_mm[:, None] - self.feature_mm[None]).reshape(-1, 3)
        normals = _difference_normals(occluder_mm, self.feature_mm)
        heights = away @ normals.T
        offsets = np.concatenate([heights.max(axis=0), -heights.min(axis=0)])
        offsets = offsets[offsets > _TOUCHING * max(longest_mm, 1e-300)]
        nearest = float(offsets.min(initial=longest_mm))
        return 1.01 * self.reach_mm / max(nearest, 1e-300)

    def _by_planes(self, occluder_mm: FloatArray) -> Manifold:
        """The same solid as a box cut by the planes that support P + cone(P - F).

        Where P is almost coplanar with F the hull would need points very far away.
        """
        solid = Manifold.cube(tuple(1.02 * self.box.size_mm))
        solid = solid.translate(tuple(self.box.low_mm - 0.01 * self.box.size_mm))
        away = (occluder_mm[:, None] - self.feature_mm[None]).reshape(-1, 3)
        normals = _supporting_normals(occluder_mm, self.feature_mm, away)
        for normal, offset in zip(
            normals, (occluder_mm @ normals.T).min(axis=0), strict=True
        ):
            if solid.is_empty():
                break  # trimming nothing would give an invalid solid
            solid = solid.trim_by_plane(tuple(normal), float(offset))
        return solid


def _pushed(occluder: FloatArray, away: FloatArray, push: float) -> FloatArray:
    """The occluder's vertices (k, 3) and their copies pushed along away (k, n, 3)."""
    far = occluder[:, None] + push * away
    return np.concatenate([occluder, far.reshape(-1, 3)])


def careful_hull(points_mm: FloatArray) -> Manifold | None:
    """Hull that keeps double precision even where points lie far apart.

    None where that fails, as it does for flat input.
    """
    try:
        hull = ConvexHull(points_mm)
    except QhullError:
        return None
    faces = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(points_mm[faces], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    used, index = np.unique(faces, return_inverse=True)
    triangles = index.reshape(-1, 3).astype(np.uint64)
    solid = Manifold(Mesh64(np.ascontiguousarray(points_mm[used]), triangles))
    return solid if solid.status() == Error.NoError else None


def separation_mm(points_mm: FloatArray, feature_mm: FloatArray) -> float:
    """Lower bound of the distance between the hulls of two point sets, mm."""
    axis = points_mm.mean(axis=0) - feature_mm.mean(axis=0)
    axis /= max(float(np.linalg.norm(axis)), 1e-300)
    return float((points_mm @ axis).min() - (feature_mm @ axis).max())


def _supporting_normals(
    occluder: FloatArray, feature: FloatArray, away: FloatArray
) -> FloatArray:
    """Distinct unit normals of the planes that bound P + cone(P - F), pointing in.

    Its faces are P's own plane and the planes spanned by an edge of P or F and a ray
    of the cone, that is a row of ``away`` (k, 3).
    """
    edges = np.roll(occluder, -1, axis=0) - occluder
    spans = [np.cross(edges[0], edges[1:-1])] if len(occluder) > 2 else []
    if len(feature) > 1:
        edges = np.concatenate([edges, np.roll(feature, -1, axis=0) - feature])
    spans.append(np.cross(edges[:, None], away[None]).reshape(-1, 3))
    normals = np.concatenate(spans)
    length = np.linalg.norm(normals, axis=1)
    longest = float(np.linalg.norm(away, axis=1).max())
    normals = normals[length > _TOUCHING * longest**2]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.concatenate([normals, -normals])
    normals = normals[(normals @ away.T).min(axis=1) >= -_TOUCHING * longest]
    first = np.unique(np.round(normals, 9), axis=0, return_index=True)[1]
    return np.asarray(normals[first])


def _difference_normals(occluder: FloatArray, feature: FloatArray) -> FloatArray:
    """Unit normals of all planes that can bound the Minkowski difference P - F."""
    edges_p = np.roll(occluder, -1, axis=0) - occluder
    sides = [np.cross(edges_p[0], edges_p[1:-1])] if len(occluder) > 2 else []
    if len(feature) > 1:
        edges_f = np.roll(feature, -1, axis=0) - feature
        edges_f = edges_f[:1] if len(feature) == 2 else edges_f
        sides.append(np.cross(edges_p[:, None], edges_f[None]).reshape(-1, 3))
        if len(feature) > 2:
            sides.append(np.cross(edges_f[:1], edges_f[1:2]))
    normals = np.concatenate(sides)
    length = np.linalg.norm(normals, axis=1)
    scale = np.abs(edges_p).max() * max(np.abs(edges_p).max(), np.ptp(feature))
    keep = length > 1e-12 * scale
    return np.asarray(normals[keep] / length[keep, None])
