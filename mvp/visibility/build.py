"""From occluders and convex feature pieces to the region that sees them whole."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from mvp.errors import FeatureError
from mvp.geometry import BoolArray, Box, FeaturePiece, FloatArray, IntArray
from mvp.visibility.binding import Binding
from mvp.visibility.clusters import ClusterRule, clustered
from mvp.visibility.culling import OwnFaces, possible_occluders, visible_first
from mvp.visibility.leftovers import edges_cross, reaching_into
from mvp.visibility.polygons import convex_patches
from mvp.visibility.region import Region, RegionStatistics, intersection, trimmed
from mvp.visibility.shadows import Caster
from mvp.visibility.solids import mesh_arrays, seen_side, union

if TYPE_CHECKING:
    from manifold3d import Manifold

    from mvp.visibility.occluders import Occluders

T = TypeVar("T")
Clock: TypeAlias = Callable[[], float]
_FEW = 24


def visibility_region(
    occluders: Occluders,
    pieces: Sequence[FeaturePiece],
    workspace: Box,
    *,
    walls: bool = False,
    cluster_mm: float | None = None,
    clock: Clock = time.perf_counter,
) -> Region:
    """All view points of the workspace from which every piece is seen whole.

    Args:
        occluders: the prepared scene, same frame as the pieces.
        pieces: convex pieces of one feature, or of several.
        workspace: box of view points, mm.
        walls: whether the sides of the workspace count in distances to the boundary.
        cluster_mm: allowed thickness of groups of triangles that are replaced by their
            hull, mm: faster on dense curved parts, and then not exact but safe.
        clock: seconds, for the statistics.

    Raises:
        FeatureError: no piece, or a piece without vertices.
    """
    if not pieces or any(not len(piece.vertices_mm) for piece in pieces):
        raise FeatureError(
            "a feature without any point cannot be seen",
            hint="give at least one convex piece with at least one vertex",
        )
    snapped = [
        FeaturePiece(occluders.snapped(piece.vertices_mm), piece.planes, piece.facing)
        for piece in pieces
    ]
    regions: list[Region] = []
    for part in (part for piece in snapped for part in _unpierced(occluders, piece)):
        job = _Job(occluders, part, workspace, cluster_mm, clock)
        regions = [intersection([*regions, job.region(walls)])]
        if regions[0].empty:
            break
    return regions[0]


def _unpierced(occluders: Occluders, piece: FeaturePiece) -> list[FeaturePiece]:
    """The piece, or the sides of its outline where something passes through it."""
    vertices = piece.vertices_mm
    if len(vertices) < 3 or not _pierced(occluders, vertices):
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


@dataclass
class _Job:
    """The region of one convex piece."""

    occluders: Occluders
    piece: FeaturePiece
    workspace: Box
    cluster_mm: float | None
    clock: Clock
    seconds: dict[str, float] = field(default_factory=dict)

    def region(self, walls: bool) -> Region:
        """Cull, sort, unite, subtract, and check what was left out."""
        own = OwnFaces.of(self.piece)
        kept = self._timed("cull", lambda: self._kept(own))
        first = self._timed("candidates", lambda: self._first(kept, own))
        merged = self._timed("merge", lambda: self._merged(kept[first]))
        seen = seen_side(self.workspace, own)
        shadow = self._timed("union", lambda: self._shadow(*merged))
        solid = self._timed("subtract", lambda: _difference(seen, shadow))
        late = self._timed("check", lambda: self._late(solid, kept[~first]))
        if len(late):
            more = self._merged(late)
            shadow = self._timed("repair", lambda: self._shadow(*more))
            solid = self._timed("repair", lambda: _difference(solid, shadow))
        statistics = RegionStatistics(
            pieces=1,
            triangles=len(self.occluders.faces),
            kept=len(kept),
            candidates=int(first.sum()),
            polygons=sum(map(len, merged)),
            readmitted=len(late),
            two_sided_edges=self.occluders.bad_edges,
            seconds=self.seconds,
        )
        solid = self._timed("trim", lambda: trimmed(solid, self.workspace))
        feature = self.piece.vertices_mm
        binding = Binding(self.occluders, feature, own, self.workspace)
        return Region(
            solid, self.workspace, walls, not merged[1], statistics, (binding,)
        )

    def _timed(self, stage: str, work: Callable[[], T]) -> T:
        start = self.clock()
        result = work()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + self.clock() - start
        return result

    def _kept(self, own: OwnFaces) -> IntArray:
        return possible_occluders(self.occluders, self.piece.vertices_mm, own)

    def _first(self, kept: IntArray, own: OwnFaces) -> BoolArray:
        if len(kept) <= _FEW:
            return np.ones(len(kept), dtype=np.bool_)
        return visible_first(self.occluders, kept, self.piece.vertices_mm, own)

    def _merged(self, triangles: IntArray) -> tuple[list[FloatArray], list[FloatArray]]:
        """Convex polygons that stand for triangles, and larger hulls if allowed."""
        scene = self.occluders
        where = np.full(len(scene.faces), -1, dtype=np.int64)
        where[triangles] = np.arange(len(triangles))
        edge_faces = where[scene.edge_faces]
        inner = (edge_faces >= 0).all(axis=1)
        faces, normals = scene.faces[triangles], scene.normals[triangles]
        edges = scene.edge_vertices[inner], edge_faces[inner]
        patches = convex_patches(scene.vertices_mm, faces, normals, *edges)
        if self.cluster_mm is None:
            return [scene.vertices_mm[loop] for loop in patches.loops], []
        rule = ClusterRule(self.cluster_mm, self.piece.vertices_mm)
        return clustered(scene.vertices_mm, patches, normals, *edges, rule)

    def _shadow(self, polygons: list[FloatArray], hulls: list[FloatArray]) -> Manifold:
        """Union of the shadows of convex occluders, neighbours first."""
        feature = self.piece.vertices_mm
        caster = Caster(feature, self.workspace, self._reach())
        solids = [caster.shadow(polygon) for polygon in polygons]
        solids += [caster.shadow_of_hull(points) for points in hulls]
        middles = np.array([outline.mean(axis=0) for outline in polygons + hulls])
        away = middles.reshape(-1, 3) - feature.mean(axis=0)
        length = np.linalg.norm(away, axis=1, keepdims=True)
        return union(solids, away / np.maximum(length, 1e-300))

    def _reach(self) -> float:
        """Longest distance between a point of the scene and one of the workspace."""
        corners = np.concatenate(
            [self.workspace.corners(), self.piece.vertices_mm, self.occluders.bounds]
        )
        return float(np.linalg.norm(np.ptp(corners, axis=0)))

    def _late(self, solid: Manifold, hidden: IntArray) -> IntArray:
        """Triangles left out that reach into the region nevertheless."""
        triangles = self.occluders.triangles_mm[hidden]
        return hidden[reaching_into(triangles, *mesh_arrays(solid))]


def _difference(solid: Manifold, shadow: Manifold) -> Manifold:
    """Solid without shadow, evaluated at once."""
    rest = solid - shadow
    rest.num_tri()
    return rest
