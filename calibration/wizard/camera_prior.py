"""What camera and lens calibration leave open of the intrinsics at a lens setting.

All that was measured may move, the decentring of the lens as well: across a picture, p1
and p2 look nearly like a turn of the camera. Held fixed with their errors they turn a
hand-eye result by several times of what it states.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.hand_eye import CameraPrior
from calibration.projection import CAMERA_NAMES
from calibration.wizard.lookout import camera_at

if TYPE_CHECKING:
    from calibration.wizard.working import Setting
    from mvp.calibrated import CameraCalibration, ZoomTable
    from mvp.geometry import FloatArray
    from mvp.wizard import SessionFacts

_ROUNDING_PX = 0.01
_FOCAL_SHARE = 1e-4
_LEAST = {"cx_px": 0.05, "cy_px": 0.05, "k1": 1e-4}
_STATED_AS = {"cx_px": "centre_x_px", "cy_px": "centre_y_px"}


def camera_prior(facts: SessionFacts, setting: Setting) -> CameraPrior:
    """Intrinsics at the setting, with what camera and lens calibration leave open."""
    lens = facts.lens_at(setting.by_name)
    camera = camera_at(facts, lens)
    known = _without_focal(facts.camera, facts.lens_table.by_zoom)
    moving = [number for number in range(2, len(CAMERA_NAMES)) if known[number, number]]
    focal = facts.lens_table.d_standard_deviation_mm / lens.d_mm * camera.fx_px
    focal = max(focal, _FOCAL_SHARE * camera.fx_px)
    both = np.array([camera.fx_px, camera.fy_px]) / camera.fx_px * focal
    covariance = np.zeros((2 + len(moving), 2 + len(moving)))
    covariance[:2, :2] = np.outer(both, both) + _ROUNDING_PX**2 * np.eye(2)
    covariance[2:, 2:] = known[np.ix_(moving, moving)]
    names = ("fx_px", "fy_px", *(CAMERA_NAMES[number] for number in moving))
    return CameraPrior(camera, names, covariance)


def _without_focal(camera: CameraCalibration, by_zoom: ZoomTable | None) -> FloatArray:
    """(9, 9) of ``CAMERA_NAMES``: the camera's, with what the lens table knows by zoom."""
    stated = camera.standard_deviation
    names = [_STATED_AS.get(name, name) for name in CAMERA_NAMES]
    known = np.diag([stated.get(name, 0.0) ** 2 for name in names])
    if camera.covariance is not None:
        given = camera.covariance.parameters
        there = [number for number, name in enumerate(CAMERA_NAMES) if name in given]
        order = [given.index(CAMERA_NAMES[number]) for number in there]
        matrix = np.array(camera.covariance.matrix)
        known[np.ix_(there, there)] = matrix[np.ix_(order, order)]
    for number, name in enumerate(names):
        if by_zoom is not None and getattr(by_zoom, name, None):
            known[number], known[:, number] = 0.0, 0.0
            known[number, number] = by_zoom.standard_deviation.get(name, 0.0) ** 2
        least = _LEAST.get(CAMERA_NAMES[number], 0.0)
        known[number, number] = max(known[number, number], least**2)
    return known
