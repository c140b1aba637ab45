"""Exact distances of segments to points, segments and triangles, in bulk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray, TriangleMesh

_BLOCK = 24
_PAIRS_AT_ONCE = 400_000


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _ratio(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Numerator / denominator clipped to [0, 1]; 0 where the denominator vanishes."""
    safe = denominator > 0
    value = numerator / np.where(safe, denominator, 1.0)
    return np.where(safe, np.clip(value, 0.0, 1.0), 0.0)


def point_segment(p: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance (...) of points to segments a-b; everything (..., 3) broadcasts."""
    along = b - a
    t = _ratio(_dot(p - a, along), _dot(along, along))
    return np.asarray(np.linalg.norm(p - a - t[..., None] * along, axis=-1))


def segment_segment(
    p: FloatArray, q: FloatArray, a: FloatArray, b: FloatArray
) -> FloatArray:
    """Distance (...) between segments p-q and a-b; everything (..., 3) broadcasts."""
    u, v, w = q - p, b - a, p - a
    uu, vv, uv, uw, vw = _dot(u, u), _dot(v, v), _dot(u, v), _dot(u, w), _dot(v, w)
    determinant = uu * vv - uv * uv
    skew = determinant > 1e-14 * uu * vv
    s = np.where(skew, _ratio(uv * vw - uw * vv, np.where(skew, determinant, 1)), 0.0)
    t = _ratio(uv * s + vw, vv)
    s = _ratio(uv * t - uw, uu)
    gap = w + s[..., None] * u - t[..., None] * v
    return np.asarray(np.linalg.norm(gap, axis=-1))


def segment_triangle(p: FloatArray, q: FloatArray, triangles: FloatArray) -> FloatArray:
    """Distance (P,) between P segments (P, 3), (P, 3) and P triangles (P, 3, 3).

    Zero where they meet. A triangle without area counts as its edges.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    nearest = np.minimum(segment_segment(p, q, a, b), segment_segment(p, q, b, c))
    nearest = np.minimum(nearest, segment_segment(p, q, c, a))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    flat = length > 0
    normal = normal / np.where(flat, length, 1.0)[:, None]
    height_p, height_q = _dot(p - a, normal), _dot(q - a, normal)
    for point, height in ((p, height_p), (q, height_q)):
        over = flat & _over(point, normal, a, b, c)
        nearest = np.where(over, np.minimum(nearest, np.abs(height)), nearest)
    crosses = flat & (height_p * height_q <= 0) & (height_p != height_q)
    t = height_p / np.where(crosses, height_p - height_q, 1.0)
    hit = crosses & _over(p + t[:, None] * (q - p), normal, a, b, c)
    return np.where(hit, 0.0, nearest)


def _over(
    point: FloatArray, normal: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray
) -> BoolArray:
    """Whether points (P, 3) project into their triangles."""
    inside = np.ones(len(point), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= _dot(np.cross(end - start, point - start), normal) >= 0
    return inside


@dataclass(frozen=True, eq=False)
class TriangleBlocks:
    """Triangles in compact blocks, each in a sphere: prunes most pairs unseen.

    Attributes:
        triangles_mm: (m, 3, 3), block after block.
        first: (B + 1,) where each block starts.
        centre_mm: (B, 3) spheres of the blocks.
        radius_mm: (B,).
        own_centre_mm: (m, 3) spheres of the triangles.
        own_radius_mm: (m,).
    """

    triangles_mm: FloatArray
    first: IntArray
    centre_mm: FloatArray
    radius_mm: FloatArray
    own_centre_mm: FloatArray
    own_radius_mm: FloatArray

    @classmethod
    def of(cls, mesh: TriangleMesh) -> TriangleBlocks:
        """Sort the triangles of a mesh into blocks."""
        middle = mesh.triangles_mm.mean(axis=1)
        order, first = _median_split(middle)
        triangles = mesh.triangles_mm[order]
        own_centre = middle[order]
        own_radius = np.linalg.norm(triangles - own_centre[:, None], axis=2).max(axis=1)
        starts = first[:-1]
        low = np.minimum.reduceat(triangles.min(axis=1), starts)
        high = np.maximum.reduceat(triangles.max(axis=1), starts)
        centre = (low + high) / 2
        block = np.repeat(np.arange(len(starts)), np.diff(first))
        spread = np.linalg.norm(triangles - centre[block][:, None], axis=2).max(axis=1)
        radius = np.maximum.reduceat(spread, starts)
        return cls(triangles, first, centre, radius, own_centre, own_radius)

    def distance(self, p: FloatArray, q: FloatArray, ceiling_mm: float) -> FloatArray:
        """Distance (S,) of segments (S, 3), (S, 3); ``ceiling_mm`` when farther."""
        chunk = max(1, _PAIRS_AT_ONCE // (4 * len(self.centre_mm)))
        parts = [
            self._distance(p[k : k + chunk], q[k : k + chunk], ceiling_mm)
            for k in range(0, len(p), chunk)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def _distance(self, p: FloatArray, q: FloatArray, ceiling_mm: float) -> FloatArray:
        nearest: FloatArray = np.full(len(p), ceiling_mm)
        to_block = point_segment(self.centre_mm, p[:, None], q[:, None])
        nearest[:] = np.minimum(nearest, (to_block + self.radius_mm).min(axis=1))
        segment, block = np.nonzero(to_block - self.radius_mm < nearest[:, None])
        count = np.diff(self.first)[block]
        offsets = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        triangle = np.repeat(self.first[block], count) + offsets
        segment = np.repeat(segment, count)
        for k in range(0, len(segment), _PAIRS_AT_ONCE):
            part = slice(k, k + _PAIRS_AT_ONCE)
            self._refine(nearest, p, q, segment[part], triangle[part])
        return nearest

    def _refine(
        self,
        nearest: FloatArray,
        p: FloatArray,
        q: FloatArray,
        segment: IntArray,
        triangle: IntArray,
    ) -> None:
        """Lower ``nearest`` by exact distances of the pairs that can still matter."""
        centre = self.own_centre_mm[triangle]
        rough = point_segment(centre, p[segment], q[segment])
        # The centre belongs to the triangle, so this is an upper bound.
        np.minimum.at(nearest, segment, rough)
        matters = rough - self.own_radius_mm[triangle] < nearest[segment]
        segment, triangle = segment[matters], triangle[matters]
        exact = segment_triangle(p[segment], q[segment], self.triangles_mm[triangle])
        np.minimum.at(nearest, segment, exact)

    def winding(self, points: FloatArray) -> FloatArray:
        """Generalised winding number (n,) of points: about 1 inside a solid, 0 outside."""
        total = np.zeros(len(points))
        step = max(1, _PAIRS_AT_ONCE // len(self.triangles_mm))
        for k in range(0, len(points), step):
            total[k : k + step] = _winding(points[k : k + step], self.triangles_mm)
        return total


def _winding(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Sum of solid angles over 4 pi (Van Oosterom and Strackee)."""
    a, b, c = (triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    above = _dot(a, np.cross(b, c))
    below = la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb
    return np.asarray(np.arctan2(above, below).sum(axis=1) / (2 * np.pi))


def _median_split(points: FloatArray) -> tuple[IntArray, IntArray]:
    """An order (m,) in compact blocks and the start of each block (B + 1,)."""
    pending = [np.arange(len(points), dtype=np.int64)]
    done: list[IntArray] = []
    while pending:
        part = pending.pop()
        if len(part) <= _BLOCK:
            done.append(part)
            continue
        axis = int(np.argmax(np.ptp(points[part], axis=0)))
        half = len(part) // 2
        split = part[np.argpartition(points[part, axis], half)]
        pending += [split[:half], split[half:]]
    sizes = [len(part) for part in done]
    return np.concatenate(done), np.concatenate([[0], np.cumsum(sizes)]).astype(
        np.int64
    )
