"""Find round holes: circular rims with a wall that turns towards its own axis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mvp.geometry import (
    BoolArray,
    EdgeTable,
    FloatArray,
    IntArray,
    TriangleMesh,
    edge_table,
    planar_patches,
    plane_axes,
)
from mvp.scene.cad_edges import sharp_edges, size_order
from mvp.scene.hole_feature import Circle, HoleFeature, fit_circle, mouth_pieces
from mvp.scene.polygons import boundary_rings, signed_area

# A hexagon is a socket, not a hole; coarse files draw a circle with 8 sides or more.
_FEWEST_SIDES = 8
# How far a rim may be from its circle: a share of the radius, never less than 2 um.
_ROUND_SHARE = 0.004
_ROUND_MM = 0.002
# Radius gained per depth; what opens faster is a dished face, not the wall of a hole.
_STEEPEST_CONE = 5.0
_RIM_ANGLE_DEG = 15.0


@dataclass(frozen=True, eq=False)
class _Topology:
    """A mesh with what the search asks again and again."""

    mesh: TriangleMesh
    table: EdgeTable
    patches: IntArray
    row_of: dict[tuple[int, int], int]

    def rows(self, ring: IntArray) -> IntArray:
        """Edge table rows of the sides of a ring of vertices."""
        pairs = zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True)
        return np.array([self.row_of[min(a, b), max(a, b)] for a, b in pairs])


@dataclass(frozen=True, eq=False)
class _Wall:
    """The round wall below a rim."""

    triangles: IntArray
    into_material: FloatArray
    depth_mm: float
    far_rows: IntArray


def find_holes(mesh: TriangleMesh) -> tuple[HoleFeature, ...]:
    """All circular rims of holes, largest first, named H1, H2, ...

    A through hole has two rims, and so has each step of a stepped hole: a rim is what
    a camera can see. Bosses, sockets with flat sides and oval holes are no holes here.
    """
    if not len(mesh.faces):
        return ()
    table = edge_table(mesh)
    ordered = np.sort(table.vertices, axis=1)
    row_of = {(int(a), int(b)): row for row, (a, b) in enumerate(ordered)}
    topology = _Topology(mesh, table, planar_patches(mesh, table), row_of)
    found = [hole for ring in _rings(topology) for hole in _holes_at(topology, ring)]
    found = _distinct(found)
    if not found:
        return ()
    size = np.array([hole.diameter_mm for hole in found])
    order = size_order(size, np.stack([hole.centre_mm for hole in found]))
    return tuple(
        replace(found[place], id=f"H{number + 1}") for number, place in enumerate(order)
    )


def _distinct(found: list[HoleFeature]) -> list[HoleFeature]:
    """One of each set of rims at the same place."""
    kept: list[HoleFeature] = []
    for hole in found:
        same = any(
            np.linalg.norm(other.centre_mm - hole.centre_mm) < 0.01
            and abs(other.diameter_mm - hole.diameter_mm) < 0.02
            and other.axis @ hole.axis > 0.99
            for other in kept
        )
        if not same:
            kept.append(hole)
    return kept


def _rings(topology: _Topology) -> list[IntArray]:
    """Closed rings of vertices that may be rims, each once."""
    rings = _inner_rings(topology) + _sharp_cycles(topology)
    return list({frozenset(ring.tolist()): ring for ring in rings}.values())


def _inner_rings(topology: _Topology) -> list[IntArray]:
    """Inner rings of planar patches."""
    mesh, rings = topology.mesh, []
    order = np.argsort(topology.patches, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(topology.patches[order]) > 0])
    for members in np.split(order, starts[1:]):
        if len(members) < _FEWEST_SIDES:
            continue
        axes = np.stack(plane_axes(mesh.normals[members[0]]))
        for ring in boundary_rings(mesh.faces[members]):
            flat = mesh.vertices_mm[ring] @ axes.T
            if len(ring) >= _FEWEST_SIDES and signed_area(flat) < 0:
                rings.append(ring)
    return rings


def _sharp_cycles(topology: _Topology) -> list[IntArray]:
    """Cycles of sharp edges at whose vertices no other sharp edge begins."""
    sharp = sharp_edges(topology.mesh, topology.table, min_angle_deg=_RIM_ANGLE_DEG)
    near: dict[int, list[int]] = {}
    for a, b in topology.table.vertices[sharp].tolist():
        near.setdefault(a, []).append(b)
        near.setdefault(b, []).append(a)
    seen: set[int] = set()
    cycles = []
    for start in sorted(near):
        cycle = _cycle(near, start, seen)
        if cycle is not None and len(cycle) >= _FEWEST_SIDES:
            cycles.append(np.array(cycle, dtype=np.int64))
    return cycles


def _cycle(near: dict[int, list[int]], start: int, seen: set[int]) -> list[int] | None:
    """The cycle through a vertex, if all its vertices have two sharp edges."""
    path: list[int] = []
    here, before = start, -1
    while here not in seen and len(near[here]) == 2:
        seen.add(here)
        path.append(here)
        following = near[here][0] if near[here][0] != before else near[here][1]
        before, here = here, following
    return path if path and here == start and len(path) > 2 else None


def _holes_at(topology: _Topology, ring: IntArray) -> list[HoleFeature]:
    """The hole whose rim a ring is, or none."""
    mesh, table = topology.mesh, topology.table
    points = mesh.vertices_mm[ring]
    circle = fit_circle(points)
    rows = topology.rows(ring)
    if not _is_round(points, circle) or float(np.median(table.angle_rad[rows])) < -0.01:
        return []
    wall = _wall(topology, ring, rows, circle)
    if wall is not None:
        axis, depth = -wall.into_material, wall.depth_mm
        through = bool(np.median(table.angle_rad[wall.far_rows]) > -0.01)
    elif table.boundary[rows].all() and _surrounds(mesh, table.faces[rows, 0], circle):
        axis, depth, through = mesh.normals[table.faces[rows[0], 0]], 0.0, True
    else:
        return []
    rim = points if circle.normal @ axis > 0 else points[::-1]
    return [
        HoleFeature(
            "H",
            circle.centre_mm,
            axis,
            2 * circle.radius_mm,
            depth,
            through,
            rim,
            circle.residual_mm,
            mouth_pieces(rim, axis, mesh),
        )
    ]


def _surrounds(mesh: TriangleMesh, beside: IntArray, circle: Circle) -> bool:
    """Whether the triangles at a ring lie outside of it."""
    middle = mesh.triangles_mm[beside].mean(axis=1) - circle.centre_mm
    return bool((np.linalg.norm(middle, axis=1) > circle.radius_mm).all())


def _is_round(points: FloatArray, circle: Circle) -> bool:
    """Whether all vertices are on the circle, once round, without a wide gap."""
    if circle.residual_mm > max(_ROUND_SHARE * circle.radius_mm, _ROUND_MM):
        return False
    first, second = plane_axes(circle.normal)
    offset = points - circle.centre_mm
    angle = np.arctan2(offset @ second, offset @ first)
    step = np.diff(np.append(angle, angle[0]))
    step = (step + np.pi) % (2 * np.pi) - np.pi
    return bool((step > 0).all() and step.max() < 1.0)


def _wall(
    topology: _Topology, ring: IntArray, rows: IntArray, circle: Circle
) -> _Wall | None:
    """The triangles of the cylinder or cone that hangs on a rim and turns inwards."""
    mesh = topology.mesh
    beside = topology.table.faces[rows]
    beside = np.unique(beside[beside >= 0])
    for sign in (1.0, -1.0):
        into = sign * circle.normal
        shape = _RoundShape.below(mesh, ring, beside, circle, into)
        if shape is None:
            continue
        members = shape.grown(topology, beside)
        covered = np.isin(topology.table.faces[rows], members).any(axis=1)
        if covered.mean() > 0.9:
            return _measured(topology, members, shape)
    return None


@dataclass(frozen=True, eq=False)
class _RoundShape:
    """A cylinder (slope 0) or cone: radius = r + slope * depth."""

    mesh: TriangleMesh
    circle: Circle
    into_material: FloatArray
    slope: float

    @classmethod
    def below(
        cls,
        mesh: TriangleMesh,
        ring: IntArray,
        beside: IntArray,
        circle: Circle,
        into_material: FloatArray,
    ) -> _RoundShape | None:
        """The shape through a rim and the deepest corners of the triangles beside it."""
        corners = np.setdiff1d(mesh.faces[beside], ring)
        probe = cls(mesh, circle, into_material, 0.0)
        depth, radius = probe.place(mesh.vertices_mm[corners])
        tolerance = max(_ROUND_SHARE * circle.radius_mm, _ROUND_MM)
        below = depth > tolerance
        if not below.any():
            return None
        slope = float(np.median((radius[below] - circle.radius_mm) / depth[below]))
        if abs(slope) > _STEEPEST_CONE:
            return None
        return cls(mesh, circle, into_material, slope if abs(slope) > 0.01 else 0.0)

    def place(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Depth below the rim and distance from the axis (...,), mm."""
        offset = points - self.circle.centre_mm
        depth = offset @ self.into_material
        aside = offset - depth[..., None] * self.into_material
        return depth, np.asarray(np.linalg.norm(aside, axis=-1))

    def fits(self) -> BoolArray:
        """Which triangles (m,) lie on the shape and face its axis."""
        depth, radius = self.place(self.mesh.vertices_mm)
        tolerance = 2 * max(_ROUND_SHARE * self.circle.radius_mm, _ROUND_MM)
        gap = np.abs(radius - self.circle.radius_mm - self.slope * depth)
        on = (gap <= tolerance) & (depth >= -tolerance)
        middle = self.mesh.triangles_mm.mean(axis=1) - self.circle.centre_mm
        along = self.mesh.normals @ self.into_material
        radial = middle - (middle @ self.into_material)[:, None] * self.into_material
        inwards = np.einsum("ij,ij->i", radial, self.mesh.normals) < 0
        flat = np.abs(along) > 0.985
        return np.asarray(on[self.mesh.faces].all(axis=1) & inwards & ~flat)

    def grown(self, topology: _Topology, beside: IntArray) -> IntArray:
        """Fitting triangles that are connected to those beside the rim."""
        fits = self.fits()
        faces = topology.table.faces
        both = faces[(faces >= 0).all(axis=1)]
        both = both[fits[both].all(axis=1)]
        inside = np.zeros(len(self.mesh.faces), dtype=bool)
        inside[beside[fits[beside]]] = True
        while True:
            touched = inside[both].any(axis=1) & ~inside[both].all(axis=1)
            if not touched.any():
                return np.flatnonzero(inside)
            inside[both[touched]] = True


def _measured(
    topology: _Topology, members: IntArray, shape: _RoundShape
) -> _Wall | None:
    """Depth of a wall, and the edges at its far end."""
    mesh, table = topology.mesh, topology.table
    depth, _ = shape.place(mesh.vertices_mm[mesh.faces[members]])
    deepest = float(depth.max())
    owned = np.isin(table.faces, members)
    edge_depth, _ = shape.place(mesh.vertices_mm[table.vertices])
    middle = edge_depth.mean(axis=1) > deepest / 2
    far = np.flatnonzero((owned.sum(axis=1) == 1) & middle)
    if not len(far):
        return None
    return _Wall(members, shape.into_material, deepest, far)
