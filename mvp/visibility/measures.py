"""The two distance measures of the paper for the visibility constraint g4."""

from __future__ import annotations

from typing import TYPE_CHECKING

import igl
import numpy as np

from mvp.geometry import FloatArray, as_points

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from mvp.visibility.region import Region


def paper_distance(region: Region, points_mm: ArrayLike) -> FloatArray:
    """Eq. (12)-(13): distance (N,) to the region's polyhedron, positive inside, mm."""
    return region.signed_distance(points_mm)


def ray_distance(region: Region, points_mm: ArrayLike, *, rays: int = 64) -> FloatArray:
    """Eq. (14): shortest of several rays to the region's boundary, signed, mm.

    Never less than the true distance in magnitude; approaches it with more rays. Rays
    that meet nothing count as the diagonal of the workspace.

    Args:
        region: the visibility region; its walls count only if it says so.
        points_mm: (N, 3).
        rays: number of directions, spread evenly over the sphere.
    """
    points = as_points(points_mm).reshape(-1, 3)
    counted = ~region.on_wall | region.walls
    vertices = np.array(region.mesh.vertices_mm)
    faces = np.ascontiguousarray(region.mesh.faces[counted])
    length = np.full(len(points), region.workspace.diagonal_mm)
    if len(faces):
        tree = igl.AABB()
        tree.init(vertices, faces)
        origins = np.repeat(points, rays, axis=0)
        directions = np.tile(spread_directions(rays), (len(points), 1))
        hits = tree.intersect_ray(vertices, faces, origins, directions)
        reach = [min((hit[1] for hit in ray), default=np.inf) for ray in hits]
        nearest = np.array(reach).reshape(len(points), rays).min(axis=1)
        length = np.minimum(length, nearest)
    signed = region.signed_distance(points)
    return np.where(signed > 0, length, np.where(signed < 0, -length, 0.0))


def spread_directions(count: int) -> FloatArray:
    """Unit vectors (count, 3) on a Fibonacci spiral over the sphere."""
    index = np.arange(count) + 0.5
    height = 1 - 2 * index / count
    turn = np.pi * (1 + np.sqrt(5)) * index
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
