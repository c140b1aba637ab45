"""Where a camera calibration starts: focal length and poses from closed forms."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.bundle import BundleState
from calibration.planar import focal_from_homographies, homography, planar_pose
from calibration.projection import PinholeCamera, project
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from calibration.observations import Observations

_GUESSES = (0.7, 1.5, 3.0, 6.0)


def start_from_planes(
    seen: Observations, *, aspect: float = 1.0
) -> BundleState[PinholeCamera]:
    """A camera without distortion, centre in the middle, and a pose for every view.

    Args:
        seen: views of a flat target (z = 0).
        aspect: fy / fx, the ratio of the pixel pitches x / y.

    Raises:
        CalibrationError: a view has too few points, or none gives a pose.
    """
    middle = np.array([(seen.width_px - 1) / 2, (seen.height_px - 1) / 2])
    focal = focal_from_homographies(_homographies(seen), middle, aspect)
    size = max(seen.width_px, seen.height_px)
    guesses = [focal] if focal else [guess * size for guess in _GUESSES]
    starts = [
        poses_with(PinholeCamera(f, aspect * f, *(float(c) for c in middle)), seen)
        for f in guesses
    ]
    return min(starts, key=lambda state: _cost(state, seen))


def poses_with(camera: PinholeCamera, seen: Observations) -> BundleState[PinholeCamera]:
    """The pose of every view of a flat target with a known camera.

    Raises:
        CalibrationError: naming the view that gives no pose.
    """
    poses = []
    for number, name in enumerate(seen.names):
        try:
            poses.append(planar_pose(camera, *seen.of_view(number)))
        except ValueError as error:
            raise unusable(name, error) from error
    return BundleState(
        camera, np.stack([p[0] for p in poses]), np.stack([p[1] for p in poses])
    )


def unusable(name: str, error: ValueError) -> CalibrationError:
    """A view that gives neither homography nor pose."""
    return CalibrationError(
        f"{name}: {error}", hint="remove this picture or take it again", where=name
    )


def _homographies(seen: Observations) -> np.ndarray:
    matrices = []
    for number, name in enumerate(seen.names):
        points, pixels = seen.of_view(number)
        try:
            matrices.append(homography(points[:, :2], pixels))
        except ValueError as error:
            raise unusable(name, error) from error
    return np.stack(matrices)


def _cost(state: BundleState[PinholeCamera], seen: Observations) -> float:
    rows = seen.view
    predicted = project(
        state.camera,
        state.rotation[rows],
        state.translation_mm[rows],
        seen.points_target_mm,
    )
    return float(((predicted - seen.pixels) ** 2).sum())
