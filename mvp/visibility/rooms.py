"""The convex space that holds every line of sight that still matters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from manifold3d import Manifold
from scipy.spatial import ConvexHull

from mvp.visibility.shadows import careful_hull
from mvp.visibility.solids import box_solid, mesh_arrays

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, Box, FloatArray
    from mvp.visibility.region import Region

_TOUCHING = 1e-12


@dataclass(frozen=True, eq=False)
class Room:
    """Hull of a feature piece and of the view points that are still in question.

    Lines of sight between the two never leave it, so that a triangle outside of it
    hides nothing, and of one that reaches into it only that part counts.

    Attributes:
        solid: the space itself.
        planes: (k, 4) rows (n, o): outside is n . x > o.
    """

    solid: Manifold
    planes: FloatArray

    @classmethod
    def of(cls, workspace: Box, before: Region | None, feature_mm: FloatArray) -> Room:
        """The room of a piece, given the region of the pieces before."""
        if before is not None:
            seen_from = mesh_arrays(before.solid)[0]
            return cls._hull(np.concatenate([seen_from, feature_mm]))
        if workspace.contains(feature_mm).all():
            return cls(box_solid(workspace), np.zeros((0, 4)))
        return cls._hull(np.concatenate([workspace.corners(), feature_mm]))

    @classmethod
    def _hull(cls, points_mm: FloatArray) -> Room:
        normals = ConvexHull(points_mm).equations[:, :3]
        first = np.unique(np.round(normals, 9), axis=0, return_index=True)[1]
        normals = normals[first]
        offsets = (points_mm @ normals.T).max(axis=0)
        offsets -= _TOUCHING * np.abs(points_mm).max()
        solid = careful_hull(points_mm)
        if solid is None:
            solid = Manifold.hull_points(points_mm)
        return cls(solid, np.column_stack([normals, offsets]))

    def holds(self, triangles_mm: FloatArray) -> BoolArray:
        """Which triangles (m, 3, 3) no side of the room separates from it."""
        left = np.arange(len(triangles_mm))
        for plane in self.planes:
            heights = triangles_mm[left] @ plane[:3]
            left = left[heights.min(axis=1) < plane[3]]
        held = np.zeros(len(triangles_mm), dtype=np.bool_)
        held[left] = True
        return held
