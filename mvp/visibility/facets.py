"""Distances from view points to the convex facets of a region's boundary."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray

_CELLS_AT_ONCE = 1 << 17


@dataclass(frozen=True, eq=False)
class FacetDistances:
    """The k nearest facets of every view point, nearest first.

    Attributes:
        distance_mm: (N, k) unsigned distance; where fewer facets exist, the diagonal
            of the workspace.
        direction: (N, k, 3) unit vector from the closest point of the facet to the view
            point; zero where fewer facets exist.
        facet: (N, k) index of the facet, -1 where fewer exist.
    """

    distance_mm: FloatArray
    direction: FloatArray
    facet: IntArray

    @property
    def distance(self) -> FloatArray:
        """Alias of ``distance_mm``."""
        return self.distance_mm


@dataclass(frozen=True, eq=False)
class FacetSet:
    """Triangles grouped into facets, made for nearest-facet queries.

    Attributes:
        triangles_mm: (m, 3, 3).
        facet_of: (m,) facet of every triangle.
        inward: (m, 3) unit normal towards the region; what the direction is where a
            view point lies on a facet.
    """

    triangles_mm: FloatArray
    facet_of: IntArray
    inward: FloatArray

    @cached_property
    def _frames(self) -> _Frames:
        return _Frames.of(self.triangles_mm)

    @cached_property
    def _groups(self) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Triangles in order of their facets; start, size and name of each facet."""
        order = np.argsort(self.facet_of, kind="stable")
        names, starts, sizes = np.unique(
            self.facet_of[order], return_index=True, return_counts=True
        )
        return order, starts, sizes, names

    def nearest(self, points_mm: FloatArray, k: int, far_mm: float) -> FacetDistances:
        """The k nearest facets of points (N, 3); missing ones at ``far_mm``."""
        n = len(points_mm)
        result = FacetDistances(
            np.full((n, k), far_mm),
            np.zeros((n, k, 3)),
            np.full((n, k), -1, dtype=np.int64),
        )
        step = max(1, _CELLS_AT_ONCE // max(1, len(self.triangles_mm)))
        for start in range(0, n if len(self.triangles_mm) else 0, step):
            some = slice(start, min(start + step, n))
            self._nearest_block(points_mm[some], k, result, some)
        return result

    def _nearest_block(
        self, points: FloatArray, k: int, result: FacetDistances, into: slice
    ) -> None:
        """Fill one block of rows."""
        order, starts, _, names = self._groups
        squared = self._frames.squared_distances(points)[:, order]
        best = np.minimum.reduceat(squared, starts, axis=1)
        count = min(k, best.shape[1])
        chosen = np.argpartition(best, count - 1, axis=1)[:, :count]
        rank = np.argsort(np.take_along_axis(best, chosen, axis=1), axis=1)
        chosen = np.take_along_axis(chosen, rank, axis=1)
        triangle = order[self._closest_members(squared, chosen)]
        towards = from_closest(
            np.repeat(points, count, axis=0), self.triangles_mm[triangle]
        )
        distance = np.sqrt(_dot(towards, towards))
        shape = chosen.shape
        result.distance_mm[into, :count] = distance.reshape(shape)
        result.facet[into, :count] = names[chosen]
        result.direction[into, :count] = _directions(
            towards, distance, self.inward[triangle]
        ).reshape(*shape, 3)

    def _closest_members(self, squared: FloatArray, chosen: IntArray) -> IntArray:
        """The closest triangle (N k,), in facet order, of each chosen facet (N, k)."""
        _, starts, sizes, _ = self._groups
        first, size = starts[chosen].reshape(-1), sizes[chosen].reshape(-1)
        pair = np.repeat(np.arange(len(first)), size)
        begin = np.cumsum(size) - size
        member = first[pair] + np.arange(len(pair)) - begin[pair]
        values = squared[pair // chosen.shape[1], member]
        order = np.lexsort((values, pair))
        return np.asarray(member[order[begin]])


@dataclass(frozen=True, eq=False)
class _Frames:
    """Planes of triangles, and of each side the line and the way across it.

    Attributes:
        normal: (3, m) unit normals.
        height: (m,) plane offsets.
        along: (3, 3, m) unit vector of side s, as columns.
        along_start: (3, m) where side s begins on it.
        length: (3, m) of side s.
        across: (3, 3, m) unit vector in the plane, pointing inward over side s.
        across_start: (3, m) where side s lies on it.
    """

    normal: FloatArray
    height: FloatArray
    along: FloatArray
    along_start: FloatArray
    length: FloatArray
    across: FloatArray
    across_start: FloatArray

    @classmethod
    def of(cls, triangles: FloatArray) -> _Frames:
        """Frames of triangles (m, 3, 3); degenerate ones become segments."""
        sides = np.roll(triangles, -1, axis=1) - triangles
        length = np.linalg.norm(sides, axis=2)
        rows = np.arange(len(triangles))
        longest = length.argmax(axis=1)
        axis = _normalised(sides[rows, longest], np.array([1.0, 0.0, 0.0]))
        other = np.eye(3)[np.abs(axis).argmin(axis=1)]
        fallback = _normalised(np.cross(axis, other), other)
        normal = _normalised(np.cross(axis, sides[rows, (longest + 1) % 3]), fallback)
        along = _normalised(sides.reshape(-1, 3), np.repeat(axis, 3, axis=0)).reshape(
            sides.shape
        )
        across = np.cross(normal[:, None], along)
        return cls(
            np.ascontiguousarray(normal.T),
            np.einsum("md,md->m", normal, triangles[:, 0]),
            np.ascontiguousarray(along.transpose(1, 2, 0)),
            np.einsum("msd,msd->sm", along, triangles),
            np.ascontiguousarray(length.T),
            np.ascontiguousarray(across.transpose(1, 2, 0)),
            np.einsum("msd,msd->sm", across, triangles),
        )

    def squared_distances(self, points: FloatArray) -> FloatArray:
        """Squared distance (n, m) of points (n, 3) to all triangles, mm^2."""
        outline = np.full((len(points), len(self.height)), np.inf)
        outside = np.zeros(outline.shape, dtype=np.bool_)
        for side in range(3):
            over = points @ self.along[side]
            over -= self.along_start[side]
            over -= np.clip(over, 0.0, self.length[side])
            aside = points @ self.across[side]
            aside -= self.across_start[side]
            outside |= aside < 0
            over *= over
            aside *= aside
            over += aside
            np.minimum(outline, over, out=outline)
        outline[~outside] = 0.0
        height = points @ self.normal
        height -= self.height
        height *= height
        outline += height
        return outline


def _normalised(vectors: FloatArray, fallback: FloatArray) -> FloatArray:
    """Unit vectors (m, 3), the fallback where there is no length."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-300), fallback)


def _directions(
    towards: FloatArray, distance: FloatArray, inward: FloatArray
) -> FloatArray:
    """Unit vectors; the facet's normal where the distance vanishes."""
    scale = np.where(distance > 0, distance, 1.0)[:, None]
    return np.where(distance[:, None] > 1e-9, towards / scale, inward)


def from_closest(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Vectors (p, 3) from the closest point of each triangle (p, 3, 3) to its point."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    ab, ac, ap = b - a, c - a, points - a
    d1, d2 = _dot(ab, ap), _dot(ac, ap)
    aa, bb, ab_ac = _dot(ab, ab), _dot(ac, ac), _dot(ab, ac)
    area = aa * bb - ab_ac * ab_ac
    safe = np.where(area > 0, area, 1.0)
    v, w = (bb * d1 - ab_ac * d2) / safe, (aa * d2 - ab_ac * d1) / safe
    inner = (v >= 0) & (w >= 0) & (v + w <= 1) & (area > 1e-24 * aa * bb)
    result = ap - v[:, None] * ab - w[:, None] * ac
    outer = np.flatnonzero(~inner)
    result[outer] = _from_outline(points[outer], a[outer], b[outer], c[outer])
    return np.asarray(result)


def _from_outline(
    points: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray
) -> FloatArray:
    """Vectors (p, 3) from the closest point of each triangle's three sides."""
    best = _from_segment(points, a, b)
    shortest = _dot(best, best)
    for start, end in ((b, c), (c, a)):
        other = _from_segment(points, start, end)
        length = _dot(other, other)
        nearer = length < shortest
        best[nearer], shortest[nearer] = other[nearer], length[nearer]
    return best


def _from_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    along, away = end - start, points - start
    length = _dot(along, along)
    share = np.clip(_dot(away, along) / np.where(length > 0, length, 1.0), 0, 1)
    return np.asarray(away - share[:, None] * along)


def _dot(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("pd,pd->p", u, v))
