"""What each view would teach, by the estimators' own residual models.

The information of a view about the shared unknowns is what is left of J'J / sigma^2 when
the numbers of the view alone (the target's pose, or how far the arm was from its word)
are eliminated. The weight of a task turns a covariance C of the unknowns into a mean
squared error on the work: trace(C W), mm^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.projection import project_with_derivatives, skew, to_normalised

if TYPE_CHECKING:
    from calibration.bundle import Freedom
    from calibration.hand_eye import CameraPrior, RobotNoise
    from calibration.poses import Poses
    from calibration.projection import PinholeCamera
    from calibration.wizard.next_pose_candidates import TargetViews
    from mvp.geometry import FloatArray

_GRID = (7, 9)
_UNKNOWN_PLACE = np.repeat([30.0, 0.15], 3)


def camera_information(
    camera: PinholeCamera, free: Freedom, views: TargetViews, sigma_px: float
) -> FloatArray:
    """(n, k, k): of every view about the free numbers of a camera.

    Args:
        camera: intrinsics as known so far.
        free: which numbers are estimated.
        views: what they show.
        sigma_px: one standard deviation of a found coordinate.
    """
    poses = views.camera_from_target
    found = project_with_derivatives(
        camera,
        poses.rotation[:, None],
        poses.translation_mm[:, None],
        views.points_target_mm,
    )
    weight = views.seen[..., None, None] / sigma_px
    shared = np.nan_to_num(found.d_camera @ free.basis) * weight
    own = np.nan_to_num(found.d_pose) * weight
    scale = np.array([1.0, 1, 1, 1e-3, 1e-3, 1e-3])
    return _left(shared, own * scale, 1e-9 * np.eye(6))


def camera_task(
    camera: PinholeCamera, free: Freedom, size_px: tuple[int, int], distance_mm: float
) -> FloatArray:
    """(k, k) weight: error of a point at a distance, mean over the picture, mm^2.

    The pose of the camera is taken to be known from elsewhere, so that every error of
    the intrinsics shows.
    """
    across = np.linspace(0, size_px[0] - 1, _GRID[1])
    down = np.linspace(0, size_px[1] - 1, _GRID[0])
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = to_normalised(camera.without_distortion(), pixels)
    points = distance_mm * np.pad(rays, ((0, 0), (0, 1)), constant_values=1.0)
    found = project_with_derivatives(camera, np.eye(3), np.zeros(3), points)
    mm_per_px = distance_mm / np.array([camera.fx_px, camera.fy_px])
    rows = (found.d_camera @ free.basis) * mm_per_px[:, None]
    return np.asarray(np.einsum("pij,pik->jk", rows, rows) / len(rows))


@dataclass(frozen=True, eq=False)
class HandEyeBelief:
    """What is believed of a camera on the hand while views are chosen.

    Attributes:
        tool_from_camera: a set of one, at the lens setting of the views.
        base_from_target: a set of one.
        prior: intrinsics and what may move of them.
        robot: noise of a reported pose.
        sigma_px: one standard deviation of a found coordinate.
    """

    tool_from_camera: Poses
    base_from_target: Poses
    prior: CameraPrior
    robot: RobotNoise
    sigma_px: float

    @property
    def before(self) -> FloatArray:
        """(12 + k, 12 + k): what is known without any view; hardly anything."""
        own = np.diag(np.tile(_UNKNOWN_PLACE**-2.0, 2))
        whitener = self.prior.whitener
        k = len(self.prior.names)
        found = np.zeros((12 + k, 12 + k))
        found[:12, :12] = own
        found[12:, 12:] = whitener.T @ whitener
        return found


def hand_eye_information(belief: HandEyeBelief, views: TargetViews) -> FloatArray:
    """(n, 12 + k, 12 + k): of every view about X, Z and k camera numbers.

    The order is that of ``HandEyeProblem``; the arm's slack of the view is eliminated.
    """
    x, z = belief.tool_from_camera, belief.base_from_target
    poses, points = views.camera_from_target, views.points_target_mm
    to_camera = x.rotation[0].T
    from_base = poses.rotation @ z.rotation[0].T
    turned = points @ z.rotation[0].T
    in_camera = points @ np.swapaxes(poses.rotation, 1, 2)
    in_camera = in_camera + poses.translation_mm[:, None]
    lever = in_camera @ x.rotation[0].T
    arm = (in_camera + x.rotation[0].T @ x.translation_mm[0]) @ from_base
    found = project_with_derivatives(
        belief.prior.camera, np.eye(3), np.zeros(3), in_camera
    )
    ones = np.broadcast_to(np.eye(3), (*lever.shape[:2], 3, 3))
    d_x = to_camera @ np.concatenate([-ones, skew(lever)], axis=-1)
    d_z = from_base[:, None] @ np.concatenate(
        [ones, np.broadcast_to(-skew(turned), ones.shape)], axis=-1
    )
    d_slack = from_base[:, None] @ np.concatenate([-ones, skew(arm)], axis=-1)
    weight = views.seen[..., None, None] / belief.sigma_px
    d_point = np.nan_to_num(found.d_point) * weight
    d_camera = np.nan_to_num(found.d_camera[..., belief.prior.index]) * weight
    shared = np.concatenate([d_point @ d_x, d_point @ d_z, d_camera], axis=-1)
    return _left(shared, d_point @ d_slack, np.diag(belief.robot.sigmas**-2.0))


def hand_eye_task(belief: HandEyeBelief, stand_off_mm: float) -> FloatArray:
    """(12 + k, 12 + k) weight: error of a point on the axis at a distance, mm^2."""
    rotation = belief.tool_from_camera.rotation[0]
    lever = rotation @ np.array([0.0, 0.0, stand_off_mm])
    rows = np.zeros((3, 12 + len(belief.prior.names)))
    rows[:, :6] = np.hstack([np.eye(3), -skew(lever)])
    return np.asarray(rows.T @ rows)


def _left(shared: FloatArray, own: FloatArray, prior: FloatArray) -> FloatArray:
    """(n, k, k) of rows (n, m, 2, k) when (n, m, 2, l) with a prior are eliminated."""
    views = len(shared)
    a = shared.reshape(views, -1, shared.shape[-1])
    b = own.reshape(views, -1, own.shape[-1])
    at = np.swapaxes(a, 1, 2)
    inner = np.swapaxes(b, 1, 2) @ b + prior
    cross = np.swapaxes(b, 1, 2) @ a
    return np.asarray(at @ a - np.swapaxes(cross, 1, 2) @ np.linalg.solve(inner, cross))
