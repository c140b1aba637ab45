"""Plane polygons: area, rings of a triangle patch, convex partition, rectangle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull, QhullError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray, IntArray

# Sine of the turn below which a ring goes straight on.
_STRAIGHT = 1e-9


def signed_area(ring: FloatArray) -> float:
    """Area of a plane ring (n, 2), > 0 counter-clockwise."""
    x, y = ring.T
    return float(x @ np.roll(y, -1) - np.roll(x, -1) @ y) / 2


def cross2(a: FloatArray, b: FloatArray) -> FloatArray:
    """The z component of the cross product of plane vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def boundary_rings(triangles: IntArray) -> list[IntArray]:
    """Closed rings of directed edges of a patch (m, 3) whose reverse is not in it.

    The patch lies to the left of its rings. Where rings touch in a vertex they are
    taken apart there; chains that do not close (broken orientation) are left out.
    """
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges = {(int(a), int(b)) for a, b in directed}
    following: dict[int, list[int]] = {}
    for a, b in sorted(edges):
        if (b, a) not in edges:
            following.setdefault(a, []).append(b)
    rings: list[IntArray] = []
    for start in sorted(following):
        while following[start]:
            rings += _walk(following, start)
    return rings


def _walk(following: dict[int, list[int]], start: int) -> list[IntArray]:
    """Walk until stuck; each time a vertex comes again a ring has closed."""
    rings: list[IntArray] = []
    path = [start]
    while following.get(path[-1]):
        step = following[path[-1]].pop()
        if step in path:
            begin = path.index(step)
            rings.append(np.array(path[begin:], dtype=np.int64))
            path = path[: begin + 1]
        else:
            path.append(step)
    return rings


def convex_partition(points: FloatArray, triangles: IntArray) -> list[IntArray]:
    """Join triangles to convex polygons, longest shared edge first.

    Args:
        points: (n, 2) plane coordinates.
        triangles: (m, 3) counter-clockwise triangles that fill the region.

    Returns:
        Index rings, counter-clockwise; together they cover exactly the triangles.
    """
    rings = {number: [int(v) for v in t] for number, t in enumerate(triangles)}
    owner = {edge: number for number, ring in rings.items() for edge in _edges(ring)}
    shared = [(a, b) for a, b in owner if a < b and (b, a) in owner]
    shared.sort(key=lambda e: (-float(np.linalg.norm(points[e[0]] - points[e[1]])), e))
    for a, b in shared:
        left, right = owner[a, b], owner[b, a]
        if left == right:
            continue
        ring = _merged(rings[left], rings[right], a, b)
        if _is_convex(points[ring]):
            rings[left] = ring
            del rings[right]
            owner.update(dict.fromkeys(_edges(ring), left))
            owner[a, b] = owner[b, a] = left
    return [_corners(points, ring) for ring in rings.values()]


def _edges(ring: Sequence[int]) -> list[tuple[int, int]]:
    return list(zip(ring, [*ring[1:], ring[0]], strict=True))


def _merged(left: list[int], right: list[int], a: int, b: int) -> list[int]:
    """One ring round two that share the edge a-b, without the spikes this leaves."""
    i, j = left.index(b), right.index(a)
    from_b_to_a = left[i:] + left[:i]
    from_a_to_b = right[j:] + right[:j]
    ring = from_b_to_a + from_a_to_b[1:-1]
    spike = _spike(ring)
    while spike is not None and len(ring) > 3:
        ring = [v for k, v in enumerate(ring) if k not in spike]
        spike = _spike(ring)
    return ring


def _spike(ring: list[int]) -> tuple[int, int] | None:
    """A place at which the ring goes out and straight back."""
    for k in range(len(ring)):
        if ring[k - 1] == ring[(k + 1) % len(ring)]:
            return k, (k + 1) % len(ring)
    return None


def _is_convex(ring: FloatArray) -> bool:
    """Whether a ring (n, 2) turns left or goes straight on everywhere."""
    if len(ring) < 3:
        return False
    step = np.roll(ring, -1, axis=0) - ring
    length = np.linalg.norm(step, axis=1)
    turn = cross2(step, np.roll(step, -1, axis=0))
    return bool((turn >= -_STRAIGHT * length * np.roll(length, -1)).all())


def _corners(points: FloatArray, ring: list[int]) -> IntArray:
    """The ring without vertices at which it goes straight on."""
    here = points[ring]
    before = here - np.roll(here, 1, axis=0)
    after = np.roll(here, -1, axis=0) - here
    scale = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    turns = np.abs(cross2(before, after)) > _STRAIGHT * scale
    corners: IntArray = np.array(ring, dtype=np.int64)[turns]
    return corners


def smallest_rectangle(points: FloatArray) -> FloatArray:
    """Corners (4, 2) of the rectangle of least area round plane points (n, 2)."""
    try:
        hull = points[ConvexHull(points).vertices]
    except QhullError:
        hull = points
    step = np.roll(hull, -1, axis=0) - hull
    step = step[np.linalg.norm(step, axis=1) > 0]
    best: tuple[float, FloatArray] = (np.inf, np.zeros((4, 2)))
    for along in step / np.linalg.norm(step, axis=1, keepdims=True):
        axes = np.stack([along, [-along[1], along[0]]])
        place = hull @ axes.T
        low, high = place.min(axis=0), place.max(axis=0)
        area = float(np.prod(high - low))
        if area < best[0] * (1 - 1e-9):
            corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
            best = area, corners @ axes
    return best[1]
