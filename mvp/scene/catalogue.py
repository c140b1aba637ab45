"""What can be asked for on a part: its edges, holes and planar faces, with ids."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mvp.errors import FeatureError
from mvp.geometry import (
    EdgeTable,
    FloatArray,
    IntArray,
    TriangleMesh,
    edge_table,
    face_groups,
    planar_patches,
)
from mvp.scene.cad_edges import CadEdges, cad_edges, size_order
from mvp.scene.edge_feature import edge_feature
from mvp.scene.face_feature import patch_face
from mvp.scene.holes import find_holes

if TYPE_CHECKING:
    from mvp.scene.features import Feature, Kind
    from mvp.scene.hole_feature import HoleFeature

# What is listed is at least this part of the diagonal of the part's box long, or a
# square of that side large: relative, so that a file read in another unit has the same
# features with the same ids. On a part of 1 m: 0.1 mm and 0.56 mm^2.
_SHORTEST_EDGE = 1e-4
_SMALLEST_FACE = 7.5e-4
# Sides of a polygon that stands for a curve turn by less than this.
_CURVE_RAD = np.deg2rad(40.0)
_SIMILAR_LENGTH = 1.2


@dataclass(frozen=True, eq=False)
class Entry:
    """One line of the catalogue.

    Attributes:
        id: name to use in a task.
        kind: edge, hole or face.
        size: length in mm, diameter in mm, or area in mm^2.
        position_mm: (3,) middle of an edge, centre of a rim, centroid of a face.
        direction: (3,) unit: along an edge, out of a hole, normal of a face.
        note: what else a person wants to know.
    """

    id: str
    kind: Kind
    size: float
    position_mm: FloatArray
    direction: FloatArray
    note: str

    def to_json(self) -> dict[str, Any]:
        """Plain data, the unit of the size in its key."""
        key = {"edge": "length_mm", "hole": "diameter_mm"}.get(self.kind, "area_mm2")
        return {
            "id": self.id,
            "kind": self.kind,
            key: round(self.size, 6),
            "position_mm": np.round(self.position_mm, 6).tolist(),
            "direction": np.round(self.direction, 9).tolist(),
            "note": self.note,
        }


@dataclass(frozen=True, eq=False)
class FeatureCatalogue:
    """All features found on a part, each kind from large to small.

    The same file gives the same ids, whatever the order of its triangles.

    Attributes:
        mesh: the part.
        edges: straight sharp edges E1, E2, ...
        holes: rims of round holes H1, H2, ...
        patches: triangles of the planar faces F1, F2, ...
    """

    mesh: TriangleMesh
    edges: CadEdges
    holes: tuple[HoleFeature, ...]
    patches: tuple[IntArray, ...]

    @cached_property
    def _table(self) -> EdgeTable:
        return edge_table(self.mesh)

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        """One line each: edges, holes, faces."""
        return (*self._edge_entries(), *self._hole_entries(), *self._face_entries())

    @property
    def ids(self) -> tuple[str, ...]:
        """All names."""
        return tuple(entry.id for entry in self.entries)

    def feature(self, ref: str, *, id: str | None = None) -> Feature:
        """The feature that an id of this catalogue names, itself named ``id``.

        Raises:
            FeatureError: there is no such id on this part.
        """
        kind, number = ref[:1], int(ref[1:] or 0) - 1 if ref[1:].isdecimal() else -1
        name = id or ref
        if kind == "E" and 0 <= number < len(self.edges):
            ends = self.edges.start_mm[number], self.edges.end_mm[number]
            return edge_feature(name, *ends, self.mesh, table=self._table)
        if kind == "H" and 0 <= number < len(self.holes):
            return replace(self.holes[number], id=name)
        if kind == "F" and 0 <= number < len(self.patches):
            return patch_face(name, self.mesh, self.patches[number])
        raise self._unknown(ref)

    def _unknown(self, ref: str) -> FeatureError:
        close = difflib.get_close_matches(ref, self.ids, n=3)
        there = f"E1-E{len(self.edges)}, H1-H{len(self.holes)}, F1-F{len(self.patches)}"
        meant = f"did you mean {', '.join(close)}? " if close else ""
        return FeatureError(
            f"{self.mesh.name} has no feature '{ref}'; it has {there}",
            hint=f"{meant}list them with `mvp-cell features PART`",
            where=ref,
        )

    def _edge_entries(self) -> list[Entry]:
        edges = self.edges
        direction = edges.end_mm - edges.start_mm
        kinds = np.where(
            edges.boundary, "open", np.where(edges.convex, "convex", "reflex")
        )
        return [
            Entry(
                f"E{i + 1}",
                "edge",
                float(edges.length_mm[i]),
                (edges.start_mm[i] + edges.end_mm[i]) / 2,
                direction[i] / np.linalg.norm(direction[i]),
                f"{kinds[i]} {_angle_text(edges, i)}",
            )
            for i in range(len(edges))
        ]

    def _hole_entries(self) -> list[Entry]:
        return [
            Entry(
                hole.id,
                "hole",
                hole.diameter_mm,
                hole.centre_mm,
                hole.axis,
                f"{'through' if hole.through else 'blind'} {hole.depth_mm:.3g}, "
                f"±{hole.polygon_error_mm:.2g}",
            )
            for hole in self.holes
        ]

    def _face_entries(self) -> list[Entry]:
        entries = []
        for number, members in enumerate(self.patches):
            area, centre, normal = patch_measures(self.mesh, members)
            note = f"{len(members)} triangles"
            entries.append(Entry(f"F{number + 1}", "face", area, centre, normal, note))
        return entries


def _angle_text(edges: CadEdges, row: int) -> str:
    if edges.boundary[row]:
        return "(one face)"
    cosine = float(np.clip(edges.normal_a[row] @ edges.normal_b[row], -1, 1))
    turn = np.rad2deg(np.arccos(cosine))
    inside = 180 - turn if edges.convex[row] else 180 + turn
    return f"{inside:.0f}°"


def patch_measures(
    mesh: TriangleMesh, members: IntArray
) -> tuple[float, FloatArray, FloatArray]:
    """Area (mm^2), centroid (3,) and unit normal (3,) of coplanar triangles."""
    areas = mesh.areas_mm2[members]
    centroid = areas @ mesh.triangles_mm[members].mean(axis=1) / areas.sum()
    normal = areas @ mesh.normals[members]
    return float(areas.sum()), centroid, normal / np.linalg.norm(normal)


def extract_features(
    mesh: TriangleMesh, *, min_angle_deg: float = 20.0
) -> FeatureCatalogue:
    """Find the straight sharp edges, round holes and planar faces of a part.

    Sides of polygons that stand for curves are not edges, and facets of curved
    surfaces are not faces; rims of holes are found as holes.
    """
    known = len(np.unique(mesh.face_ids)) > 1
    grouped = mesh
    if not known:
        ids = face_groups(mesh)
        grouped = TriangleMesh(mesh.vertices_mm, mesh.faces, ids, mesh.name)
    edges = cad_edges(grouped, min_angle_deg=min_angle_deg)
    shortest_mm = _SHORTEST_EDGE * _diagonal_mm(mesh)
    straight = ~_on_curve(edges) & (edges.length_mm >= shortest_mm)
    return FeatureCatalogue(
        grouped, edges.subset(straight), find_holes(grouped), planar_faces(grouped)
    )


def _diagonal_mm(mesh: TriangleMesh) -> float:
    if not len(mesh.vertices_mm):
        return 0.0
    return float(np.linalg.norm(np.ptp(mesh.vertices_mm, axis=0)))


def planar_faces(mesh: TriangleMesh) -> tuple[IntArray, ...]:
    """Triangles of each planar face, largest first: F1, F2, ..."""
    if not len(mesh.faces):
        return ()
    patch = planar_patches(mesh)
    pairs = np.unique(np.column_stack([mesh.face_ids, patch]), axis=0)
    _, index, count = np.unique(pairs[:, 0], return_inverse=True, return_counts=True)
    curved = np.zeros(int(patch.max(initial=-1)) + 1, dtype=bool)
    curved[pairs[count[index] > 1, 1]] = True
    order = np.argsort(patch, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(patch[order]) > 0])[1:]
    groups = [g for g in np.split(order, starts) if len(g) and not curved[patch[g[0]]]]
    measured = [patch_measures(mesh, group) for group in groups]
    smallest_mm2 = (_SMALLEST_FACE * _diagonal_mm(mesh)) ** 2
    kept = [i for i, m in enumerate(measured) if m[0] >= smallest_mm2]
    if not kept:
        return ()
    size = np.array([measured[i][0] for i in kept])
    place = np.stack([measured[i][1] for i in kept])
    return tuple(groups[kept[i]] for i in size_order(size, place))


def _on_curve(edges: CadEdges) -> IntArray:
    """Which edges (k,) are sides of a polygon that stands for a curve."""
    ends = np.concatenate([edges.start_mm, edges.end_mm])
    row = np.tile(np.arange(len(edges)), 2)
    away = np.concatenate([edges.end_mm - edges.start_mm] * 2)
    away[len(edges) :] *= -1
    point = np.unique(np.round(ends, 3), axis=0, return_inverse=True)[1].reshape(-1)
    first, second = _pairs_at_points(point)
    cross = np.linalg.norm(np.cross(away[first], away[second]), axis=1)
    dot = np.einsum("ij,ij->i", away[first], away[second])
    bend = np.pi - np.arctan2(cross, dot)
    a, b = row[first], row[second]
    ids = np.sort(edges.face_ids, axis=1)
    same_faces = (ids[a] == ids[b]).all(axis=1)
    ratio = edges.length_mm[a] / edges.length_mm[b]
    similar = np.maximum(ratio, 1 / ratio) < _SIMILAR_LENGTH
    similar &= (edges.face_ids[a][:, :, None] == edges.face_ids[b][:, None]).any((1, 2))
    curve = (bend < _CURVE_RAD) & (same_faces | similar)
    marked = np.zeros(len(edges), dtype=bool)
    marked[a[curve]] = True
    marked[b[curve]] = True
    return marked


def _pairs_at_points(point: IntArray) -> tuple[IntArray, IntArray]:
    """All pairs of rows with the same point label."""
    order = np.argsort(point, kind="stable")
    sizes = np.bincount(point)
    start = np.cumsum(sizes) - sizes
    first, second = [], []
    for size in np.unique(sizes[sizes > 1]):
        begin = start[sizes == size]
        a, b = np.triu_indices(size, k=1)
        first.append(order[begin[:, None] + a].ravel())
        second.append(order[begin[:, None] + b].ravel())
    if not first:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    return np.concatenate(first), np.concatenate(second)
