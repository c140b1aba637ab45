"""Convex pieces of a planar face, as few as a quick partition gives."""

from __future__ import annotations

import manifold3d
import numpy as np

from mvp.geometry import FloatArray, IntArray, TriangleMesh, edge_table
from mvp.scene.polygons import convex_partition, signed_area


def face_polygons(
    mesh: TriangleMesh,
    members: IntArray,
    rings: list[IntArray],
    flat: FloatArray,
    plane: FloatArray,
) -> list[IntArray]:
    """Vertex rings of convex polygons that cover a face.

    A hole of the face is covered too when nothing stands in it: who sees the polygon
    sees the face, and a view that something hides only over the hole is given up.

    Args:
        mesh: the part.
        members: triangles of the face.
        rings: boundary rings of the face, the outer one first.
        flat: (n, 2) plane coordinates of all vertices.
        plane: (4,) the face's plane (n, o).
    """
    outer, *inner = rings
    kept = [ring for ring in inner if not _is_open(mesh, members, ring, plane)]
    used = np.concatenate([outer, *kept])
    area = sum(signed_area(flat[ring]) for ring in (outer, *kept))
    try:
        local = np.asarray(
            manifold3d.triangulate([flat[ring] for ring in (outer, *kept)])
        ).reshape(-1, 3)
    except (RuntimeError, ValueError):
        return convex_partition(flat, mesh.faces[members])
    triangles = used[local.astype(np.int64)]
    corners = flat[triangles]
    doubled = np.cross(
        np.pad(corners[:, 1] - corners[:, 0], ((0, 0), (0, 1))),
        np.pad(corners[:, 2] - corners[:, 0], ((0, 0), (0, 1))),
    )[:, 2]
    if (doubled < 0).any() or abs(doubled.sum() / 2 - area) > 1e-7 * area:
        return convex_partition(flat, mesh.faces[members])
    return convex_partition(flat, triangles[doubled > 0])


def _is_open(
    mesh: TriangleMesh, members: IntArray, ring: IntArray, plane: FloatArray
) -> bool:
    """Whether nothing stands in or rises from a hole of the face."""
    points = mesh.vertices_mm[ring]
    table = edge_table(mesh)
    on_ring = np.isin(table.vertices, ring).all(axis=1)
    own = np.isin(table.faces, members)
    beside = on_ring & (own.sum(axis=1) == 1)
    if (table.angle_rad[beside] < 0).any():
        return False
    height = mesh.triangles_mm @ plane[:3] - plane[3]
    above = height.max(axis=1) > 1e-3
    crosses = above & (height.min(axis=1) < 1e-3)
    low, high = points.min(axis=0), points.max(axis=0)
    corners = mesh.triangles_mm[crosses]
    near = (corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)
    return not bool(near.all(axis=1).any())
