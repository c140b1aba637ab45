"""The arm's kinematics in the controller's units, with the active tool centre point."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np

from drivers.simulators.ur.poses import MM_PER_M, Floats, matrix_of, pose_of
from mvp.kinematics import UrArm, jacobian

if TYPE_CHECKING:
    from collections.abc import Sequence


class NoSolutionError(ValueError):
    """No joint values reach the pose."""


class Kinematics:
    """Forward and inverse kinematics of one model, metres and rad.

    Args:
        model: a name of ``mvp.kinematics``, ur3e to ur30.
    """

    def __init__(self, model: str) -> None:
        self.arm = UrArm.of(model)

    def reachable(self, joints: Floats) -> bool:
        """Whether joints (6,) respect the limits."""
        inside = (self.arm.joint_low <= joints) & (joints <= self.arm.joint_high)
        return bool(inside.all())

    def flange(self, joints: Floats) -> Floats:
        """``base_from_flange`` (4, 4), m, of joints (6,)."""
        rotation, point_mm = self.arm.forward_batch(joints[None])
        matrix = np.eye(4)
        matrix[:3, :3] = rotation[0]
        matrix[:3, 3] = point_mm[0] / MM_PER_M
        return matrix

    def tool_pose(self, joints: Floats, tcp: Sequence[float]) -> Floats:
        """Pose (6,) of the tool centre point in the base frame."""
        return pose_of(self.flange(joints) @ _offset(tuple(tcp))[0])

    def joints(self, pose: Floats, tcp: Sequence[float], near: Floats) -> Floats:
        """Joints (6,) that bring the tool centre point to a pose, closest to ``near``.

        Raises:
            NoSolutionError: out of reach, or only beyond a joint limit.
        """
        return np.asarray(self.joints_along(matrix_of(pose)[None], tcp, near)[0])

    def joints_along(self, tools: Floats, tcp: Sequence[float], near: Floats) -> Floats:
        """Joints (n, 6) along transforms (n, 4, 4), m, each closest to the one before.

        Raises:
            NoSolutionError: one of them has no solution.
        """
        flanges = tools @ _offset(tuple(tcp))[1]
        branches, exists = self.arm.inverse_batch(
            flanges[:, :3, :3], flanges[:, :3, 3] * MM_PER_M, near=near
        )
        way = np.empty((len(tools), 6))
        for k in range(len(tools)):
            if not exists[k].any():
                raise NoSolutionError("get_inverse_kin: no solution for this pose")
            there = branches[k][exists[k]]
            near = there[np.abs(there - near).sum(axis=1).argmin()]
            way[k] = near
        return way

    def jacobian(self, joints: Floats, tcp: Sequence[float]) -> Floats:
        """(6, 6) velocity of the tool centre point, m and rad, per rad."""
        whole = jacobian(self.arm, joints)
        whole[:3] /= MM_PER_M
        lever = self.flange(joints)[:3, :3] @ np.asarray(tcp[:3], dtype=np.float64)
        whole[:3] += np.cross(whole[3:].T, lever).T
        return whole


@functools.lru_cache(maxsize=16)
def _offset(tcp: tuple[float, ...]) -> tuple[Floats, Floats]:
    """``flange_from_tool`` and its inverse."""
    matrix = matrix_of(tcp)
    return matrix, np.asarray(np.linalg.inv(matrix), dtype=np.float64)
