"""Bodies made ready for rays: one Embree scene, tables per triangle.

Build once, render many times; the tables per view (planes in the camera frame) are
cheap. Embree works in float32 about the middle of the bodies, tables are float64.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from embreex.mesh_construction import TriangleMesh as EmbreeMesh
from embreex.rtcore_scene import EmbreeScene

from mvp.geometry import FloatArray, IntArray, Pose, TriangleMesh, concatenated
from mvp.imaging.render_lines import sharp_lines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.imaging.light import Float32Array
    from mvp.imaging.render_body import RenderBody

_NORMAL_DECIMALS = 5
_OFFSET_DECIMALS = 4


@dataclass(frozen=True, eq=False)
class ViewPlanes:
    """Every triangle's plane in the camera frame: normal . x = offset.

    The last row is a stand-in for "nothing hit": index -1 reads it.

    Attributes:
        normals: (m + 1, 3) float32, turned towards the camera.
        offsets_mm: (m + 1,) float32, negative.
    """

    normals: Float32Array
    offsets_mm: Float32Array


class RenderScene:
    """All bodies in the world frame, ready to be looked at from anywhere."""

    def __init__(self, bodies: Sequence[RenderBody]) -> None:
        """Collect the bodies and build the ray structure."""
        self.bodies = tuple(bodies)
        meshes = [_in_world(body) for body in self.bodies]
        self.mesh: TriangleMesh = concatenated(meshes)
        counts = [len(mesh.faces) for mesh in meshes]
        self.body_of_triangle: IntArray = np.repeat(np.arange(len(counts)), counts)
        albedo = np.array([body.albedo for body in self.bodies], dtype=np.float32)
        none = np.zeros(1, dtype=np.float32)
        self.albedo: Float32Array = np.append(albedo[self.body_of_triangle], none)
        self.centre_mm: FloatArray = (
            self.mesh.bounds.centre_mm if len(self.mesh.faces) else np.zeros(3)
        )

    @cached_property
    def _embree(self) -> EmbreeScene | None:
        if not len(self.mesh.faces):
            return None
        scene = EmbreeScene()
        corners = self.mesh.triangles_mm - self.centre_mm
        EmbreeMesh(scene, np.ascontiguousarray(corners, dtype=np.float32))
        return scene

    def make_ready(self) -> None:
        """Make everything that is otherwise made with the first picture."""
        _ = self._embree, self.lines_mm
        for body in self.bodies:
            _ = body.texture and body.texture.room_texels

    @cached_property
    def plane_ids(self) -> IntArray:
        """(m + 1,) id of the plane of each triangle and body; the last is -1."""
        rows = np.column_stack(
            [
                np.round(self.mesh.normals, _NORMAL_DECIMALS),
                np.round(self._plane_offsets_mm, _OFFSET_DECIMALS),
                self.body_of_triangle,
            ]
        )
        _, ids = np.unique(rows + 0.0, axis=0, return_inverse=True)
        return np.append(ids.reshape(-1), -1).astype(np.int64)

    @cached_property
    def lines_mm(self) -> FloatArray:
        """(k, 2, 3) straight lines at which a picture may change, world frame."""
        return sharp_lines(self.mesh, self.plane_ids)

    @cached_property
    def face_ids(self) -> IntArray:
        """(m + 1,) global face id of each triangle; the last is -1."""
        return np.append(self.mesh.face_ids, -1)

    @cached_property
    def body_ids(self) -> IntArray:
        """(m + 1,) body of each triangle; the last is -1."""
        return np.append(self.body_of_triangle, -1)

    @cached_property
    def _plane_offsets_mm(self) -> FloatArray:
        relative = self.mesh.triangles_mm[:, 0] - self.centre_mm
        return np.asarray((self.mesh.normals * relative).sum(axis=1))

    def planes(self, world_from_camera: Pose) -> ViewPlanes:
        """The planes seen from one camera pose."""
        rotation = world_from_camera.rotation
        to_camera = world_from_camera.translation_mm - self.centre_mm
        normals = self.mesh.normals
        offsets = self._plane_offsets_mm - normals @ to_camera
        sign = np.where(offsets > 0, -1.0, 1.0)
        normals = np.vstack(
            [normals * sign[:, None] @ rotation, np.array([0, 0, -1.0])]
        )
        offsets = np.append(offsets * sign, -np.inf)
        return ViewPlanes(normals.astype(np.float32), offsets.astype(np.float32))

    def hit(
        self,
        world_from_camera: Pose,
        directions_camera: Float32Array,
        origins_camera: Float32Array | None = None,
    ) -> IntArray:
        """First triangle (n,) along each ray (n, 3); -1 for none."""
        count = len(directions_camera)
        if self._embree is None or count == 0:
            return np.full(count, -1, dtype=np.int64)
        rotation = world_from_camera.rotation.T.astype(np.float32)
        start = (world_from_camera.translation_mm - self.centre_mm).astype(np.float32)
        origins = np.empty((count, 3), dtype=np.float32)
        if origins_camera is None:
            origins[:] = start
        else:
            np.add(origins_camera @ rotation, start, out=origins)
        found = self._embree.run(origins, directions_camera @ rotation)
        return np.asarray(found)


def _in_world(body: RenderBody) -> TriangleMesh:
    pose = body.world_from_mesh
    return body.mesh if pose is None else body.mesh.moved(pose)
