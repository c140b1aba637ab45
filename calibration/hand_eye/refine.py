"""Maximum likelihood: hand-eye, target and the true pose of the robot in every view.

Pixels alone are not enough. A robot pose that is off moves all points of its picture
together; counted as so many independent facts they outvote the other views, and the
result is worse than a closed form. Each view therefore has six numbers of its own for
how far the robot was from where it said, held by the robot's noise (slack).

The chain is ``camera_from_target = X^-1 M Z`` with ``M = tool_from_base`` for a camera on
the hand and ``M = base_from_tool`` for one beside the robot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from calibration.poses import Poses, difference
from calibration.projection import (
    CAMERA_NAMES,
    POSE_NAMES,
    PinholeCamera,
    moved_pose,
    project_with_derivatives,
    skew,
)

if TYPE_CHECKING:
    from calibration.hand_eye.data import HandEyeData
    from calibration.projection import Projection
    from mvp.geometry import FloatArray


@dataclass(frozen=True, eq=False)
class CameraPrior:
    """What a camera calibration knows of the numbers that may move.

    Attributes:
        camera: its result.
        names: (k,) of ``CAMERA_NAMES`` that may move.
        covariance: (k, k) of them.
    """

    camera: PinholeCamera
    names: tuple[str, ...]
    covariance: FloatArray

    @property
    def index(self) -> list[int]:
        """Where the free numbers are among the nine."""
        return [CAMERA_NAMES.index(name) for name in self.names]

    @property
    def whitener(self) -> FloatArray:
        """(k, k): W such that W'W is the inverse of the covariance."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)))


def fixed_camera(camera: PinholeCamera) -> CameraPrior:
    """Nothing of the camera may move."""
    return CameraPrior(camera, (), np.zeros((0, 0)))


@dataclass(frozen=True, eq=False)
class Chain:
    """A state of the refinement.

    Attributes:
        camera: intrinsics.
        moving_from_camera: X, a set of one.
        fixed_from_target: Z, a set of one.
        base_from_tool: where the robot truly was in each view.
    """

    camera: PinholeCamera
    moving_from_camera: Poses
    fixed_from_target: Poses
    base_from_tool: Poses


@dataclass(frozen=True, eq=False)
class HandEyeProblem:
    """Residuals of all points, the slack of all views and the camera's prior.

    Steps: X (6, moving axes), Z (6, fixed axes), k camera numbers, 6 for each view
    (base axes).

    Attributes:
        data: poses and pictures; its ``sigma_px`` whitens the pixels.
        prior: camera and what may move of it.
        slack_sigmas: (6,) translation (mm) and rotation (rad) of the robot's noise.
    """

    data: HandEyeData
    prior: CameraPrior
    slack_sigmas: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Of all steps."""
        slack = [
            f"slack_{name}_{view}"
            for view in self.data.seen.names
            for name in POSE_NAMES
        ]
        both = [
            f"{frame}_{name}" for frame in ("camera", "target") for name in POSE_NAMES
        ]
        return (*both, *self.prior.names, *slack)

    @property
    def scales(self) -> FloatArray:
        """1 mm, 0.1 deg, one sigma of the camera's prior."""
        pose = np.array([1.0, 1, 1, 1.7e-3, 1.7e-3, 1.7e-3])
        camera = np.sqrt(np.diag(self.prior.covariance))
        return np.concatenate(
            [pose, pose, camera, np.tile(pose, len(self.data.base_from_tool))]
        )

    @property
    def prior_rows(self) -> int:
        """Slack and camera."""
        return len(self.prior.names) + 6 * len(self.data.base_from_tool)

    def residuals(self, state: Chain) -> FloatArray:
        """(2 m + k + 6 n,), whitened; nan behind the camera."""
        pixels = self._seen(state)[0].pixels
        off = (pixels - self.data.seen.pixels) / self.data.sigma_px
        index = self.prior.index
        moved = (state.camera.values - self.prior.camera.values)[index]
        slack = difference(state.base_from_tool, self.data.base_from_tool)
        return np.concatenate(
            [
                off.ravel(),
                self.prior.whitener @ moved,
                (slack / self.slack_sigmas).ravel(),
            ]
        )

    def jacobian(self, state: Chain) -> sparse.csr_matrix:
        """(2 m + k + 6 n, 12 + k + 6 n), six of the last columns filled per row."""
        seen, d_x, d_z, d_slack = self._seen(state)
        views, k = len(state.base_from_tool), len(self.prior.names)
        common = np.concatenate(
            [
                seen.d_point @ d_x,
                seen.d_point @ d_z,
                seen.d_camera[..., self.prior.index],
            ],
            axis=2,
        ).reshape(-1, 12 + k)
        slack = (seen.d_point @ d_slack).reshape(-1, 6) / self.data.sigma_px
        column = 6 * np.repeat(self.data.seen.view, 2)[:, None] + np.arange(6)
        blocks = sparse.csr_matrix(
            (slack.ravel(), column.ravel(), np.arange(0, slack.size + 1, 6)),
            shape=(len(slack), 6 * views),
        )
        camera = np.pad(self.prior.whitener, ((0, 0), (12, 0)))
        own = sparse.diags(np.tile(1 / self.slack_sigmas, views))
        return sparse.csr_matrix(
            sparse.bmat(
                [
                    [sparse.csr_matrix(common / self.data.sigma_px), blocks],
                    [sparse.csr_matrix(camera), None],
                    [None, own],
                ]
            )
        )

    def moved(self, state: Chain, step: FloatArray) -> Chain:
        """A step of everything."""
        k = len(self.prior.names)
        values = state.camera.values
        values[self.prior.index] += step[12 : 12 + k]
        return Chain(
            PinholeCamera.from_values(values),
            _moved(state.moving_from_camera, step[None, :6]),
            _moved(state.fixed_from_target, step[None, 6:12]),
            _moved(state.base_from_tool, step[12 + k :].reshape(-1, 6)),
        )

    def with_noise(self, sigma_px: float, slack_sigmas: FloatArray) -> HandEyeProblem:
        """The same with another idea of the noise."""
        return replace(
            self, data=replace(self.data, sigma_px=sigma_px), slack_sigmas=slack_sigmas
        )

    def _seen(
        self, state: Chain
    ) -> tuple[Projection, FloatArray, FloatArray, FloatArray]:
        """Pixels, and the derivatives (m, 3, 6) of camera points for X, Z and slack."""
        view = self.data.seen.view
        x, z = state.moving_from_camera, state.fixed_from_target
        to_camera = x.rotation[0].T
        turned = self.data.seen.points_target_mm @ z.rotation[0].T
        fixed = turned + z.translation_mm[0]
        robot = state.base_from_tool
        if self.data.mount == "eye-in-hand":
            to_moving = np.swapaxes(robot.rotation, 1, 2)[view]
            arm = fixed - robot.translation_mm[view]
            moving = np.einsum("mij,mj->mi", to_moving, arm)
            d_robot = -np.concatenate([to_moving, -to_moving @ skew(arm)], axis=2)
        else:
            to_moving = robot.rotation[view]
            arm = np.einsum("mij,mj->mi", to_moving, fixed)
            moving = arm + robot.translation_mm[view]
            ones = np.broadcast_to(np.eye(3), to_moving.shape)
            d_robot = np.concatenate([ones, -skew(arm)], axis=2)
        lever = moving - x.translation_mm[0]
        ones = np.broadcast_to(np.eye(3), to_moving.shape)
        seen = project_with_derivatives(
            state.camera, np.eye(3), np.zeros(3), lever @ to_camera.T
        )
        return (
            seen,
            to_camera @ np.concatenate([-ones, skew(lever)], axis=2),
            to_camera @ to_moving @ np.concatenate([ones, -skew(turned)], axis=2),
            to_camera @ d_robot,
        )


def camera_from_target(state: Chain, data: HandEyeData, robot: Poses) -> Poses:
    """Where the chain puts the target in each view, for some robot poses."""
    moving_from_fixed = robot.inverse() if data.mount == "eye-in-hand" else robot
    return (
        state.moving_from_camera.inverse() @ moving_from_fixed @ state.fixed_from_target
    )


def _moved(poses: Poses, step: FloatArray) -> Poses:
    return Poses(*moved_pose(poses.rotation, poses.translation_mm, step))
