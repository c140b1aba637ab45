"""From occluders and convex feature pieces to the region that sees them whole."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from mvp.geometry import BoolArray, Box, FeaturePiece, FloatArray, IntArray
from mvp.visibility.binding import Binding
from mvp.visibility.clusters import ClusterRule, clustered
from mvp.visibility.culling import OwnFaces, possible_occluders, visible_first
from mvp.visibility.leftovers import reaching_into
from mvp.visibility.pieces import separate_pieces
from mvp.visibility.polygons import convex_patches
from mvp.visibility.region import Region, RegionStatistics, trimmed
from mvp.visibility.rooms import Room
from mvp.visibility.shadows import Caster
from mvp.visibility.solids import box_solid, mesh_arrays, seen_side, union

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
    first, *rest = separate_pieces(occluders, pieces)
    region = _Job(occluders, first, workspace, cluster_mm, clock).region(None, walls)
    for piece in rest:
        if region.empty:
            break
        job = _Job(occluders, piece, workspace, cluster_mm, clock)
        region = job.region(region, walls)
    return region


@dataclass
class _Job:
    """The region of one convex piece."""

    occluders: Occluders
    piece: FeaturePiece
    workspace: Box
    cluster_mm: float | None
    clock: Clock
    seconds: dict[str, float] = field(default_factory=dict)

    def region(self, before: Region | None, walls: bool) -> Region:
        """What is left of the region of the pieces before.

        Cull, sort, unite, subtract, and check what was left out.
        """
        own = OwnFaces.of(self.piece)
        room = self._timed("cull", lambda: self._room(before))
        kept = self._timed("cull", lambda: self._kept(own, room))
        first = self._timed("candidates", lambda: self._first(kept, own))
        merged = self._timed("merge", lambda: self._merged(kept[first]))
        open_room = seen_side(room.solid, own)
        shadows = [self._timed("union", lambda: self._shadow(*merged))]
        loose = self._timed("subtract", lambda: _without(open_room, shadows))
        late = self._timed("check", lambda: self._late(loose, kept[~first]))
        if len(late):
            more = self._merged(late)
            shadows.append(self._timed("repair", lambda: self._shadow(*more)))
        if len(room.planes):
            known = box_solid(self.workspace) if before is None else before.solid
            loose, rest = seen_side(known, own), shadows
        else:
            rest = shadows[1:]
        solid = self._timed("subtract", lambda: _without(loose, rest))
        solid = self._timed("trim", lambda: trimmed(solid, self.workspace))
        feature = self.piece.vertices_mm
        bindings = (Binding(self.occluders, feature, own, self.workspace),)
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
        region = Region(
            solid, self.workspace, walls, not merged[1], statistics, bindings
        )
        return region if before is None else before.narrowed(region)

    def _timed(self, stage: str, work: Callable[[], T]) -> T:
        start = self.clock()
        result = work()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + self.clock() - start
        return result

    def _room(self, before: Region | None) -> Room:
        return Room.of(self.workspace, before, self.piece.vertices_mm)

    def _kept(self, own: OwnFaces, room: Room) -> IntArray:
        scene = self.occluders
        kept = possible_occluders(scene, self.piece.vertices_mm, own)
        return np.asarray(kept[room.holds(scene.triangles_mm[kept])])

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
        return clustered(scene.vertices_mm, patches, normals, edges[1], rule)

    def _shadow(self, polygons: list[FloatArray], hulls: list[FloatArray]) -> Manifold:
        """Union of the shadows of convex occluders, neighbours first."""
        feature = self.piece.vertices_mm
        corners = self.workspace.corners()
        box = Box.around(np.concatenate([corners, feature]))
        caster = Caster(feature, box, self._reach())
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


def _without(solid: Manifold, shadows: list[Manifold]) -> Manifold:
    """Solid without shadows, evaluated at once."""
    for shadow in shadows:
        solid = solid - shadow
        solid.num_tri()
    return solid
