"""The ideal picture: undistorted, square, in row pitches from the principal point.

Straight edges are straight here and blur circles round. Raw pixels are never
resampled for a measurement; their coordinates are undistorted instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.esf import Optics
from mvp.imaging.pupil import WAVELENGTH_MM
from mvp.optics.thick_lens import principal_distance_mm, signed_blur_mm

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Intrinsics

_FIELD_MARGIN = 1.6


@dataclass(frozen=True)
class ImagePlane:
    """Lens setting and sensor, as far as a measurement needs them.

    Attributes:
        intrinsics: sensor, principal point and distortion.
        f_mm, d_mm, a_mm, e_mm: the lens setting.
        wavelength_mm: of the light, for diffraction.
    """

    intrinsics: Intrinsics
    f_mm: float
    d_mm: float
    a_mm: float
    e_mm: float = 0.0
    wavelength_mm: float = WAVELENGTH_MM

    @property
    def f_cal_mm(self) -> float:
        """Principal distance."""
        return float(principal_distance_mm(self.d_mm, self.f_mm, self.e_mm))

    @property
    def px_mm(self) -> float:
        """One ideal pixel on the sensor: the row pitch, mm."""
        return self.intrinsics.sensor.pitch_y_mm

    @property
    def optics(self) -> Optics:
        """Pixel shape and diffraction for the spread functions."""
        n_w = self.f_cal_mm / self.a_mm
        return Optics(
            round(self.intrinsics.sensor.pitch_x_mm / self.px_mm, 9),
            round(self.wavelength_mm * n_w / self.px_mm, 4),
        )

    def ideal(self, raw_px: FloatArray) -> FloatArray:
        """Raw pixels (..., 2) as column, row to ideal pixels (..., 2)."""
        normalised = self.intrinsics.to_normalised(raw_px, self.f_cal_mm)
        return normalised * (self.f_cal_mm / self.px_mm)

    def raw(self, ideal_px: FloatArray) -> FloatArray:
        """Ideal pixels (..., 2) to raw column, row."""
        normalised = ideal_px * (self.px_mm / self.f_cal_mm)
        return self.intrinsics.to_pixels(normalised, self.f_cal_mm)

    def project(self, points_camera: FloatArray) -> FloatArray:
        """Points (..., 3) in the camera frame with z > 0, mm, to ideal pixels."""
        scale = self.f_cal_mm / self.px_mm
        return np.asarray(points_camera[..., :2] / points_camera[..., 2:3] * scale)

    def blur_px(self, z_mm: FloatArray) -> FloatArray:
        """Predicted diameter of the blur circle at depth z from the pupil, px."""
        signed = signed_blur_mm(z_mm, self.d_mm, self.f_mm, self.a_mm, self.e_mm)
        return np.asarray(np.abs(signed) / self.px_mm)

    def inside(self, ideal_px: FloatArray, *, margin_px: float = 1.0) -> BoolArray:
        """Which ideal points (..., 2) fall on the sensor, a margin left free."""
        sensor = self.intrinsics.sensor
        raw = self.raw(ideal_px)
        low, high = margin_px, np.array([sensor.width_px, sensor.height_px]) - 1
        on_sensor = ((raw >= low) & (raw <= high - margin_px)).all(axis=-1)
        # Far outside the field the distortion polynomial folds back onto the sensor.
        near = np.linalg.norm(ideal_px, axis=-1) < _FIELD_MARGIN * self.reach_px
        return np.asarray(on_sensor & near)

    @property
    def reach_px(self) -> float:
        """Distance of the farthest sensor corner from the principal point."""
        sensor = self.intrinsics.sensor
        x = max(
            self.intrinsics.centre_x_px, sensor.width_px - self.intrinsics.centre_x_px
        )
        y = max(
            self.intrinsics.centre_y_px, sensor.height_px - self.intrinsics.centre_y_px
        )
        return float(
            np.hypot(x * sensor.pitch_x_mm, y * sensor.pitch_y_mm) / self.px_mm
        )
