"""Parallel rays through a part: what an orthographic drawing shows and hides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from embreex.mesh_construction import TriangleMesh as EmbreeMesh
from embreex.rtcore_scene import EmbreeScene

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray, TriangleMesh


class PartRays:
    """Ray casts against one mesh, in single precision about its centre."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self._centre_mm = mesh.bounds.centre_mm
        self._scene = EmbreeScene()
        corners = (mesh.triangles_mm - self._centre_mm).astype(np.float32)
        self._mesh = EmbreeMesh(self._scene, np.ascontiguousarray(corners))

    def first_triangles(self, origins: FloatArray, direction: FloatArray) -> IntArray:
        """The first triangle (n,) on each ray from points (n, 3), -1 for none."""
        local = np.ascontiguousarray(origins - self._centre_mm, dtype=np.float32)
        towards = np.broadcast_to(direction, local.shape).astype(np.float32)
        hit = self._scene.run(local, np.ascontiguousarray(towards))
        return np.asarray(hit, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Drawing:
    """An orthographic view of a part.

    Attributes:
        title: where it is seen from.
        axes: (3, 3) unit rows: right, up, towards the viewer.
        centre_mm: (3,) the point in the middle.
        half_mm: (2,) half width and height.
    """

    title: str
    axes: FloatArray
    centre_mm: FloatArray
    half_mm: FloatArray

    @classmethod
    def of(
        cls, mesh: TriangleMesh, title: str, direction: FloatArray, aspect: float
    ) -> Drawing:
        """The whole part seen from a direction (3,), z up, width / height as given."""
        towards = direction / np.linalg.norm(direction)
        right = np.cross([0.0, 0.0, 1.0], towards)
        right = right / np.linalg.norm(right)
        axes = np.stack([right, np.cross(towards, right), towards])
        centre = mesh.bounds.centre_mm
        flat = (mesh.vertices_mm - centre) @ axes[:2].T
        low, high = flat.min(axis=0), flat.max(axis=0)
        half = 0.57 * (high - low)
        height = max(half[1], half[0] / aspect)
        middle = centre + (low + high) / 2 @ axes[:2]
        return cls(title, axes, middle, np.array([aspect * height, height]))

    def flat(self, points: FloatArray) -> FloatArray:
        """Drawing coordinates (..., 2) of points (..., 3), mm."""
        return np.asarray((points - self.centre_mm) @ self.axes[:2].T)

    def sees(self, rays: PartRays, points: FloatArray, *, lift_mm: float) -> BoolArray:
        """Which points (n, 3) of the surface nothing hides."""
        origins = points + lift_mm * self.axes[2]
        return np.asarray(rays.first_triangles(origins, self.axes[2]) < 0)

    def shaded(self, rays: PartRays, mesh: TriangleMesh, columns: int) -> FloatArray:
        """Grey values (rows, columns), top row first, NaN beside the part."""
        rows = round(columns * float(self.half_mm[1] / self.half_mm[0]))
        x = (np.arange(columns) + 0.5) / columns * 2 - 1
        y = 1 - (np.arange(rows) + 0.5) / rows * 2
        plane = np.stack(np.meshgrid(x * self.half_mm[0], y * self.half_mm[1]), axis=-1)
        far = 2 * float(mesh.bounds.diagonal_mm) * self.axes[2]
        origins = plane.reshape(-1, 2) @ self.axes[:2] + self.centre_mm + far
        hit = rays.first_triangles(origins, -self.axes[2])
        light = self.axes.T @ np.array([-0.35, 0.55, 0.76])
        normals = mesh.normals[hit]
        normals = normals * np.sign(normals @ self.axes[2])[:, None]
        grey = 0.80 + 0.16 * (normals @ light)
        return np.where(hit >= 0, grey, np.nan).reshape(rows, columns)
