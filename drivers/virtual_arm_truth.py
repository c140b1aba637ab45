"""Where the flange of the virtual arm truly is, beside what the arm reports."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import Pose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.virtual_settings import ArmFaults, WorldErrors
    from mvp.geometry import BoolArray, FloatArray
    from mvp.kinematics import ArmModel

_WAVES = 8
_PER_RAD = 8.0  # how quickly the error changes: radians of a wave per radian of a joint
_PER_MM = 1 / 40
_UNSEEN_MM = 1e-4
_STREAM = 7  # of the world's seed: other errors keep their directions


def true_joints(model: ArmModel, joints: FloatArray, errors: WorldErrors) -> FloatArray:
    """(dof,) the reported joints with the configured offsets, given in deg or mm."""
    offset = np.zeros(len(joints))
    offset[: len(errors.arm_joints_deg)] = errors.arm_joints_deg
    turning = _turning(model.joint_units)
    return np.asarray(joints + np.where(turning, np.radians(offset), offset))


def true_flange(
    model: ArmModel, joints: FloatArray, errors: WorldErrors, seed: int
) -> Pose:
    """The flange of an arm whose geometry is not quite its model's.

    Each of the six errors is a sum of waves over the joints, with random directions and
    phases: smooth, the same whenever the arm comes back, and of the configured standard
    deviation over all places.
    """
    nominal = model.forward(joints)
    if not (errors.arm_mm or errors.arm_deg):
        return nominal
    rng = np.random.default_rng([seed, _STREAM])
    rates = np.where(_turning(model.joint_units), _PER_RAD, _PER_MM)
    ways = rng.normal(size=(6, _WAVES, len(joints))) * rates
    phases = rng.uniform(0, 2 * np.pi, size=(6, _WAVES))
    waves = np.sin(ways @ joints + phases).sum(axis=1) * np.sqrt(2 / _WAVES)
    turn, shift = np.radians(errors.arm_deg) * waves[:3], errors.arm_mm * waves[3:]
    return nominal @ Pose.from_rotvec("tool", "tool", turn, shift)


def ringing(faults: ArmFaults, since_s: float) -> Pose:
    """Where a flange that rings is, against the place where its encoders stand.

    Args:
        faults: how it rings; along x of the flange.
        since_s: since the encoders stand; it does not ring before.
    """
    x_mm = 0.0
    if faults.ring_mm and 0 <= since_s < np.inf:
        left_mm = faults.ring_mm * np.exp(-since_s / faults.ring_decay_s)
        x_mm = left_mm * np.sin(2 * np.pi * faults.ring_hz * since_s)
    return Pose.from_rotvec("tool", "tool", [0.0, 0.0, 0.0], [x_mm, 0.0, 0.0])


def still_rings(faults: ArmFaults, since_s: float) -> bool:
    """Whether the flange swings by more than nobody could see."""
    left_mm = faults.ring_mm * float(np.exp(-max(since_s, 0.0) / faults.ring_decay_s))
    return 0 <= since_s and left_mm > _UNSEEN_MM


def _turning(units: Sequence[str]) -> BoolArray:
    return np.array([unit == "rad" for unit in units])
