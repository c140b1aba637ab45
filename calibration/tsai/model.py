"""Tsai's camera (R. Y. Tsai, IEEE J. Robotics and Automation RA-3(4), 1987, section II).

A pixel (Xf, Yf) lies on the sensor at Xd = dx (Xf - Cx) / sx, Yd = dy (Yf - Cy), in mm; the
ideal image point is Xu = Xd (1 + k1 r^2), with r^2 = Xd^2 + Yd^2; and Xu = f x / z. The
coefficient acts on the distorted point, so to first order it is -k1 / f^2 of OpenCV's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.projection import Projection, skew

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray

TSAI_NAMES = ("f_mm", "cx_px", "cy_px", "sx", "k1_per_mm2")
_NO_DISTORTION = 1e-100


@dataclass(frozen=True)
class TsaiCamera:
    """Sensor pitch (known) and f, centre, horizontal scale, radial distortion.

    Attributes:
        pitch_x_mm: dx, distance of two sampled columns on the sensor.
        pitch_y_mm: dy, distance of two rows.
        f_mm: principal distance.
        cx_px: column of the centre.
        cy_px: row of the centre.
        sx: horizontal scale of the sampling.
        k1_per_mm2: from the distorted to the ideal point.
    """

    pitch_x_mm: float
    pitch_y_mm: float
    f_mm: float
    cx_px: float
    cy_px: float
    sx: float = 1.0
    k1_per_mm2: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """``TSAI_NAMES``."""
        return TSAI_NAMES

    @property
    def values(self) -> FloatArray:
        """The five numbers of ``TSAI_NAMES``."""
        return np.array([self.f_mm, self.cx_px, self.cy_px, self.sx, self.k1_per_mm2])

    def with_values(self, values: FloatArray) -> TsaiCamera:
        """The same sensor with other numbers of ``TSAI_NAMES``."""
        named = zip(("f_mm", "cx_px", "cy_px", "sx", "k1_per_mm2"), values, strict=True)
        return replace(self, **{name: float(value) for name, value in named})

    @property
    def fold_mm(self) -> float:
        """Distorted radius beyond which the ideal one falls again; inf for k1 >= 0."""
        if self.k1_per_mm2 >= 0:
            return float("inf")
        return float(np.sqrt(-1 / (3 * self.k1_per_mm2)))

    def on_sensor(self, pixels: FloatArray) -> FloatArray:
        """Pixels (..., 2) to distorted sensor coordinates, mm."""
        scale = np.array([self.pitch_x_mm / self.sx, self.pitch_y_mm])
        return np.asarray((pixels - np.array([self.cx_px, self.cy_px])) * scale)

    def to_pixels(self, distorted_mm: FloatArray) -> FloatArray:
        """Distorted sensor coordinates (..., 2), mm, to pixels."""
        scale = np.array([self.sx / self.pitch_x_mm, 1 / self.pitch_y_mm])
        return np.asarray(distorted_mm * scale + np.array([self.cx_px, self.cy_px]))

    def undistort(self, distorted_mm: FloatArray) -> FloatArray:
        """Distorted (..., 2) to ideal sensor coordinates, mm."""
        squares = (distorted_mm**2).sum(axis=-1, keepdims=True)
        return np.asarray(distorted_mm * (1 + self.k1_per_mm2 * squares))

    def distort(self, ideal_mm: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Ideal (..., 2) to distorted sensor coordinates, mm.

        Returns:
            The points, and (...) whether each has an image: beyond the fold of a negative
            k1 the nearest one, on the fold, is given and flagged.
        """
        radius = np.linalg.norm(ideal_mm, axis=-1)
        seen = radius <= 2 / 3 * self.fold_mm
        away = np.where(radius > 0, radius, 1.0)
        ratio = np.where(radius > 0, self._distorted_radius(radius) / away, 1.0)
        return np.asarray(ideal_mm * ratio[..., None]), seen

    def project(
        self, rotation: FloatArray, translation_mm: FloatArray, points: FloatArray
    ) -> FloatArray:
        """Points (..., 3) to pixels (..., 2); nan behind the camera."""
        camera = np.einsum("...ij,...j->...i", rotation, points) + translation_mm
        return self.to_pixels(self.distort(self._ideal(camera))[0])

    def project_with_derivatives(
        self, rotation: FloatArray, translation_mm: FloatArray, points: FloatArray
    ) -> Projection:
        """As ``project``; the slope of the inverse distortion by implicit derivation."""
        turned = np.einsum("...ij,...j->...i", rotation, points)
        camera = turned + translation_mm
        ideal = self._ideal(camera)
        distorted, _ = self.distort(ideal)
        squares = (distorted**2).sum(axis=-1)[..., None, None]
        outer = distorted[..., :, None] * distorted[..., None, :]
        k1 = self.k1_per_mm2
        forward = (1 + k1 * squares) * np.eye(2) + 2 * k1 * outer
        scale = np.array([self.sx / self.pitch_x_mm, 1 / self.pitch_y_mm])
        slope = scale[:, None] * np.linalg.inv(forward)
        d_camera_point = slope @ self._d_ideal(camera, ideal)
        d_camera = self._d_values(slope, ideal, distorted)
        d_pose = np.concatenate([d_camera_point, -d_camera_point @ skew(turned)], -1)
        return Projection(
            self.to_pixels(distorted),
            camera[..., 2] > 0,
            d_camera,
            d_pose,
            d_camera_point @ rotation,
        )

    def _d_values(
        self, slope: FloatArray, ideal: FloatArray, distorted: FloatArray
    ) -> FloatArray:
        """(..., 2, 5) for ``TSAI_NAMES``."""
        d_focal = (slope @ (ideal / self.f_mm)[..., None])[..., 0]
        centre = np.broadcast_to(np.eye(2), slope.shape)
        d_scale = distorted * np.array([1 / self.pitch_x_mm, 0.0])
        cubes = distorted * (distorted**2).sum(axis=-1, keepdims=True)
        d_k1 = -(slope @ cubes[..., None])[..., 0]
        columns = [d_focal, centre[..., 0], centre[..., 1], d_scale, d_k1]
        return np.stack(columns, axis=-1)

    def _ideal(self, camera: FloatArray) -> FloatArray:
        depth = camera[..., 2:]
        ahead = depth > 0
        scaled = self.f_mm * camera[..., :2] / np.where(ahead, depth, 1.0)
        return np.where(ahead, scaled, np.nan)

    def _d_ideal(self, camera: FloatArray, ideal: FloatArray) -> FloatArray:
        depth = np.where(camera[..., 2] == 0, np.nan, camera[..., 2])
        zero = np.zeros_like(depth)
        rows = [self.f_mm / depth, zero, -ideal[..., 0] / depth]
        rows += [zero, self.f_mm / depth, -ideal[..., 1] / depth]
        return np.stack(rows, axis=-1).reshape(*depth.shape, 2, 3)

    def _distorted_radius(self, ideal_mm: FloatArray) -> FloatArray:
        """The smallest root r of r (1 + k1 r^2) = ideal (Cardano, without complex roots).

        With r = 2 F sin t the left side is (2 F / 3) sin 3 t for k1 < 0, F the fold; for
        k1 > 0 the same holds with sinh.
        """
        k1 = self.k1_per_mm2
        if abs(k1) < _NO_DISTORTION:
            return ideal_mm
        reach = float(np.sqrt(1 / (3 * abs(k1))))
        size = 1.5 * ideal_mm / reach
        if k1 > 0:
            return np.asarray(2 * reach * np.sinh(np.arcsinh(size) / 3))
        return np.asarray(2 * reach * np.sin(np.arcsin(np.minimum(size, 1.0)) / 3))
