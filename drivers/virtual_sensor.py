"""The true sensor of a virtual world, and how finely motion smears a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.kinematics import MountedCamera, intrinsics_of, tool_from_camera_at

if TYPE_CHECKING:
    from drivers.virtual_settings import WorldErrors
    from mvp.calibrated import CameraCalibration
    from mvp.devices import WorldBelief
    from mvp.geometry import FloatArray, Pose
    from mvp.optics import Intrinsics, LensSetting, LensTable

_SMEAR_PX = 0.7
_FEWEST = 5


def true_intrinsics(
    camera: CameraCalibration, errors: WorldErrors, lens: LensSetting | None = None
) -> Intrinsics:
    """The calibration, at a lens setting, with the errors of the truth added."""
    found = intrinsics_of(camera)
    if lens is not None:
        found = found.at(lens.centre_px, lens.k1)
    across, down = errors.centre_px
    centre = found.centre_x_px + across, found.centre_y_px + down
    return found.at(centre, found.k1 + errors.k1)


def true_hand_eye(
    belief: WorldBelief, table: LensTable, d_mm: float, f_mm: float | None
) -> Pose:
    """The hand-eye transform at d; without f the pupil follows d alone."""
    known, reference = belief.tool_from_camera, belief.reference_d_mm
    if f_mm is not None:
        own = intrinsics_of(belief.camera)
        mounted = MountedCamera(own, table, known, reference, belief.reference_f_mm)
        reference = mounted.reference_d_at(f_mm) or reference
    return tool_from_camera_at(known, d_mm=d_mm, reference_d_mm=reference)


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
