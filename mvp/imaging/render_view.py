"""One camera looking at one scene: first hits, depths and shading without a lens."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.render_rays import pixel_rays

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray, Pose
    from mvp.imaging.light import Float32Array, Illumination
    from mvp.imaging.pupil import PupilOptics
    from mvp.imaging.render_rays import PixelRays
    from mvp.imaging.render_scene import RenderScene, ViewPlanes
    from mvp.optics import Intrinsics


@dataclass(frozen=True, eq=False)
class CameraView:
    """Everything that decides what a pixel shows."""

    scene: RenderScene
    world_from_camera: Pose
    optics: PupilOptics
    intrinsics: Intrinsics
    light: Illumination

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the sensor."""
        return self.intrinsics.sensor.height_px, self.intrinsics.sensor.width_px

    @property
    def pitch_mm(self) -> FloatArray:
        """(2,) pixel pitch along x and y."""
        sensor = self.intrinsics.sensor
        return np.array([sensor.pitch_x_mm, sensor.pitch_y_mm])

    @cached_property
    def rays(self) -> PixelRays:
        """Chief rays of all pixels."""
        return pixel_rays(self.intrinsics, self.optics.f_cal_mm)

    @cached_property
    def planes(self) -> ViewPlanes:
        """Planes of all triangles in the camera frame."""
        return self.scene.planes(self.world_from_camera)

    @cached_property
    def triangles(self) -> IntArray:
        """(rows, columns) triangle under each pixel's centre, -1 for none."""
        directions = self.rays.directions.reshape(-1, 3)
        return self.scene.hit(self.world_from_camera, directions).reshape(self.shape)

    @cached_property
    def plane_ids(self) -> IntArray:
        """(rows, columns) plane under each pixel's centre, -1 for none; int32."""
        return np.asarray(self.scene.plane_ids.astype(np.int32)[self.triangles])

    @cached_property
    def depth_mm(self) -> Float32Array:
        """(rows, columns) z of the hit in the camera frame; inf for none."""
        flat = self.depths(
            self.triangles.reshape(-1), self.rays.directions.reshape(-1, 3)
        )
        return flat.reshape(self.shape)

    def depths(self, triangles: IntArray, directions: Float32Array) -> Float32Array:
        """Z (n,) where chief rays (n, 3) with z = 1 meet the planes of triangles."""
        normals = self.planes.normals[triangles]
        slope = np.einsum("nk,nk->n", normals, directions)
        with np.errstate(divide="ignore"):
            return np.asarray(self.planes.offsets_mm[triangles] / slope)

    def shade(self, triangles: IntArray, points: Float32Array) -> Float32Array:
        """Grey (n,) of points (n, 3) on triangles, camera frame; prints left out."""
        grey = np.full(len(triangles), self.light.background, dtype=np.float32)
        hit = np.flatnonzero(triangles >= 0)
        index = triangles[hit]
        normals = self.planes.normals[index].T
        albedo = self.scene.albedo[index]
        grey[hit] = self.light.radiance(points[hit].T, normals, albedo)
        return grey

    @property
    def has_prints(self) -> bool:
        """Whether any body carries a print."""
        return any(body.texture is not None for body in self.scene.bodies)
