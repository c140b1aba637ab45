"""Repair what can be repaired without a choice, and report the rest."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry.edges import edge_table
from mvp.geometry.mesh import TriangleMesh
from mvp.geometry.orientation import oriented
from mvp.geometry.patches import connected_labels

if TYPE_CHECKING:
    from mvp.geometry.arrays import FloatArray, IntArray

MERGE_MM = 1e-4
SLIVER_MM = 1e-6


@dataclass(frozen=True)
class HealingReport:
    """What was found in a mesh and what was done about it.

    Attributes:
        triangles: left after healing.
        vertices_merged: points that coincided with another to 1e-4 mm.
        degenerate_dropped: triangles without area (height below 1e-6 mm).
        duplicates_dropped: triangles that were there twice.
        faces_flipped: triangles turned so that neighbours agree on the outside.
        open_edges: edges with one triangle only.
        non_manifold_edges: edges with more than two, or still inconsistent, triangles.
        bodies: connected pieces.
        watertight: no open and no non-manifold edge: a solid, otherwise a soup.
    """

    triangles: int
    vertices_merged: int = 0
    degenerate_dropped: int = 0
    duplicates_dropped: int = 0
    faces_flipped: int = 0
    open_edges: int = 0
    non_manifold_edges: int = 0
    bodies: int = 1
    watertight: bool = True

    def lines(self) -> list[str]:
        """One sentence per finding, for a person."""
        kind = "closed solid" if self.watertight else "open surface (triangle soup)"
        body = "1 body" if self.bodies == 1 else f"{self.bodies} bodies"
        told = [f"{self.triangles} triangles, {body}, {kind}"]
        findings = (
            (self.degenerate_dropped, "triangles without area dropped"),
            (self.duplicates_dropped, "duplicate triangles dropped"),
            (self.faces_flipped, "flipped triangles turned to agree with the rest"),
            (self.open_edges, "open edges: there, faces hide from both sides"),
            (
                self.non_manifold_edges,
                "edges with more than two or disagreeing triangles: there, faces hide "
                "from both sides",
            ),
        )
        return told + [f"{count} {what}" for count, what in findings if count]

    def to_json(self) -> dict[str, int | bool]:
        """The counts as plain data."""
        return asdict(self)


def healed(mesh: TriangleMesh) -> tuple[TriangleMesh, HealingReport]:
    """Merge points, drop useless triangles, make neighbours agree on the outside.

    The face ids of the triangles that stay are kept.
    """
    merged, moved = _merged(mesh)
    solid = _selected(merged, _has_area(merged))
    unique = _selected(solid, _first_of_each(solid.faces))
    turned, flipped = oriented(unique)
    compact = _without_loose_points(turned)
    table = edge_table(compact)
    pairs = table.faces[table.faces[:, 1] >= 0]
    report = HealingReport(
        triangles=len(compact.faces),
        vertices_merged=moved,
        degenerate_dropped=len(mesh.faces) - len(solid.faces),
        duplicates_dropped=len(solid.faces) - len(unique.faces),
        faces_flipped=flipped,
        open_edges=int(table.boundary.sum()),
        non_manifold_edges=int(table.non_manifold.sum()),
        bodies=len(np.unique(connected_labels(pairs, len(compact.faces)))),
        watertight=bool(table.regular.all()),
    )
    return compact, report


def _merged(mesh: TriangleMesh) -> tuple[TriangleMesh, int]:
    """Give coinciding points one index; returns how many points that removed."""
    exact, index = np.unique(mesh.vertices_mm, axis=0, return_inverse=True)
    from scipy.spatial import cKDTree

    pairs = cKDTree(exact).query_pairs(MERGE_MM, output_type="ndarray")
    label = connected_labels(pairs.astype(np.int64), len(exact))
    first = np.unique(label, return_index=True)[1]
    faces = label[np.asarray(index).reshape(-1)[mesh.faces]]
    merged = TriangleMesh(exact[first], faces, mesh.face_ids, mesh.name)
    used = len(np.unique(mesh.faces))
    return merged, max(used - len(np.unique(faces)), 0)


def _selected(mesh: TriangleMesh, kept: IntArray) -> TriangleMesh:
    if len(kept) == len(mesh.faces):
        return mesh
    return TriangleMesh(
        mesh.vertices_mm, mesh.faces[kept], mesh.face_ids[kept], mesh.name
    )


def _has_area(mesh: TriangleMesh) -> IntArray:
    """Indices of triangles whose smallest height is at least the sliver limit."""
    corners = mesh.triangles_mm
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    longest = np.maximum(sides.max(axis=1), 1e-300)
    return np.flatnonzero(2 * mesh.areas_mm2 / longest >= SLIVER_MM)


def _first_of_each(faces: IntArray) -> IntArray:
    """Indices of triangles that are not the same, same way round, as an earlier one."""
    shift = np.argmin(faces, axis=1) if len(faces) else np.zeros(0, dtype=np.int64)
    columns = (np.arange(3)[None] + shift[:, None]) % 3
    turned = np.take_along_axis(faces, columns, axis=1)
    return np.sort(np.unique(turned, axis=0, return_index=True)[1])


def _without_loose_points(mesh: TriangleMesh) -> TriangleMesh:
    used, faces = np.unique(mesh.faces, return_inverse=True)
    vertices: FloatArray = mesh.vertices_mm[used]
    return TriangleMesh(
        vertices, np.asarray(faces).reshape(-1, 3), mesh.face_ids, mesh.name
    )
