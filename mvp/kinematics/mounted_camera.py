"""The camera on the arm at any lens setting: intrinsics, distortion, hand-eye."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from mvp.geometry import Pose
from mvp.kinematics.camera_pose import tool_from_camera_at
from mvp.optics import Intrinsics, LensTable, Sensor

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from mvp.calibrated import (
        CameraCalibration,
        LensTableCalibration,
        RigidCalibration,
    )
    from mvp.geometry import FloatArray
    from mvp.optics import LensSetting


@dataclass(frozen=True, eq=False)
class MountedCamera:
    """What three calibrations say together, at any setting of the lens.

    Attributes:
        own: sensor, principal point and distortion as the camera's calibration has them.
        table: of the lens, with its tube.
        tool_from_camera: hand-eye as calibrated.
        reference_d_mm: the setting that hand-eye belongs to; None: it does not say, and
            the pupil is taken not to move.
        reference_f_mm: likewise.
    """

    own: Intrinsics
    table: LensTable
    tool_from_camera: Pose
    reference_d_mm: float | None = None
    reference_f_mm: float | None = None

    @classmethod
    def of(
        cls,
        camera: CameraCalibration,
        lens_table: LensTableCalibration,
        hand_eye: RigidCalibration,
        *,
        tube_mm: float = 0.0,
    ) -> Self:
        """From the calibrations of a cell.

        Raises:
            CalibrationError: a lens table is not monotone.
        """
        return cls(
            intrinsics_of(camera),
            LensTable.from_calibration(lens_table, tube_mm=tube_mm),
            Pose.from_matrix("tool", "camera", np.asarray(hand_eye.matrix)),
            hand_eye.reference_d_mm,
            hand_eye.reference_f_mm,
        )

    def intrinsics_at(self, f_mm: float) -> Intrinsics:
        """Sensor, principal point and distortion where the zoom gives f."""
        here = self.table.optics_of(f_mm)
        return self.own.at(here.centre_px, here.k1)

    def reference_d_at(self, f_mm: float) -> float | None:
        """The d at which the pupil stands, at this f, where hand-eye has it."""
        shifts = self.pupil_shifts_mm(f_mm)
        if self.reference_d_mm is None or shifts is None:
            return self.reference_d_mm
        return self.reference_d_mm - float(shifts)

    def pupil_shifts_mm(self, f_mm: ArrayLike) -> FloatArray | None:
        """How far the pupil stands beyond what d and hand-eye say, by the zoom.

        None: it follows d alone, or hand-eye does not say at which zoom it was made.
        """
        curves, zoom = self.table.by_zoom, self.table.zoom
        if curves is None or self.reference_f_mm is None:
            return None
        here, there = (
            curves.value("pupil_shift_mm", zoom.fractional_steps(f))
            for f in (f_mm, self.reference_f_mm)
        )
        return None if here is None or there is None else here - there

    def tool_from_camera_at(self, lens: LensSetting) -> Pose:
        """The hand-eye transform at a lens setting."""
        return tool_from_camera_at(
            self.tool_from_camera,
            d_mm=lens.d_mm,
            reference_d_mm=self.reference_d_at(lens.f_mm),
        )


def sensor_of(camera: CameraCalibration) -> Sensor:
    """Size and pitch of the pixels."""
    return Sensor(
        camera.width_px,
        camera.height_px,
        camera.pitch_x_um / 1000,
        camera.pitch_y_um / 1000,
    )


def intrinsics_of(camera: CameraCalibration) -> Intrinsics:
    """Sensor, principal point and distortion as calibrated."""
    return Intrinsics(
        sensor_of(camera),
        camera.centre_x_px,
        camera.centre_y_px,
        camera.k1,
        camera.k2,
        camera.p1,
        camera.p2,
        camera.k3,
    )
