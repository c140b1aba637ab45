"""The locus of view points from which a feature is seen whole."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import igl
import numpy as np

from mvp.geometry import (
    BoolArray,
    Box,
    FloatArray,
    IntArray,
    TriangleMesh,
    as_points,
)
from mvp.visibility.binding import in_the_way
from mvp.visibility.facets import FacetDistances, FacetSet
from mvp.visibility.occluders import mesh_edges
from mvp.visibility.polygons import convex_patches
from mvp.visibility.solids import box_solid, mesh_arrays, without_slivers

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from manifold3d import Manifold
    from numpy.typing import ArrayLike

    from mvp.visibility.binding import Binding, FaceName

# A point this close to the boundary counts as not visible.
_BOUNDARY_MM = 1e-6
_WALL_SHARE = 1e-9
_FEW_PAIRS = 1 << 20


@dataclass(frozen=True)
class RegionStatistics:
    """How a region came about.

    Attributes:
        pieces: convex feature pieces.
        triangles: occluding triangles of the scene.
        kept: of those, the ones that can hide the feature at all.
        candidates: of those, the ones that see the feature whole at a sampled point.
        polygons: convex occluders that these were merged into.
        readmitted: triangles that the final check found to matter as well.
        two_sided_edges: edges of the scene without exactly two opposite triangles.
        seconds: time per stage, s.
    """

    pieces: int = 0
    triangles: int = 0
    kept: int = 0
    candidates: int = 0
    polygons: int = 0
    readmitted: int = 0
    two_sided_edges: int = 0
    seconds: Mapping[str, float] = field(default_factory=dict)

    def plus(self, other: RegionStatistics) -> RegionStatistics:
        """Totals over two feature pieces of the same scene."""
        stages = [*self.seconds, *(s for s in other.seconds if s not in self.seconds)]
        return RegionStatistics(
            pieces=self.pieces + other.pieces,
            triangles=max(self.triangles, other.triangles),
            kept=self.kept + other.kept,
            candidates=self.candidates + other.candidates,
            polygons=self.polygons + other.polygons,
            readmitted=self.readmitted + other.readmitted,
            two_sided_edges=max(self.two_sided_edges, other.two_sided_edges),
            seconds={
                stage: self.seconds.get(stage, 0.0) + other.seconds.get(stage, 0.0)
                for stage in stages
            },
        )


@dataclass(frozen=True, eq=False)
class Region:
    """View points, inside a workspace, that see every piece of a feature whole.

    Attributes:
        solid: the region as a solid; empty where nothing is seen.
        workspace: the box outside of which nothing counts as visible.
        walls: whether the sides of the workspace count as boundary in distances.
        exact: False where occluders were replaced by larger ones (never visible where
            it is not, but less visible than it is).
        statistics: how it came about.
        bindings: what takes view points away, one entry per feature piece.
    """

    solid: Manifold
    workspace: Box
    walls: bool
    exact: bool
    statistics: RegionStatistics
    bindings: tuple[Binding, ...] = ()

    @cached_property
    def mesh(self) -> TriangleMesh:
        """Boundary, mm, normals outward; ``face_ids`` are convex planar facets."""
        vertices, faces = mesh_arrays(self.solid)
        bare = TriangleMesh(
            vertices, faces, np.zeros(len(faces), dtype=np.int64), "visibility region"
        )
        edge_vertices, edge_faces = mesh_edges(faces)
        patches = convex_patches(
            vertices, faces, bare.normals, edge_vertices, edge_faces
        )
        return TriangleMesh(vertices, faces, patches.polygon_of, bare.name)

    @property
    def empty(self) -> bool:
        """Nothing sees the feature whole."""
        return bool(self.solid.is_empty())

    @cached_property
    def volume_mm3(self) -> float:
        """Volume, mm^3."""
        return float(self.solid.volume())

    @cached_property
    def on_wall(self) -> BoolArray:
        """(m,) triangles of the mesh that lie in a side of the workspace."""
        triangles = self.mesh.triangles_mm
        slack = _WALL_SHARE * self.workspace.diagonal_mm
        low = (np.abs(triangles - self.workspace.low_mm) <= slack).all(axis=1)
        high = (np.abs(triangles - self.workspace.high_mm) <= slack).all(axis=1)
        return np.asarray(np.logical_or(low, high).any(axis=1))

    @property
    def binding(self) -> str:
        """What takes the most view points away, in words; faces by their ids."""
        return self.in_the_way(lambda face: f"face {face}")

    def in_the_way(self, name_face: FaceName) -> str:
        """What takes the most view points away, faces called by ``name_face(id)``."""
        return in_the_way(self.bindings, name_face)

    def narrowed(self, rest: Region) -> Region:
        """A part of this region, with the history of both."""
        return replace(
            rest,
            exact=self.exact and rest.exact,
            statistics=self.statistics.plus(rest.statistics),
            bindings=self.bindings + rest.bindings,
        )

    def contains(self, points_mm: ArrayLike) -> BoolArray:
        """Which points (N, 3) see the feature whole; the boundary itself does not."""
        points = as_points(points_mm).reshape(-1, 3)
        inside = self._inside(points)
        rows = np.flatnonzero(inside)
        inside[rows] = self._everything.closest(points[rows])[0] > _BOUNDARY_MM
        return inside

    def signed_distance(self, points_mm: ArrayLike) -> FloatArray:
        """Distance (N,) to the region's boundary, mm, positive inside.

        Without walls the sides of the workspace do not count; where then nothing is
        left to measure, and where the region is empty, the answer is plus or minus the
        diagonal of the workspace.
        """
        return self.signed_distance_gradient(points_mm)[0]

    def signed_distance_gradient(
        self, points_mm: ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Signed distance (N,), mm, and its gradient (N, 3), a unit vector."""
        points = as_points(points_mm).reshape(-1, 3)
        inside = self._inside(points)
        distance = np.where(inside, 1.0, -1.0) * self.workspace.diagonal_mm
        gradient = np.zeros_like(points)
        for side, counted in ((True, self._counted), (False, self._everything)):
            rows = np.flatnonzero(inside == side)
            length, towards, inward = counted.closest(points[rows])
            found = np.isfinite(length)
            rows, length = rows[found], length[found]
            sign = 1.0 if side else -1.0
            scale = np.where(length > 1e-9, length, 1.0)[:, None]
            unit = sign * towards[found] / scale
            distance[rows] = sign * length
            gradient[rows] = np.where(length[:, None] > 1e-9, unit, inward[found])
        doubtful = (distance > 0) & (distance <= _BOUNDARY_MM)
        distance[doubtful] = -distance[doubtful]
        return distance, gradient

    def nearest_facets(self, points_mm: ArrayLike, k: int) -> FacetDistances:
        """The k nearest facets of points (N, 3), walls only if they count.

        A facet is a convex polygon, so its distance is a convex function: a step s
        shortens it by at most -direction . s.
        """
        points = as_points(points_mm).reshape(-1, 3)
        return self._counted.facets.nearest(points, k, self.workspace.diagonal_mm)

    def _inside(self, points: FloatArray) -> BoolArray:
        """Side of the boundary by winding number; outside the box is outside.

        The normal at the closest point would not do: two faces of a fin without
        thickness are equally close and look in opposite directions.
        """
        if self.empty:
            return np.zeros(len(points), dtype=np.bool_)
        inside = self.workspace.contains(points)
        rows = np.flatnonzero(inside)
        inside[rows] = self._winding(points[rows]) > 0.5
        return inside

    def _winding(self, points: FloatArray) -> FloatArray:
        """Winding number (n,) of the mesh about points (n, 3)."""
        vertices, faces = self._everything.vertices_mm, self._everything.faces
        points = np.ascontiguousarray(points)
        if len(points) * len(faces) <= _FEW_PAIRS:
            return np.asarray(igl.winding_number(vertices, faces, points)).reshape(-1)
        return np.asarray(igl.fast_winding_number(vertices, faces, points))

    @cached_property
    def _everything(self) -> Boundary:
        return Boundary.of(self.mesh, np.ones(len(self.mesh.faces), dtype=np.bool_))

    @cached_property
    def _counted(self) -> Boundary:
        if self.walls or not self.on_wall.any():
            return self._everything
        return Boundary.of(self.mesh, ~self.on_wall)


@dataclass(frozen=True, eq=False)
class Boundary:
    """A part of a mesh with its search tree.

    Attributes:
        vertices_mm: (n, 3) of the whole mesh.
        faces: (m, 3) those that count.
        facets: the same triangles, for nearest-facet queries.
    """

    vertices_mm: FloatArray
    faces: IntArray
    facets: FacetSet

    @classmethod
    def of(cls, mesh: TriangleMesh, counted: BoolArray) -> Boundary:
        """The triangles of a mesh that count."""
        return cls(
            np.array(mesh.vertices_mm),
            np.ascontiguousarray(mesh.faces[counted]),
            FacetSet(
                mesh.triangles_mm[counted],
                mesh.face_ids[counted],
                -mesh.normals[counted],
            ),
        )

    @cached_property
    def _tree(self) -> igl.AABB:
        tree = igl.AABB()
        tree.init(self.vertices_mm, self.faces)
        return tree

    def closest(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance (n,), vector from the closest point (n, 3), inward normal (n, 3)."""
        if not len(self.faces) or not len(points):
            nothing = np.zeros((len(points), 3))
            return np.full(len(points), np.inf), nothing, nothing
        squared, index, closest = self._tree.squared_distance(
            self.vertices_mm, self.faces, np.ascontiguousarray(points)
        )
        index = np.asarray(index).reshape(-1)
        inward = self.facets.inward[index]
        return np.sqrt(np.asarray(squared).reshape(-1)), points - closest, inward


def intersection(regions: Sequence[Region]) -> Region:
    """View points of all regions at once; they share one workspace.

    Raises:
        ValueError: no region, or different workspaces.
    """
    if not regions:
        raise ValueError("an intersection needs at least one region")
    first = regions[0]
    if len(regions) == 1:
        return first
    solid, statistics = first.solid, first.statistics
    for region in regions[1:]:
        if not _same_box(region.workspace, first.workspace):
            raise ValueError("regions of different workspaces cannot be intersected")
        solid = solid ^ region.solid
        solid.num_tri()
        statistics = statistics.plus(region.statistics)
    return Region(
        trimmed(solid, first.workspace),
        first.workspace,
        any(region.walls for region in regions),
        all(region.exact for region in regions),
        statistics,
        tuple(binding for region in regions for binding in region.bindings),
    )


def trimmed(solid: Manifold, workspace: Box) -> Manifold:
    """Without components that are too thin for any view point to be safe in."""
    thickness = 1e-2 + 1e-6 * workspace.diagonal_mm
    return without_slivers(solid, thickness, 1e-6 * box_solid(workspace).volume())


def _same_box(a: Box, b: Box) -> bool:
    return bool((a.low_mm == b.low_mm).all() and (a.high_mm == b.high_mm).all())
