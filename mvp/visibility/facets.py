"""Distances from view points to the convex facets of a region's boundary."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray

_CELLS_AT_ONCE = 1 << 21
_FIRST_GUESS = 3


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
    def _bounds(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Half sizes and middles of the bounding boxes, and plane offsets."""
        low, high = self.triangles_mm.min(axis=1), self.triangles_mm.max(axis=1)
        offsets = np.einsum("md,md->m", self.inward, self.triangles_mm.mean(axis=1))
        return (high - low) / 2, (high + low) / 2, offsets

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
        """Fill one block of rows: exact distances wherever a bound allows a hit."""
        lower = self._lower_bounds(points)
        rows, columns = np.nonzero(lower <= self._kth_bound(points, lower, k)[:, None])
        towards, distance = self._towards(points, rows, columns)
        facet = self.facet_of[columns]
        order = np.lexsort((distance, facet, rows))
        rows, columns, facet = rows[order], columns[order], facet[order]
        towards, distance = towards[order], distance[order]
        best = _starts(rows, facet)
        rows, columns, facet = rows[best], columns[best], facet[best]
        towards, distance = towards[best], distance[best]
        order = np.lexsort((distance, rows))
        rows, columns, facet = rows[order], columns[order], facet[order]
        towards, distance = towards[order], distance[order]
        rank = np.arange(len(rows)) - np.searchsorted(rows, rows, side="left")
        use = rank < k
        at = (rows[use] + into.start, rank[use])
        result.distance_mm[at] = distance[use]
        result.facet[at] = facet[use]
        result.direction[at] = _directions(
            towards[use], distance[use], self.inward[columns[use]]
        )

    def _lower_bounds(self, points: FloatArray) -> FloatArray:
        """(N, m): no point of the triangle is nearer than this, mm."""
        half, middle, offsets = self._bounds
        squared = np.zeros((len(points), len(half)))
        for axis in range(3):
            gap = np.abs(points[:, None, axis] - middle[None, :, axis]) - half[:, axis]
            np.maximum(gap, 0, out=gap)
            squared += gap * gap
        plane = np.abs(points @ self.inward.T - offsets)
        return np.asarray(np.maximum(np.sqrt(squared), plane) * (1 - 1e-9) - 1e-9)

    def _kth_bound(self, points: FloatArray, lower: FloatArray, k: int) -> FloatArray:
        """(N,): at least k facets, or all, are nearer than this, mm."""
        count = min(lower.shape[1], _FIRST_GUESS * k + 4)
        guess = np.argpartition(lower, count - 1, axis=1)[:, :count]
        rows = np.repeat(np.arange(len(points)), count)
        distance = self._towards(points, rows, guess.reshape(-1))[1]
        facet = self.facet_of[guess.reshape(-1)]
        order = np.lexsort((distance, facet, rows))
        best = order[_starts(rows[order], facet[order])]
        best = best[np.lexsort((distance[best], rows[best]))]
        rank = np.arange(len(best)) - np.searchsorted(rows[best], rows[best], "left")
        bound = np.full(len(points), np.inf)
        kth = rank == k - 1
        bound[rows[best[kth]]] = distance[best[kth]]
        return bound

    def _towards(
        self, points: FloatArray, rows: IntArray, columns: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Vectors (p, 3) from the closest points of triangles, and their lengths."""
        towards = from_closest(points[rows], self.triangles_mm[columns])
        return towards, np.sqrt(np.einsum("pd,pd->p", towards, towards))


def _starts(*keys: IntArray) -> IntArray:
    """Where a run of equal keys begins; keys are sorted together."""
    new = np.ones(len(keys[0]), dtype=np.bool_)
    new[1:] = False
    for key in keys:
        new[1:] |= key[1:] != key[:-1]
    return np.flatnonzero(new)


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
