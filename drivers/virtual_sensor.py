"""The true sensor of a virtual world, and how finely motion smears a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.optics import Intrinsics, Sensor

if TYPE_CHECKING:
    from drivers.virtual_settings import WorldErrors
    from mvp.calibrated import CameraCalibration
    from mvp.geometry import FloatArray, Pose

_SMEAR_PX = 0.7
_FEWEST = 5


def true_intrinsics(camera: CameraCalibration, errors: WorldErrors) -> Intrinsics:
    """The calibration with the errors of the truth added."""
    sensor = Sensor(
        camera.width_px,
        camera.height_px,
        camera.pitch_x_um / 1e3,
        camera.pitch_y_um / 1e3,
    )
    return Intrinsics(
        sensor,
        camera.centre_x_px + errors.centre_px[0],
        camera.centre_y_px + errors.centre_px[1],
        k1=camera.k1 + errors.k1,
        k2=camera.k2,
        p1=camera.p1,
        p2=camera.p2,
        k3=camera.k3,
    )


def smear_instants(
    base_from_camera: tuple[Pose, Pose],
    centre_base: FloatArray,
    *,
    scale_px: float,
    most: int,
) -> int:
    """How many still pictures make a smooth smear: one per 0.7 px, within limits.

    Args:
        base_from_camera: at the beginning and the end of the exposure.
        centre_base: (3,) what is looked at, mm.
        scale_px: principal distance in pixels.
        most: upper limit.
    """
    first, last = base_from_camera
    begin, end = (pose.inverse().apply(centre_base) for pose in (first, last))
    moved = float(np.linalg.norm(end - begin)) * scale_px / max(abs(float(begin[2])), 1)
    moved += first.angle_to_rad(last) * scale_px
    return int(np.clip(np.ceil(moved / _SMEAR_PX), min(_FEWEST, most), most))
