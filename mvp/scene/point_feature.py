"""A point of the surface that must be seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvp.geometry import (
    EdgeTable,
    Facing,
    FeaturePiece,
    FloatArray,
    IntArray,
    TriangleMesh,
    edge_table,
    plane_axes,
)
from mvp.scene.edge_feature import edge_piece, own_planes
from mvp.scene.surface import (
    ON_PART_MM,
    checked_mesh,
    checked_points,
    require_on_part,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class PointFeature:
    """A point of the part.

    Attributes:
        id: stable name.
        point_mm: (3,).
        normal: (3,) unit mean outward normal of the faces around it.
        pieces: one piece of one vertex.
        detail_mm: half length of the two segments whose image is resolved.
    """

    id: str
    point_mm: FloatArray
    normal: FloatArray
    pieces: tuple[FeaturePiece, ...]
    detail_mm: float = 0.5

    @property
    def kind(self) -> Literal["point"]:
        """Which of the four kinds it is."""
        return "point"

    @property
    def key_points_mm(self) -> FloatArray:
        """(1, 3) the point."""
        return self.point_mm[None]

    @property
    def segments_mm(self) -> FloatArray:
        """(2, 2, 3) a small cross in the tangent plane."""
        first, second = plane_axes(self.normal)
        arms = self.detail_mm * np.stack([first, second])
        return np.stack([self.point_mm - arms, self.point_mm + arms], axis=1)

    @property
    def outline_mm(self) -> tuple[FloatArray, ...]:
        """The two arms of the cross."""
        return tuple(self.segments_mm)

    def sight_pieces(self) -> tuple[FeaturePiece, ...]:
        """The convex pieces that must be seen whole."""
        return self.pieces


def point_feature(
    id: str,
    point_mm: ArrayLike,
    mesh: TriangleMesh,
    *,
    tolerance_mm: float = ON_PART_MM,
) -> PointFeature:
    """Find a point on the mesh, with the faces around it.

    On a face that face must look at the viewer; on an edge the edge's rule holds; at
    a corner whose edges are all convex one facing face suffices, at any other corner
    all must face (which gives up some views, but never claims a hidden one).

    Raises:
        FeatureError: not finite, inside the solid, or off the part.
    """
    checked_mesh(mesh, feature=id)
    given = checked_points(point_mm, feature=id)[:1]
    nearest = require_on_part(mesh, given, feature=id, tolerance_mm=tolerance_mm)
    triangle, point = int(nearest.triangle[0]), nearest.point_mm[0]
    gap = np.linalg.norm(mesh.vertices_mm - point, axis=1)
    corner = int(np.argmin(gap))
    table = edge_table(mesh)
    if gap[corner] <= tolerance_mm:
        piece, around = _corner_piece(mesh, table, corner)
    else:
        piece, around = _inner_piece(mesh, table, triangle, point, tolerance_mm)
    normal = mesh.normals[around].sum(axis=0)
    length = float(np.linalg.norm(normal))
    normal = normal / length if length > 1e-9 else mesh.normals[triangle]
    return PointFeature(id, piece.vertices_mm[0], normal, (piece,))


def _corner_piece(
    mesh: TriangleMesh, table: EdgeTable, corner: int
) -> tuple[FeaturePiece, IntArray]:
    """The piece of a vertex, and its triangles."""
    around = np.flatnonzero((mesh.faces == corner).any(axis=1))
    rows = (table.vertices == corner).any(axis=1)
    point = mesh.vertices_mm[corner]
    if not table.regular[rows].all():
        return FeaturePiece(point[None]), around
    facing: Facing = "any" if (table.angle_rad[rows] > -1e-6).all() else "all"
    normals = np.unique(np.round(mesh.normals[around], 9), axis=0, return_index=True)[1]
    planes = own_planes(mesh, around[normals], point)
    return FeaturePiece(point[None], planes, facing), around


def _inner_piece(
    mesh: TriangleMesh,
    table: EdgeTable,
    triangle: int,
    point: FloatArray,
    tolerance_mm: float,
) -> tuple[FeaturePiece, IntArray]:
    """The piece of a point on an edge or inside a face, and its triangles."""
    rows = np.flatnonzero((table.faces == triangle).any(axis=1))
    ends = mesh.vertices_mm[table.vertices[rows]]
    along = ends[:, 1] - ends[:, 0]
    share = np.einsum("ij,ij->i", point - ends[:, 0], along)
    share = np.clip(share / np.einsum("ij,ij->i", along, along), 0, 1)
    foot = ends[:, 0] + share[:, None] * along
    gap = np.linalg.norm(foot - point, axis=1)
    best = int(np.argmin(gap))
    if gap[best] > tolerance_mm:
        one = np.array([triangle])
        return FeaturePiece(point[None], own_planes(mesh, one, point), "all"), one
    around = table.faces[rows[best]]
    piece = edge_piece(mesh, table, int(rows[best]), foot[best][None])
    return piece, around[around >= 0]
