"""A planar face, convex or not, with or without holes, that must be seen whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import manifold3d
import numpy as np

from mvp.errors import FeatureError
from mvp.geometry import (
    FeaturePiece,
    FloatArray,
    IntArray,
    TriangleMesh,
    planar_patches,
    plane_axes,
)
from mvp.scene.face_pieces import face_polygons
from mvp.scene.polygons import (
    boundary_rings,
    convex_partition,
    signed_area,
    smallest_rectangle,
)
from mvp.scene.surface import (
    ON_PART_MM,
    checked_mesh,
    checked_points,
    require_on_part,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

# A ring that turns by less than this at a vertex goes straight on.
_TURN_RAD = np.deg2rad(0.5)


@dataclass(frozen=True, eq=False)
class FaceFeature:
    """A polygonal face in the part frame.

    Attributes:
        id: stable name.
        outer_mm: (n, 3) outer ring, counter-clockwise seen from outside, not repeated.
        holes_mm: inner rings, clockwise seen from outside.
        normal: (3,) outward unit normal.
        area_mm2: area without the holes.
        pieces: convex polygons that together cover the face, and those of its holes in
            which nothing stands.
    """

    id: str
    outer_mm: FloatArray
    holes_mm: tuple[FloatArray, ...]
    normal: FloatArray
    area_mm2: float
    pieces: tuple[FeaturePiece, ...]

    @property
    def kind(self) -> Literal["face"]:
        """Which of the four kinds it is."""
        return "face"

    @property
    def key_points_mm(self) -> FloatArray:
        """(n, 3) the corners of the outer ring."""
        return self.outer_mm

    @property
    def segments_mm(self) -> FloatArray:
        """(4, 2, 3) sides of the smallest rectangle round the face, in its plane."""
        axes = np.stack(plane_axes(self.normal))
        corners = smallest_rectangle(self.outer_mm @ axes.T) @ axes
        corners = corners + self.normal * float(self.outer_mm[0] @ self.normal)
        return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)

    @property
    def outline_mm(self) -> tuple[FloatArray, ...]:
        """All rings as closed polylines (n + 1, 3)."""
        rings = (self.outer_mm, *self.holes_mm)
        return tuple(np.vstack([ring, ring[:1]]) for ring in rings)

    def sight_pieces(self) -> tuple[FeaturePiece, ...]:
        """The convex pieces that must be seen whole."""
        return self.pieces


def patch_face(id: str, mesh: TriangleMesh, triangles: IntArray) -> FaceFeature:
    """The face that some coplanar, connected triangles (indices) make together."""
    faces = mesh.faces[triangles]
    weights = mesh.areas_mm2[triangles][:, None]
    normal = (mesh.normals[triangles] * weights).sum(axis=0)
    normal = normal / np.linalg.norm(normal)
    flat = mesh.vertices_mm @ np.stack(plane_axes(normal)).T
    rings = boundary_rings(faces)
    rings.sort(key=lambda ring: -signed_area(flat[ring]))
    outer, *inner = [mesh.vertices_mm[ring] for ring in rings]
    offset = float((mesh.vertices_mm[faces.ravel()] @ normal).max())
    plane = np.append(normal, offset)
    polygons = face_polygons(mesh, triangles, rings, flat, plane)
    return FaceFeature(
        id,
        _straightened(outer),
        tuple(_straightened(ring) for ring in inner),
        normal,
        float(mesh.areas_mm2[triangles].sum()),
        tuple(FeaturePiece(mesh.vertices_mm[p], plane[None], "all") for p in polygons),
    )


def _straightened(ring: FloatArray) -> FloatArray:
    """The ring without vertices on straight sides."""
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    cross = np.linalg.norm(np.cross(before, after), axis=1)
    chord = np.linalg.norm(before + after, axis=1)
    turn = np.arctan2(cross, np.einsum("ij,ij->i", before, after))
    kept = ring[(cross > 2e-4 * np.maximum(chord, 1e-12)) | (turn > _TURN_RAD)]
    return kept if len(kept) >= 3 else ring


def face_feature_at(
    id: str,
    point_mm: ArrayLike,
    mesh: TriangleMesh,
    *,
    tolerance_mm: float = ON_PART_MM,
) -> FaceFeature:
    """The whole planar face that a point lies on.

    Raises:
        FeatureError: the point is not finite, off the part, or on a curved face.
    """
    checked_mesh(mesh, feature=id)
    point = checked_points(point_mm, feature=id)[:1]
    nearest = require_on_part(mesh, point, feature=id, tolerance_mm=tolerance_mm)
    label = planar_patches(mesh)
    members = np.flatnonzero(label == label[nearest.triangle[0]])
    return patch_face(id, mesh, members)


def face_feature(
    id: str,
    outer_mm: ArrayLike,
    mesh: TriangleMesh,
    *,
    holes_mm: Sequence[ArrayLike] = (),
    tolerance_mm: float = ON_PART_MM,
) -> FaceFeature:
    """A polygon (with holes) drawn on a planar face of the part.

    Raises:
        FeatureError: fewer than three corners, no area, not plane, sides that cross,
            or a corner inside the solid or off the part.
    """
    checked_mesh(mesh, feature=id)
    rings = [checked_points(ring, feature=id) for ring in (outer_mm, *holes_mm)]
    normal = _ring_normal(rings[0], id)
    points = np.vstack(rings)
    offset = points @ normal
    if np.ptp(offset) > 2 * tolerance_mm:
        raise FeatureError(
            f"feature '{id}' is not plane: its corners are {np.ptp(offset):.3g} mm apart "
            "across the best plane",
            hint="give the corners of one planar face",
            where=id,
        )
    nearest = require_on_part(mesh, points, feature=id, tolerance_mm=tolerance_mm)
    if float((mesh.normals[nearest.triangle] @ normal).sum()) < 0:
        normal = -normal
    return _drawn_face(id, rings, normal, mesh, tolerance_mm)


def _ring_normal(ring: FloatArray, id: str) -> FloatArray:
    """Unit normal of a ring by Newell's sum."""
    total = np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0)
    size = float(np.linalg.norm(total))
    if len(ring) < 3 or size <= 1e-6:
        raise FeatureError(
            f"feature '{id}' has no area: {len(ring)} corners",
            hint="give at least three corners that are not on one line",
            where=id,
        )
    return np.asarray(total / size)


def _drawn_face(
    id: str,
    rings: list[FloatArray],
    normal: FloatArray,
    mesh: TriangleMesh,
    tolerance_mm: float,
) -> FaceFeature:
    """Triangulate, check that all of it is on the part, and partition."""
    axes = np.stack(plane_axes(normal))
    flat = [ring @ axes.T for ring in rings]
    turned = [
        ring if (signed_area(ring) > 0) == (i == 0) else ring[::-1]
        for i, ring in enumerate(flat)
    ]
    area = sum(signed_area(ring) for ring in turned)
    filled = manifold3d.CrossSection(turned, manifold3d.FillRule.Positive).area()
    if area <= 0 or abs(filled - area) > 1e-6 * area + 1e-9:
        raise FeatureError(
            f"feature '{id}': sides of the polygon cross, or a hole leaves it",
            hint="give the corners in order round the face, each hole inside it",
            where=id,
        )
    triangles = np.asarray(manifold3d.triangulate(turned), dtype=np.int64)
    corners = np.vstack(turned)
    solid = corners @ axes + normal * float(np.vstack(rings).mean(axis=0) @ normal)
    inner = solid[triangles].mean(axis=1)
    inner = np.vstack(
        [inner, solid[triangles].mean(axis=1) * 0.5 + solid[triangles[:, 0]] * 0.5]
    )
    nearest = require_on_part(mesh, inner, feature=id, tolerance_mm=tolerance_mm)
    # The plane of the part itself: a face inside the material is seen from nowhere.
    offset = float((nearest.point_mm @ normal).max())
    solid = solid + np.outer(offset - solid @ normal, normal)
    ends = np.cumsum([len(ring) for ring in turned])
    outer, *holes = np.split(solid, ends[:-1])
    plane = np.append(normal, offset)[None]
    polygons = convex_partition(corners, triangles)
    pieces = tuple(FeaturePiece(solid[p], plane, "all") for p in polygons)
    return FaceFeature(id, outer, tuple(holes), normal, float(area), pieces)
