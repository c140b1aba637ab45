"""Projection with distortion: camera frame to pixels and back.

Pixel (0, 0) is the centre of the top-left pixel. Distortion acts on normalised
coordinates with the coefficients (k1, k2, p1, p2, k3) in OpenCV's order and meaning.
The principal distance f_cal in mm is a property of the lens setting, not of this model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.optics.sensor import Sensor

_UNDISTORT_ITERATIONS = 20


@dataclass(frozen=True)
class Intrinsics:
    """Sensor, principal point (px) and distortion."""

    sensor: Sensor
    centre_x_px: float
    centre_y_px: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def at(self, centre_px: tuple[float, float] | None, k1: float | None) -> Intrinsics:
        """With a lens setting's own principal point and k1; None: as they are."""
        if centre_px is None and k1 is None:
            return self
        across, down = centre_px or (self.centre_x_px, self.centre_y_px)
        return replace(
            self,
            centre_x_px=across,
            centre_y_px=down,
            k1=self.k1 if k1 is None else k1,
        )

    @property
    def distortion(self) -> FloatArray:
        """(k1, k2, p1, p2, k3)."""
        return np.array([self.k1, self.k2, self.p1, self.p2, self.k3])

    def camera_matrix(self, f_cal_mm: float) -> FloatArray:
        """OpenCV's (3, 3) camera matrix at one principal distance, px."""
        return np.array(
            [
                [f_cal_mm / self.sensor.pitch_x_mm, 0.0, self.centre_x_px],
                [0.0, f_cal_mm / self.sensor.pitch_y_mm, self.centre_y_px],
                [0.0, 0.0, 1.0],
            ]
        )

    def distort(self, normalised: FloatArray) -> FloatArray:
        """Ideal (..., 2) normalised coordinates to distorted ones."""
        x, y = normalised[..., 0], normalised[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        return np.stack(
            [
                x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x),
                y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y,
            ],
            axis=-1,
        )

    def undistort(self, distorted: FloatArray) -> FloatArray:
        """The inverse of ``distort`` by fixed-point iteration, to 1e-12."""
        ideal = np.array(distorted, dtype=np.float64)
        for _ in range(_UNDISTORT_ITERATIONS):
            step = distorted - self.distort(ideal)
            ideal = ideal + step
            if np.abs(step).max(initial=0.0) < 1e-13:
                break
        return ideal

    def project(self, points_camera: FloatArray, f_cal_mm: float) -> FloatArray:
        """Points (..., 3) with z > 0, mm, to pixels (..., 2)."""
        normalised = points_camera[..., :2] / points_camera[..., 2:3]
        return self.to_pixels(normalised, f_cal_mm)

    def to_pixels(self, normalised: FloatArray, f_cal_mm: float) -> FloatArray:
        """Ideal normalised coordinates (..., 2) to distorted pixels (..., 2)."""
        distorted = self.distort(normalised)
        scale = f_cal_mm / np.array([self.sensor.pitch_x_mm, self.sensor.pitch_y_mm])
        return np.asarray(
            distorted * scale + np.array([self.centre_x_px, self.centre_y_px])
        )

    def to_normalised(self, pixels: FloatArray, f_cal_mm: float) -> FloatArray:
        """Distorted pixels (..., 2) to ideal normalised coordinates (..., 2)."""
        scale = f_cal_mm / np.array([self.sensor.pitch_x_mm, self.sensor.pitch_y_mm])
        centred = pixels - np.array([self.centre_x_px, self.centre_y_px])
        return self.undistort(centred / scale)
