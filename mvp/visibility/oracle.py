"""Independent exact test of single view points, in double precision.

A view point x sees a convex piece F whole if and only if no triangle meets the open
pyramid between x and F. A triangle that does so has an edge through a side of the
pyramid, or a corner inside it, or lets a side edge of the pyramid pass through it.
Nothing here knows of hulls, solids, silhouettes or single-precision rays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mvp.geometry import (
    BoolArray,
    FeaturePiece,
    FloatArray,
    IntArray,
    TriangleMesh,
    as_points,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from mvp.visibility.occluders import Occluders

Hits: TypeAlias = Iterator[tuple[IntArray, IntArray]]
"""Rows of view points (k,) and the corners (k, 1 to 3) of what is in their way."""
PyramidTest: TypeAlias = Callable[[FloatArray], Hits]

_STRICT = 1e-9
# Heights below this share of the scene's size are rounding: touching, not crossing.
_TOUCHING = 1e-10
# Heights that single precision in a CAD file gives to points of a plane.
_ROUNDING = 1e-7
_PAIRS_AT_ONCE = 1 << 21


def exactly_visible(
    scene: Occluders | TriangleMesh,
    pieces: Sequence[FeaturePiece],
    points_mm: ArrayLike,
) -> BoolArray:
    """Which view points (N, 3) see every piece whole; grazing does not hide.

    Args:
        scene: what can hide the feature, solids or soup.
        pieces: convex pieces with their own faces.
        points_mm: view points, same frame.
    """
    points = as_points(points_mm).reshape(-1, 3)
    triangles = np.asarray(scene.triangles_mm)
    soup = Soup.of(triangles)
    visible = np.ones(len(points), dtype=np.bool_)
    for piece in pieces:
        rows = np.flatnonzero(visible)
        visible[rows] = _sees(soup.before(piece), piece, points[rows])
    return visible


@dataclass(frozen=True, eq=False)
class Soup:
    """Triangles (m, 3, 3), also as indices (m, 3) of corners (v, 3), and edges (e, 2).

    A plane that passes a corner at ``touching_mm`` or less touches it.
    """

    triangles: FloatArray
    corners: FloatArray
    faces: IntArray
    edges: IntArray
    touching_mm: float

    @classmethod
    def of(cls, triangles: FloatArray) -> Soup:
        """Of triangles (m, 3, 3)."""
        corners, index = np.unique(
            triangles.reshape(-1, 3), axis=0, return_inverse=True
        )
        faces = index.reshape(-1, 3)
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        touching = _TOUCHING * float(np.abs(corners).max(initial=0.0))
        return cls(triangles, corners, faces, np.unique(edges, axis=0), touching)

    def before(self, piece: FeaturePiece) -> Soup:
        """Without the triangles that no line of sight to a piece can meet."""
        behind = self.behind(piece)
        return Soup.of(self.triangles[~behind]) if behind.any() else self

    def behind(self, piece: FeaturePiece) -> BoolArray:
        """Triangles (m,) behind the planes of a piece, which sight lines stay before.

        In a face that is plane but for rounding some rise a little above it: without
        this the face would hide itself.
        """
        if not len(piece.planes):
            return np.zeros(len(self.faces), dtype=np.bool_)
        slack = _ROUNDING * float(np.abs(self.corners).max(initial=0.0))
        heights = self.corners @ piece.planes[:, :3].T - piece.planes[:, 3]
        low = np.asarray(heights <= slack, dtype=np.bool_)
        behind: BoolArray = np.asarray(low[self.faces].all(axis=1))
        return np.asarray(
            behind.all(axis=1) if piece.facing == "any" else behind.any(axis=1)
        )


def _sees(soup: Soup, piece: FeaturePiece, points: FloatArray) -> BoolArray:
    """Apply the tests one after the other to the view points that are left."""
    visible = ~behind_own_faces(piece, points)
    for test in pyramid_tests(soup, piece.vertices_mm):
        left = np.flatnonzero(visible)
        for rows, _ in test(points[left]):
            visible[left[rows]] = False
    if len(piece.vertices_mm) > 2:
        visible &= not len(mouth_edges(soup, piece.vertices_mm))
    return visible


def pyramid_tests(soup: Soup, vertices: FloatArray) -> list[PyramidTest]:
    """Tests that find every triangle which meets an open pyramid over a piece."""
    middle = vertices.mean(axis=0, keepdims=True)
    ends = vertices if len(vertices) == 1 else np.concatenate([middle, vertices])
    tests: list[PyramidTest] = [partial(_segment_hits, soup, end=end) for end in ends]
    tests += [partial(_side_hits, soup, a=a, b=b) for a, b in _sides(vertices)]
    if len(vertices) > 2:
        tests.append(partial(_corner_hits, soup, polygon=vertices))
    return tests


def _sides(vertices: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """The sides of a segment (1) or polygon (n)."""
    if len(vertices) < 2:
        return []
    count = 1 if len(vertices) == 2 else len(vertices)
    return [(vertices[i], vertices[(i + 1) % len(vertices)]) for i in range(count)]


def behind_own_faces(piece: FeaturePiece, points: FloatArray) -> BoolArray:
    """View points that face too few of the feature's own planes."""
    if not len(piece.planes):
        return np.zeros(len(points), dtype=np.bool_)
    faced = points @ piece.planes[:, :3].T > piece.planes[:, 3]
    return np.asarray(~(faced.any(1) if piece.facing == "any" else faced.all(1)))


def _blocks(points: FloatArray, columns: int) -> list[slice]:
    step = max(1, _PAIRS_AT_ONCE // max(1, columns))
    return [slice(i, i + step) for i in range(0, len(points), step)]


def _segment_hits(soup: Soup, points: FloatArray, end: FloatArray) -> Hits:
    """Points (n, 3) whose segment to ``end`` passes strictly through a triangle."""
    a = soup.triangles[:, 0]
    ab, ac = soup.triangles[:, 1] - a, soup.triangles[:, 2] - a
    normal = np.cross(ab, ac)
    touching = soup.touching_mm * np.linalg.norm(normal, axis=1)
    at_end = np.einsum("md,md->m", end - a, normal)
    at_end[np.abs(at_end) <= touching] = 0.0
    offset = np.einsum("md,md->m", a, normal)
    for block in _blocks(points, len(a)):
        some = points[block]
        height = some @ normal.T - offset
        rows, columns = np.nonzero(height * at_end < 0)
        before, after = height[rows, columns], at_end[columns]
        share = before / (before - after)
        hit = some[rows] + share[:, None] * (end - some[rows])
        inner = _strictly_inside(hit - a[columns], ab[columns], ac[columns])
        inner &= (share > _STRICT) & (share < 1 - _STRICT)
        yield block.start + rows[inner], soup.faces[columns[inner]]


def _strictly_inside(p: FloatArray, u: FloatArray, v: FloatArray) -> BoolArray:
    """Whether in-plane vectors p (k, 3) from a corner lie inside triangle (u, v)."""
    uu, vv, uv = _dot(u, u), _dot(v, v), _dot(u, v)
    pu, pv = _dot(p, u), _dot(p, v)
    area = uu * vv - uv * uv
    s, t = vv * pu - uv * pv, uu * pv - uv * pu
    limit = _STRICT * area
    return np.asarray((s > limit) & (t > limit) & (area - s - t > limit))


def _side_hits(soup: Soup, points: FloatArray, a: FloatArray, b: FloatArray) -> Hits:
    """Points x whose triangle x a b is crossed strictly inside by a mesh edge."""
    first, second = soup.edges[:, 0], soup.edges[:, 1]
    for block in _blocks(points, len(soup.edges)):
        x = points[block]
        normal = np.cross(a - x, b - x)
        height = normal @ (soup.corners - a).T
        touching = soup.touching_mm * np.linalg.norm(normal, axis=1)
        height[np.abs(height) <= touching[:, None]] = 0.0
        start, stop = height[:, first], height[:, second]
        rows, columns = np.nonzero(start * stop < 0)
        before, after = start[rows, columns], stop[rows, columns]
        p, q = soup.corners[first[columns]], soup.corners[second[columns]]
        hit = p + (before / (before - after))[:, None] * (q - p)
        inner = _strictly_inside(hit - x[rows], (a - x)[rows], (b - x)[rows])
        yield block.start + rows[inner], soup.edges[columns[inner]]


def _corner_hits(soup: Soup, points: FloatArray, polygon: FloatArray) -> Hits:
    """Points whose pyramid over a convex polygon holds a mesh corner inside."""
    middle = polygon.mean(axis=0)
    base = _area_vector(polygon)
    over = (soup.corners - middle) @ base
    for block in _blocks(points, len(soup.corners)):
        x = points[block]
        side = np.sign((x - middle) @ base)[:, None]
        inside = side * over > _STRICT * np.linalg.norm(base) ** 1.5
        for a, b in _sides(polygon):
            normal = np.cross(a - x, b - x)
            depth = normal @ (soup.corners - a).T
            inward = (normal @ (middle - a))[:, None]
            inside &= depth * np.sign(inward) > _STRICT * np.abs(inward)
        rows, corners = np.nonzero(inside)
        yield block.start + rows, corners[:, None]


def mouth_edges(soup: Soup, polygon: FloatArray) -> IntArray:
    """Mesh edges (k, 2) that pass strictly through the polygon itself."""
    if not len(soup.edges):
        return soup.edges
    middle, normal = polygon.mean(axis=0), _area_vector(polygon)
    height = (soup.corners - middle) @ normal
    flat = 1e-7 * np.linalg.norm(normal) * np.ptp(soup.corners, axis=0).max()
    height = np.where(np.abs(height) < flat, 0.0, height)
    start, stop = height[soup.edges[:, 0]], height[soup.edges[:, 1]]
    through = start * stop < 0
    p, q = soup.corners[soup.edges[through, 0]], soup.corners[soup.edges[through, 1]]
    share = start[through] / (start[through] - stop[through])
    hit = p + share[:, None] * (q - p)
    inside = np.ones(len(hit), dtype=np.bool_)
    for a, b in _sides(polygon):
        depth = (hit - a) @ np.cross(normal, b - a)
        inside &= depth > _STRICT * np.abs((middle - a) @ np.cross(normal, b - a))
    return np.asarray(soup.edges[through][inside])


def _area_vector(polygon: FloatArray) -> FloatArray:
    """Normal of a planar polygon, scaled to its area, mm^2."""
    fan = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0])
    return np.asarray(fan.sum(axis=0) / 2)


def _dot(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("kd,kd->k", u, v))
