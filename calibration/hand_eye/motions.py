"""Pairs of views as motions A X = X B.

One form serves both mounts. With the camera on the hand, ``fixed_from_moving`` is
``base_from_tool`` and X is ``tool_from_camera``; with the camera beside the robot and the
target on the hand, ``fixed_from_moving`` is ``tool_from_base`` and X is
``base_from_camera``. In both, ``fixed_from_moving @ X @ camera_from_target`` is the same
transform Z (``base_from_target``, ``tool_from_target``) in every view.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from calibration.poses import Poses
    from mvp.geometry import BoolArray, FloatArray

Mount = Literal["eye-in-hand", "eye-to-hand"]

LEAST_TURN_RAD = float(np.radians(15.0))
MOST_TURN_RAD = float(np.radians(175.0))


def fixed_from_moving(base_from_tool: Poses, mount: Mount) -> Poses:
    """The robot's part of the chain: its poses as told, or their inverses."""
    return base_from_tool if mount == "eye-in-hand" else base_from_tool.inverse()


@dataclass(frozen=True, eq=False)
class Motions:
    """Relative motions A (of the moving frame) and B (of the camera), A X = X B.

    Attributes:
        moving: m motions ``moving_j from moving_i``.
        camera: m motions ``camera_j from camera_i``.
    """

    moving: Poses
    camera: Poses

    @property
    def turns_rad(self) -> FloatArray:
        """(m, 2): angle of A and of B; equal without noise."""
        angles = [self.moving.rotvec_rad, self.camera.rotvec_rad]
        return np.stack([np.linalg.norm(angle, axis=1) for angle in angles], axis=1)

    def some(self, chosen: BoolArray) -> Motions:
        """The chosen motions."""
        return Motions(self.moving[chosen], self.camera[chosen])


def all_pairs(fixed_from_moving: Poses, camera_from_target: Poses) -> Motions:
    """The n (n - 1) / 2 motions between any two views.

    Raises:
        ValueError: numbers of poses differ, or fewer than two.
    """
    count = len(fixed_from_moving)
    if count != len(camera_from_target) or count < 2:
        raise ValueError("two views or more, with as many robot as target poses")
    first, second = np.triu_indices(count, 1)
    return Motions(
        fixed_from_moving[second].inverse() @ fixed_from_moving[first],
        camera_from_target[second] @ camera_from_target[first].inverse(),
    )


def usable(motions: Motions) -> Motions:
    """Motions whose rotation axis is well defined, if they are half of all or more.

    Small rotations have noisy axes; near 180 degrees the sign of the axis is a toss.
    """
    turns = motions.turns_rad
    fit = (turns.min(axis=1) >= LEAST_TURN_RAD) & (turns.max(axis=1) <= MOST_TURN_RAD)
    return motions.some(fit) if 2 * fit.sum() >= fit.size else motions
