"""Maximal straight sharp edges of a mesh: what a picture shows of its shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array, triu
from scipy.sparse.csgraph import connected_components

from mvp.geometry import BoolArray, EdgeTable, FloatArray, IntArray, edge_table

if TYPE_CHECKING:
    from mvp.geometry import TriangleMesh

# Single-precision files move a vertex by up to 3e-5 mm on a part of 0.5 m.
_STRAIGHT_MM = 2e-4
_STRAIGHT_RAD = np.deg2rad(1.0)
# Facets of a curved CAD face may meet at up to 0.5 rad.
_TESSELLATION_RAD = np.deg2rad(40.0)


@dataclass(frozen=True, eq=False)
class CadEdges:
    """Straight sharp edges, longest first; ties by coordinates.

    Attributes:
        start_mm: (k, 3).
        end_mm: (k, 3).
        normal_a: (k, 3) outward unit normal of one own face.
        normal_b: (k, 3) of the other; zero where there is none.
        convex: (k,) the material is on the inner side of both faces.
        boundary: (k,) edge of an open surface (or one with more than two faces).
        face_ids: (k, 2) CAD faces that meet, -1 for none.
    """

    start_mm: FloatArray
    end_mm: FloatArray
    normal_a: FloatArray
    normal_b: FloatArray
    convex: BoolArray
    boundary: BoolArray
    face_ids: IntArray

    def __len__(self) -> int:
        return len(self.start_mm)

    @property
    def length_mm(self) -> FloatArray:
        """(k,) lengths, mm."""
        return np.asarray(np.linalg.norm(self.end_mm - self.start_mm, axis=1))

    def subset(self, chosen: BoolArray | IntArray) -> CadEdges:
        """The chosen edges, by mask or by index."""
        return CadEdges(
            self.start_mm[chosen],
            self.end_mm[chosen],
            self.normal_a[chosen],
            self.normal_b[chosen],
            self.convex[chosen],
            self.boundary[chosen],
            self.face_ids[chosen],
        )


def cad_edges(mesh: TriangleMesh, *, min_angle_deg: float = 20.0) -> CadEdges:
    """Join collinear mesh edges between the same two faces to straight edges.

    An edge is sharp when its normals differ by at least ``min_angle_deg``; inside one
    curved CAD face the facets' own edges do not count. Edges of open surfaces and
    edges with more than two triangles are included and marked ``boundary``.
    """
    table = edge_table(mesh)
    chosen = np.flatnonzero(sharp_edges(mesh, table, min_angle_deg=min_angle_deg))
    vertices, faces = table.vertices[chosen], table.faces[chosen]
    group = _straight_groups(mesh, table, chosen)
    first, start, end = _ends(mesh, vertices, group)
    padded = np.vstack([mesh.normals, np.zeros(3)])
    ids = np.append(mesh.face_ids, -1)
    regular = table.regular[chosen][first]
    edges = CadEdges(
        start,
        end,
        padded[faces[first, 0]],
        np.where(regular[:, None], padded[faces[first, 1]], 0.0),
        np.asarray(table.angle_rad[chosen][first] > 0),
        np.asarray(~regular),
        ids[faces[first]],
    )
    return edges.subset(_longest_first(edges))


def sharp_edges(
    mesh: TriangleMesh, table: EdgeTable, *, min_angle_deg: float
) -> BoolArray:
    """Which rows of the edge table are sharp, open or non-manifold."""
    angle = np.abs(table.angle_rad)
    same_face = mesh.face_ids[table.faces[:, 0]] == mesh.face_ids[table.faces[:, 1]]
    tessellation = same_face & (angle < _TESSELLATION_RAD)
    sharp = (angle >= np.deg2rad(min_angle_deg)) & ~tessellation
    return np.asarray(sharp | ~table.regular)


def edge_neighbours(vertices: IntArray, vertex_count: int) -> IntArray:
    """Pairs (p, 2) of rows of ``vertices`` (k, 2) that share a vertex."""
    rows = np.arange(len(vertices))
    incidence = coo_array(
        (np.ones(2 * len(rows)), (np.repeat(rows, 2), vertices.ravel())),
        shape=(len(rows), vertex_count),
    ).tocsr()
    pairs = triu(incidence @ incidence.T, k=1).tocoo()
    return np.stack([pairs.row, pairs.col], axis=1).astype(np.int64)


def _straight_groups(
    mesh: TriangleMesh, table: EdgeTable, chosen: IntArray
) -> IntArray:
    """Label (k,) of the straight run that each chosen edge is part of."""
    vertices = table.vertices[chosen]
    pairs = edge_neighbours(vertices, len(mesh.vertices_mm))
    joined = pairs[_continues(mesh, table, chosen, pairs)]
    graph = coo_array(
        (np.ones(len(joined)), (joined[:, 0], joined[:, 1])),
        shape=(len(chosen), len(chosen)),
    )
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _continues(
    mesh: TriangleMesh, table: EdgeTable, chosen: IntArray, pairs: IntArray
) -> BoolArray:
    """Which pairs go straight on, of one kind, between faces of one direction."""
    left, right = chosen[pairs[:, 0]], chosen[pairs[:, 1]]
    a, b = table.vertices[left], table.vertices[right]
    swap_a = (a[:, 0] == b[:, 0]) | (a[:, 0] == b[:, 1])
    shared = np.where(swap_a, a[:, 0], a[:, 1])
    far_a = np.where(swap_a, a[:, 1], a[:, 0])
    far_b = np.where(b[:, 0] == shared, b[:, 1], b[:, 0])
    incoming = mesh.vertices_mm[shared] - mesh.vertices_mm[far_a]
    outgoing = mesh.vertices_mm[far_b] - mesh.vertices_mm[shared]
    cross = np.linalg.norm(np.cross(incoming, outgoing), axis=1)
    dot = np.einsum("ij,ij->i", incoming, outgoing)
    chord = np.linalg.norm(incoming + outgoing, axis=1)
    straight = (np.arctan2(cross, dot) < _STRAIGHT_RAD) & (
        cross <= _STRAIGHT_MM * np.maximum(chord, 1e-300)
    )
    same_kind = (np.sign(table.angle_rad[left]) == np.sign(table.angle_rad[right])) & (
        table.regular[left] == table.regular[right]
    )
    return np.asarray(straight & same_kind & _same_faces(mesh, table, left, right))


def _same_faces(
    mesh: TriangleMesh, table: EdgeTable, left: IntArray, right: IntArray
) -> BoolArray:
    """Whether two edges lie between faces of the same two directions."""
    normals = np.vstack([mesh.normals, np.zeros(3)])
    a, b = normals[table.faces[left]], normals[table.faces[right]]
    near = np.cos(_STRAIGHT_RAD)
    parallel = np.einsum("nik,njk->nij", a, b) > near
    none = (table.faces[left][:, :, None] < 0) & (table.faces[right][:, None, :] < 0)
    match = parallel | none
    return np.asarray(
        (match[:, 0, 0] & match[:, 1, 1]) | (match[:, 0, 1] & match[:, 1, 0])
    )


def _ends(
    mesh: TriangleMesh, vertices: IntArray, group: IntArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Per group: its longest mesh edge, and the two extreme vertices."""
    ends = mesh.vertices_mm[vertices]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    order = np.lexsort((-length, group))
    first = order[np.r_[True, np.diff(group[order]) > 0]] if len(order) else order
    longest = first[group]
    origin = ends[longest, 0]
    along = ends[longest, 1] - origin
    place = np.einsum("nik,nk->ni", ends - origin[:, None], along).ravel()
    label, points = np.repeat(group, 2), ends.reshape(-1, 3)
    by_place = np.lexsort((place, label))
    new = np.diff(label[by_place], prepend=-1) > 0
    start = by_place[new]
    end = by_place[np.r_[new[1:], True]] if len(new) else by_place
    low, high = points[start], points[end]
    swap = _after(low, high)[:, None]
    return first, np.where(swap, high, low), np.where(swap, low, high)


def _after(a: FloatArray, b: FloatArray) -> BoolArray:
    """Whether a (k, 3) comes after b in the order of rounded coordinates."""
    difference = np.round(a - b, 3)
    leading = np.argmax(difference != 0, axis=1)
    return np.asarray(difference[np.arange(len(a)), leading] > 0)


def _longest_first(edges: CadEdges) -> IntArray:
    """A total order that does not depend on the order of the triangles."""
    return size_order(edges.length_mm, (edges.start_mm + edges.end_mm) / 2)


def size_order(size: FloatArray, place: FloatArray) -> IntArray:
    """Largest first; equal sizes by coordinates, both to about 1e-3.

    The offset keeps round decimals away from the borders of the grid, where the last
    bit of a sum would decide.
    """
    offset = 0.3819660113
    cell = np.floor(place / 1e-3 + offset)
    rank = -np.floor(size / 1e-3 + offset)
    return np.asarray(np.lexsort((cell[:, 2], cell[:, 1], cell[:, 0], rank)))
