"""What stands in the way: the face that hides a feature from a view point."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import BoolArray, FeaturePiece, FloatArray, IntArray, as_points
from mvp.visibility.facets import from_closest
from mvp.visibility.oracle import (
    Soup,
    behind_own_faces,
    mouth_edges,
    pyramid_tests,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from mvp.visibility.occluders import Occluders
    from mvp.visibility.region import Region

NOTHING = -1
"""Instead of a face id: nothing is in the way."""
OWN_FACES = -2
"""Instead of a face id: the feature's own faces turn away from the view point."""

# Beyond the boundary, where the view point is hidden by what the boundary belongs to;
# the later ones serve regions that were simplified on the safe side.
_STEPS_MM = (1e-3, 1e-2, 1e-1, 1.0, 10.0)


def blocking_faces(
    occluders: Occluders,
    pieces: Sequence[FeaturePiece],
    points_mm: ArrayLike,
) -> IntArray:
    """Which face of the scene hides a feature from each view point.

    Of several, the one nearest to the feature that looks towards it. Made for a few
    view points: each is looked at on its own, exactly.

    Args:
        occluders: what can hide the feature.
        pieces: convex pieces with their own faces.
        points_mm: view points (N, 3), same frame.

    Returns:
        (N,) face ids; NOTHING where every piece is seen whole, OWN_FACES where the
        feature's own faces turn away.
    """
    points = as_points(points_mm).reshape(-1, 3)
    soup = Soup.of(occluders.triangles_mm)
    found = np.full(len(points), NOTHING, dtype=np.int64)
    for piece in pieces:
        seen = np.flatnonzero(found == NOTHING)
        found[seen[behind_own_faces(piece, points[seen])]] = OWN_FACES
        before = np.flatnonzero(~soup.behind(piece))
        rest = Soup.of(occluders.triangles_mm[before])
        for row in np.flatnonzero(found == NOTHING):
            index = before[_blocking(rest, piece.vertices_mm, points[row])]
            if len(index):
                found[row] = occluders.face_ids[_nearest(occluders, piece, index)]
    return found


def limiting_faces(region: Region, points_mm: ArrayLike) -> IntArray:
    """Which face a view point would be hidden by first if it moved.

    From the closest point of the region's boundary a small step leads to where the
    feature is no longer seen whole; what is in the way there is the answer. Where the
    boundary does not matter or nothing is found, it is NOTHING.

    Args:
        region: of one feature or of several, made in one scene.
        points_mm: view points (N, 3), inside or outside.
    """
    points = as_points(points_mm).reshape(-1, 3)
    distance, slope = region.signed_distance_gradient(points)
    found = np.full(len(points), NOTHING, dtype=np.int64)
    if not region.bindings:
        return found
    occluders = region.bindings[0].occluders
    pieces = [binding.piece for binding in region.bindings]
    bounded = region.empty | (np.abs(distance) < region.workspace.diagonal_mm)
    for step in _STEPS_MM:
        left = np.flatnonzero(bounded & (found == NOTHING))
        past = distance[left] + step
        beyond = points[left] - past[:, None] * slope[left]
        found[left] = blocking_faces(occluders, pieces, beyond)
    return found


def _blocking(soup: Soup, vertices: FloatArray, point: FloatArray) -> BoolArray:
    """Triangles (m,) in the way between a view point (3,) and a piece."""
    blocking = np.zeros(len(soup.faces), dtype=np.bool_)
    for test in pyramid_tests(soup, vertices):
        for _, corners in test(point[None]):
            blocking |= _with_corners(soup, corners)
    if len(vertices) > 2:
        blocking |= _with_corners(soup, mouth_edges(soup, vertices))
    return blocking


def _nearest(occluders: Occluders, piece: FeaturePiece, index: IntArray) -> int:
    """Of some triangles the nearest that looks at the piece, else the nearest."""
    vertices = piece.vertices_mm
    heights = occluders.normals[index] @ vertices.T - occluders.offsets_mm[index, None]
    towards = heights.max(axis=1) > occluders.side_tolerance_mm
    index = index[towards] if towards.any() else index
    middle = np.broadcast_to(vertices.mean(axis=0), (len(index), 3))
    away = from_closest(middle, occluders.triangles_mm[index])
    return int(index[np.einsum("ij,ij->i", away, away).argmin()])


def _with_corners(soup: Soup, corners: IntArray) -> BoolArray:
    """Triangles (m,) that have all corners of one row of ``corners`` (k, c)."""
    base = len(soup.corners) + 1
    faces = np.sort(soup.faces, axis=1)
    wanted = _numbered(np.sort(corners, axis=1), base)
    parts = combinations(range(3), corners.shape[1])
    numbers = np.column_stack([_numbered(faces[:, part], base) for part in parts])
    return np.asarray(np.isin(numbers, wanted).any(axis=1))


def _numbered(corners: IntArray, base: int) -> IntArray:
    """One number for each row of corner indices."""
    return np.asarray(corners @ base ** np.arange(corners.shape[1]))
