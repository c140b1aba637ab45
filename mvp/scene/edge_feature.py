"""A straight edge, or a line on a face, that must be seen whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvp.errors import FeatureError
from mvp.geometry import (
    EdgeTable,
    Facing,
    FeaturePiece,
    FloatArray,
    IntArray,
    TriangleMesh,
    edge_table,
)
from mvp.scene.surface import (
    ON_PART_MM,
    checked_mesh,
    checked_points,
    require_on_part,
    tell,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

# Two facets this flat are one plane; their common edge is not to be seen.
_FLAT_RAD = 1e-4
_SAME_PLANE = 1e-6


@dataclass(frozen=True, eq=False)
class EdgeFeature:
    """A straight edge in the part frame.

    Attributes:
        id: stable name.
        start_mm: (3,).
        end_mm: (3,).
        pieces: the stretches that lie between two faces each, in order.
    """

    id: str
    start_mm: FloatArray
    end_mm: FloatArray
    pieces: tuple[FeaturePiece, ...]

    @property
    def kind(self) -> Literal["edge"]:
        """Which of the four kinds it is."""
        return "edge"

    @property
    def length_mm(self) -> float:
        """Distance between the ends, mm."""
        return float(np.linalg.norm(self.end_mm - self.start_mm))

    @property
    def key_points_mm(self) -> FloatArray:
        """(2, 3) the two ends."""
        return np.stack([self.start_mm, self.end_mm])

    @property
    def segments_mm(self) -> FloatArray:
        """(1, 2, 3) the edge itself."""
        return self.key_points_mm[None]

    @property
    def outline_mm(self) -> tuple[FloatArray, ...]:
        """The edge as one polyline (2, 3)."""
        return (self.key_points_mm,)

    def sight_pieces(self) -> tuple[FeaturePiece, ...]:
        """The convex pieces that must be seen whole."""
        return self.pieces


@dataclass(frozen=True, eq=False)
class _Stretch:
    """A part [low, high] (mm from the start) of the edge, with its own faces."""

    low_mm: float
    high_mm: float
    piece: FeaturePiece


def edge_feature(
    id: str,
    start_mm: ArrayLike,
    end_mm: ArrayLike,
    mesh: TriangleMesh,
    *,
    tolerance_mm: float = ON_PART_MM,
    table: EdgeTable | None = None,
) -> EdgeFeature:
    """Find an edge given by its ends on the mesh, with the faces it belongs to.

    The edge may span several mesh edges, be part of one, or be a line on a face. Its
    points become the mesh's own when they are within the tolerance, because an edge
    that runs inside the material, however little, is seen from nowhere.

    ``table`` is the mesh's edge table, when it is known already.

    Raises:
        FeatureError: not finite, shorter than the tolerance, inside the solid, or off
            the part.
    """
    checked_mesh(mesh, feature=id)
    ends = np.vstack(
        [checked_points(end, feature=id)[:1] for end in (start_mm, end_mm)]
    )
    length = float(np.linalg.norm(ends[1] - ends[0]))
    if length <= tolerance_mm:
        raise FeatureError(
            f"feature '{id}' has no length: both ends are at {tell(ends[0])}",
            hint="give two different ends, or make it a point",
            where=id,
        )
    table = table or edge_table(mesh)
    found = _mesh_stretches(mesh, table, ends, tolerance_mm)
    gaps = _gaps(found, length, tolerance_mm)
    found += [_face_stretch(mesh, ends, gap, id, tolerance_mm) for gap in gaps]
    found = _joined(sorted(found, key=lambda stretch: stretch.low_mm), tolerance_mm)
    return _assembled(id, found)


def _assembled(id: str, found: list[_Stretch]) -> EdgeFeature:
    first = min(found, key=lambda stretch: stretch.low_mm)
    last = max(found, key=lambda stretch: stretch.high_mm)
    return EdgeFeature(
        id,
        first.piece.vertices_mm[0],
        last.piece.vertices_mm[-1],
        tuple(stretch.piece for stretch in found),
    )


def own_planes(
    mesh: TriangleMesh, triangles: IntArray, point: FloatArray
) -> FloatArray:
    """Rows (n, o) of the planes of some triangles through a point of them all."""
    normals = mesh.normals[triangles]
    return np.column_stack([normals, normals @ point])


def edge_piece(
    mesh: TriangleMesh, table: EdgeTable, row: int, ends: FloatArray
) -> FeaturePiece:
    """A stretch (2, 3) of one mesh edge with the rule of when its faces look at one.

    A convex edge needs one facing face, a reflex edge both. On an open or non-manifold
    edge no half-space is free of material for sure, so there is no such rule.
    """
    if not table.regular[row]:
        return FeaturePiece(ends)
    planes = own_planes(
        mesh, table.faces[row], mesh.vertices_mm[table.vertices[row, 0]]
    )
    facing: Facing = "any" if table.angle_rad[row] > 0 else "all"
    return FeaturePiece(ends, planes, facing)


def _mesh_stretches(
    mesh: TriangleMesh, table: EdgeTable, ends: FloatArray, tolerance_mm: float
) -> list[_Stretch]:
    """The stretches of the segment that run along edges of the mesh."""
    length = float(np.linalg.norm(ends[1] - ends[0]))
    along = (ends[1] - ends[0]) / length
    offset = mesh.vertices_mm[table.vertices] - ends[0]
    place = offset @ along
    low = np.clip(place.min(axis=1), 0, length)
    high = np.clip(place.max(axis=1), 0, length)
    aside = _aside(offset - place[..., None] * along, place, low, high)
    folded = (np.abs(table.angle_rad) > _FLAT_RAD) | ~table.regular
    rows = np.flatnonzero(
        folded & (aside <= tolerance_mm) & (high - low > tolerance_mm)
    )
    return [
        _snapped(mesh, table, int(row), place[row], (low[row], high[row]), tolerance_mm)
        for row in rows
    ]


def _aside(
    across: FloatArray, place: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """How far mesh edges (k,) are from a line, at most, between two places on it.

    ``across`` (k, 2, 3) is the offset of the edges' ends from the line, ``place``
    (k, 2) where on the line they are.
    """
    run = place[:, 1] - place[:, 0]
    safe = np.where(np.abs(run) > 0, run, 1.0)
    share = (np.stack([low, high], axis=1) - place[:, :1]) / safe[:, None]
    slope = (across[:, 1] - across[:, 0])[:, None]
    there = across[:, :1] + np.clip(share, 0, 1)[..., None] * slope
    return np.asarray(np.linalg.norm(there, axis=-1).max(axis=1))


def _snapped(
    mesh: TriangleMesh,
    table: EdgeTable,
    row: int,
    place: FloatArray,
    span: tuple[float, float],
    tolerance_mm: float,
) -> _Stretch:
    """The span of one mesh edge, on the mesh edge itself, vertices where near."""
    order = np.argsort(place)
    corner = mesh.vertices_mm[table.vertices[row, order]]
    low, high = place[order]
    snapped = [
        low
        if abs(at - low) <= tolerance_mm
        else high
        if abs(at - high) <= tolerance_mm
        else at
        for at in span
    ]
    share = (np.array(snapped) - low) / (high - low)
    points = corner[0] + share[:, None] * (corner[1] - corner[0])
    points[share == 1] = corner[1]
    return _Stretch(snapped[0], snapped[1], edge_piece(mesh, table, row, points))


def _gaps(
    found: list[_Stretch], length: float, tolerance_mm: float
) -> list[tuple[float, float]]:
    """The parts of [0, length] that no stretch covers."""
    gaps, reached = [], 0.0
    for stretch in sorted(found, key=lambda each: each.low_mm):
        if stretch.low_mm > reached + tolerance_mm:
            gaps.append((reached, stretch.low_mm))
        reached = max(reached, stretch.high_mm)
    if length > reached + tolerance_mm:
        gaps.append((reached, length))
    return gaps


def _face_stretch(
    mesh: TriangleMesh,
    ends: FloatArray,
    gap: tuple[float, float],
    id: str,
    tolerance_mm: float,
) -> _Stretch:
    """A stretch that runs over faces: each face below it must look at the viewer."""
    length = float(np.linalg.norm(ends[1] - ends[0]))
    share = np.linspace(gap[0], gap[1], 33)[:, None] / length
    points = ends[0] + share * (ends[1] - ends[0])
    nearest = require_on_part(mesh, points, feature=id, tolerance_mm=tolerance_mm)
    inner = nearest.triangle[1:-1]
    planes = own_planes(mesh, inner, nearest.point_mm[16])
    planes[:, 3] = np.einsum("ij,ij->i", mesh.normals[inner], nearest.point_mm[1:-1])
    planes = planes[_distinct(planes)]
    lift = (planes[:, 3:] - planes[:, :3] @ points[[0, -1]].T).max(axis=0)
    raised = points[[0, -1]] + np.outer(lift, planes[0, :3])
    return _Stretch(gap[0], gap[1], FeaturePiece(raised, planes, "all"))


def _distinct(planes: FloatArray) -> IntArray:
    """Indices of planes that differ in direction."""
    close = planes[:, :3] @ planes[:, :3].T > 1 - 0.5 * _FLAT_RAD**2
    return np.flatnonzero(~np.tril(close, k=-1).any(axis=1))


def _joined(found: list[_Stretch], tolerance_mm: float) -> list[_Stretch]:
    """Join touching stretches that lie between the same planes."""
    joined: list[_Stretch] = []
    for stretch in found:
        last = joined[-1] if joined else None
        if (
            last is not None
            and abs(last.high_mm - stretch.low_mm) <= tolerance_mm
            and _same_rule(last.piece, stretch.piece)
        ):
            ends = np.stack([last.piece.vertices_mm[0], stretch.piece.vertices_mm[-1]])
            piece = FeaturePiece(ends, last.piece.planes, last.piece.facing)
            joined[-1] = _Stretch(last.low_mm, stretch.high_mm, piece)
        else:
            joined.append(stretch)
    return joined


def _same_rule(a: FeaturePiece, b: FeaturePiece) -> bool:
    """Whether two pieces have the same planes (in any order) and the same rule."""
    if a.planes.shape != b.planes.shape or a.facing != b.facing:
        return False
    gap = np.abs(a.planes[:, None] - b.planes[None]).max(axis=-1, initial=0.0)
    return bool((gap < _SAME_PLANE).any(axis=1).all())
