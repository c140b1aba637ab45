"""The smallest sphere around points: R_f and r_C of the field-of-view constraint."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import FloatArray, as_points

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_RELATIVE_SLACK = 1e-10


def enclosing_sphere(points_mm: ArrayLike) -> tuple[FloatArray, float]:
    """Centre (3,) and radius of the smallest sphere that holds all points, mm.

    Exact up to rounding: the farthest point outside joins the support, and the sphere
    grows with every exchange, so the search ends.

    Args:
        points_mm: (n, 3), n >= 1.

    Raises:
        ValueError: no points.
    """
    points = np.unique(as_points(points_mm).reshape(-1, 3), axis=0)
    if not len(points):
        raise ValueError("a sphere needs at least one point")
    support = points[:1]
    centre, radius = points[0], 0.0
    while True:
        distance = np.linalg.norm(points - centre, axis=1)
        farthest = int(np.argmax(distance))
        if distance[farthest] <= radius * (1 + _RELATIVE_SLACK) + 1e-12:
            return centre, float(distance[farthest])
        trial = np.vstack([support, points[farthest]])
        support, centre, grown = _smallest_of_few(trial)
        if grown <= radius:
            return centre, float(np.linalg.norm(points - centre, axis=1).max())
        radius = grown


def _smallest_of_few(points: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Support, centre and radius of the smallest sphere around at most five points."""
    best: tuple[FloatArray, FloatArray, float] | None = None
    for size in range(1, min(4, len(points)) + 1):
        for chosen in combinations(range(len(points)), size):
            subset = points[list(chosen)]
            centre = _circumcentre(subset)
            radius = float(np.linalg.norm(subset - centre, axis=1).max())
            reach = float(np.linalg.norm(points - centre, axis=1).max())
            holds = reach <= radius * (1 + _RELATIVE_SLACK) + 1e-12
            if holds and (best is None or radius < best[2]):
                best = subset, centre, radius
    if best is None:
        centre = points.mean(axis=0)
        return points, centre, float(np.linalg.norm(points - centre, axis=1).max())
    return best


def _circumcentre(points: FloatArray) -> FloatArray:
    """The point of their affine hull that is equally far from all of them."""
    edges = points[1:] - points[0]
    right = (edges * edges).sum(axis=1) / 2
    offset, *_ = np.linalg.lstsq(edges, right, rcond=None)
    return np.asarray(points[0] + offset)
