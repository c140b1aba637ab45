"""The pieces of a feature as the regions need them: snapped, unpierced, in order."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.errors import FeatureError
from mvp.geometry import FeaturePiece, FloatArray
from mvp.visibility.leftovers import edges_cross

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.visibility.occluders import Occluders


def separate_pieces(
    occluders: Occluders, pieces: Sequence[FeaturePiece]
) -> list[FeaturePiece]:
    """Pieces with vertices on those of the scene, widely spread ones first.

    What is seen from far apart is little, and every further piece only has to be
    looked at from there.

    Raises:
        FeatureError: no piece, or a piece without vertices.
    """
    if not pieces or any(not len(piece.vertices_mm) for piece in pieces):
        raise FeatureError(
            "a feature without any point cannot be seen",
            hint="give at least one convex piece with at least one vertex",
        )
    whole = [
        part
        for piece in pieces
        for part in _unpierced(
            occluders,
            replace(piece, vertices_mm=occluders.snapped(piece.vertices_mm)),
        )
    ]
    middles = np.array([piece.vertices_mm.mean(axis=0) for piece in whole])
    return [whole[i] for i in _spread_order(middles)]


def _spread_order(points_mm: FloatArray) -> list[int]:
    """Order of points (n, 3): the outermost, then always the one farthest from all."""
    left = np.linalg.norm(points_mm - points_mm.mean(axis=0), axis=1)
    order: list[int] = []
    for _ in range(len(points_mm)):
        farthest = int(left.argmax())
        away = np.linalg.norm(points_mm - points_mm[farthest], axis=1)
        left = np.minimum(left, away) if order else away
        order.append(farthest)
        left[order] = -1.0
    return order


def _unpierced(occluders: Occluders, piece: FeaturePiece) -> list[FeaturePiece]:
    """The piece, or the rim of a hole's mouth where something passes through it.

    A face that something passes through is seen whole from nowhere.
    """
    vertices = piece.vertices_mm
    if not piece.mouth or len(vertices) < 3 or not _pierced(occluders, vertices):
        return [piece]
    ends = np.stack([vertices, np.roll(vertices, -1, axis=0)], axis=1)
    return [FeaturePiece(chord, piece.planes, piece.facing) for chord in ends]


def _pierced(occluders: Occluders, polygon_mm: FloatArray) -> bool:
    """Whether a triangle passes through the inside of a convex polygon."""
    middle = polygon_mm.mean(axis=0)
    inner = middle + (1 - 1e-6) * (polygon_mm - middle)
    triangles = occluders.triangles_mm
    normal = np.cross(inner[1] - inner[0], inner[2] - inner[0])
    height = (triangles - middle) @ (normal / np.linalg.norm(normal))
    tolerance = occluders.side_tolerance_mm
    near = (height.min(axis=1) < -tolerance) & (height.max(axis=1) > tolerance)
    near &= (triangles.min(axis=1) <= inner.max(axis=0)).all(axis=1)
    near &= (triangles.max(axis=1) >= inner.min(axis=0)).all(axis=1)
    cutters = triangles[near]
    for i in range(1, len(inner) - 1):
        fan = np.broadcast_to(inner[[0, i, i + 1]], cutters.shape)
        if edges_cross(cutters, fan).any() or edges_cross(fan, cutters).any():
            return True
    return False
