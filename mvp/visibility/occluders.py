"""What hides features: triangles cleaned once per part and ready for every feature."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mvp.visibility.rays import RayScene

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray, TriangleMesh

_MERGE_MM = 1e-4
_MERGE_SHARE = 1e-6
_SLIVER_SHARE = 1e-8
_SIDE_SHARE = 1e-7


@dataclass(frozen=True, eq=False)
class Occluders:
    """Cleaned triangles of a scene, solids and soups alike.

    Attributes:
        vertices_mm: (n, 3) merged vertices.
        faces: (m, 3) vertex indices.
        face_ids: (m,) ids of the faces of the mesh they come from.
        bodies: (m,) connected body of every triangle.
        two_sided: (m,) triangles of bodies that do not bound a volume properly; they
            hide from both sides.
        edge_vertices: (e, 2) edges between exactly two opposite triangles.
        edge_faces: (e, 2) those two triangles; the first runs along the edge.
        bad_edges: number of edges that are open or shared by more than two triangles.
        extent_mm: largest side of the bounding box, mm.
    """

    vertices_mm: FloatArray
    faces: IntArray
    face_ids: IntArray
    bodies: IntArray
    two_sided: BoolArray
    edge_vertices: IntArray
    edge_faces: IntArray
    bad_edges: int
    extent_mm: float

    @cached_property
    def triangles_mm(self) -> FloatArray:
        """Corner points (m, 3, 3), mm."""
        return np.asarray(self.vertices_mm[self.faces])

    @cached_property
    def normals(self) -> FloatArray:
        """Unit normals (m, 3)."""
        a, b, c = np.moveaxis(self.triangles_mm, 1, 0)
        cross = np.cross(b - a, c - a)
        return np.asarray(cross / np.linalg.norm(cross, axis=1, keepdims=True))

    @cached_property
    def offsets_mm(self) -> FloatArray:
        """Plane offsets (m,): n . x = offset on the triangle, mm."""
        return np.asarray((self.normals * self.triangles_mm.mean(axis=1)).sum(axis=1))

    @cached_property
    def rays(self) -> RayScene:
        """The triangles as an Embree scene."""
        return RayScene(self.triangles_mm)

    @cached_property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner (2, 3) of the scene, mm; (0, 3) if there is none."""
        if not len(self.vertices_mm):
            return np.zeros((0, 3))
        return np.stack([self.vertices_mm.min(axis=0), self.vertices_mm.max(axis=0)])

    @cached_property
    def vertex_tree(self) -> cKDTree:
        """Nearest-vertex lookup."""
        return cKDTree(self.vertices_mm)

    @cached_property
    def side_tolerance_mm(self) -> float:
        """Below this height over a plane a point counts as lying on it, mm.

        Files in single precision round coordinates by this share of their size.
        """
        farthest = float(np.abs(self.vertices_mm).max(initial=0.0))
        return _SIDE_SHARE * max(self.extent_mm, farthest)

    @property
    def merge_tolerance_mm(self) -> float:
        """Vertices closer than this are one, mm."""
        return merge_tolerance_mm(self.extent_mm)

    def snapped(self, points_mm: FloatArray) -> FloatArray:
        """Points (n, 3) moved onto a merged vertex where one is within tolerance."""
        if not len(self.vertices_mm):
            return points_mm
        distance, index = self.vertex_tree.query(points_mm)
        near = distance <= 2 * self.merge_tolerance_mm
        return np.where(near[:, None], self.vertices_mm[index], points_mm)


def merge_tolerance_mm(extent_mm: float) -> float:
    """Distance below which two vertices of a part of this extent are one, mm."""
    return min(_MERGE_MM, _MERGE_SHARE * extent_mm)


def prepare(mesh: TriangleMesh) -> Occluders:
    """Clean a mesh, find its bodies and which of them hide from both sides.

    Vertices within 1e-4 mm are merged, triangles without height and duplicates are
    dropped. A body is one-sided where every edge joins exactly two opposite triangles
    and its volume is positive; all others hide from both sides.

    Args:
        mesh: part, fixtures, anything opaque, mm.
    """
    extent = mesh.extent_mm if len(mesh.vertices_mm) else 0.0
    vertices, vertex_of = _merged(mesh.vertices_mm, merge_tolerance_mm(extent))
    faces = vertex_of[mesh.faces].reshape(-1, 3)
    keep = _usable(vertices, faces, min(_SLIVER_SHARE * extent, 1e-6))
    faces, face_ids = faces[keep], mesh.face_ids[keep]
    edge_vertices, edge_faces, all_pairs, bad_edges, bad_faces = _edges(faces)
    bodies = _bodies(len(faces), all_pairs)
    return Occluders(
        vertices_mm=vertices,
        faces=faces,
        face_ids=face_ids,
        bodies=bodies,
        two_sided=_two_sided(vertices[faces], bodies, bad_faces),
        edge_vertices=edge_vertices,
        edge_faces=edge_faces,
        bad_edges=bad_edges,
        extent_mm=extent,
    )


def _merged(vertices: FloatArray, tolerance_mm: float) -> tuple[FloatArray, IntArray]:
    """One representative per cluster of vertices, and the cluster of every vertex."""
    if not len(vertices):
        return vertices, np.zeros(0, dtype=np.int64)
    exact, first_of = np.unique(vertices, axis=0, return_inverse=True)
    pairs = cKDTree(exact).query_pairs(tolerance_mm, output_type="ndarray")
    cluster = _components(len(exact), pairs)
    representative = np.full(cluster.max() + 1, len(exact), dtype=np.int64)
    np.minimum.at(representative, cluster, np.arange(len(exact)))
    return exact[representative], cluster[first_of.reshape(-1)]


def _components(count: int, pairs: IntArray) -> IntArray:
    """Connected component (count,) of a graph given by pairs (p, 2)."""
    ones = np.ones(len(pairs), dtype=np.bool_)
    graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    return np.asarray(labels, dtype=np.int64)


def _usable(vertices: FloatArray, faces: IntArray, height_mm: float) -> BoolArray:
    """Mask (m,) of triangles that have a height and are no copy of an earlier one."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    double_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    sides = np.linalg.norm(np.stack([b - a, c - b, a - c]), axis=2).max(axis=0)
    turned = _turned_to_smallest(faces)
    first = np.zeros(len(faces), dtype=np.bool_)
    if len(faces):
        first[np.unique(turned, axis=0, return_index=True)[1]] = True
    return np.asarray(first & (double_area > height_mm * np.maximum(sides, 1e-300)))


def _turned_to_smallest(faces: IntArray) -> IntArray:
    """Rotate every face so that its smallest index comes first."""
    shift = faces.argmin(axis=1) if len(faces) else np.zeros(0, dtype=np.int64)
    columns = (np.arange(3) + shift[:, None]) % 3
    return np.take_along_axis(faces, columns, axis=1)


def _edges(
    faces: IntArray,
) -> tuple[IntArray, IntArray, IntArray, int, IntArray]:
    """Good edges with their two faces, all face pairs, bad edges and their faces."""
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    face_of = np.repeat(np.arange(len(faces)), 3)
    forward = directed[:, 0] < directed[:, 1]
    order = np.lexsort((~forward, directed.max(axis=1), directed.min(axis=1)))
    ends = np.sort(directed[order], axis=1)
    forward, face_of, along = forward[order], face_of[order], directed[order]
    starts = np.ones(len(ends), dtype=np.bool_)
    starts[1:] = (ends[1:] != ends[:-1]).any(axis=1)
    group = np.cumsum(starts) - 1
    first = np.flatnonzero(starts)
    size = np.bincount(group, minlength=len(first))
    good = size == 2
    good[good] = forward[first[good]] & ~forward[first[good] + 1]
    pairs = np.stack([face_of[first[group]], face_of], axis=1)
    good_first = first[good]
    edge_faces = np.stack([face_of[good_first], face_of[good_first + 1]], axis=1)
    bad_faces = face_of[~good[group]] if len(ends) else np.zeros(0, dtype=np.int64)
    return along[good_first], edge_faces, pairs, int((~good).sum()), bad_faces


def mesh_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Edges (e, 2) that join exactly two opposite faces, and those faces (e, 2).

    Every edge runs along the first of its two faces.
    """
    return _edges(faces)[:2]


def _bodies(n_faces: int, pairs: IntArray) -> IntArray:
    """Connected body (m,) of every triangle."""
    return _components(n_faces, pairs) if n_faces else np.zeros(0, dtype=np.int64)


def _two_sided(
    triangles: FloatArray, bodies: IntArray, bad_faces: IntArray
) -> BoolArray:
    """Mask (m,) of triangles whose body is open, branched or turned inside out."""
    if not len(triangles):
        return np.zeros(0, dtype=np.bool_)
    a, b, c = np.moveaxis(triangles - triangles.reshape(-1, 3).mean(axis=0), 1, 0)
    volume = np.bincount(bodies, weights=(a * np.cross(b, c)).sum(axis=1))
    improper = volume <= 0
    improper[bodies[bad_faces]] = True
    return np.asarray(improper[bodies])
