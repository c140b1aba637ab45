"""A Cartesian gantry with a pan/tilt head: five axes, so it dictates the roll.

``base_from_tool``: pivot at (x, y, z), then pan about the vertical, then tilt about the
head's horizontal axis, then ``pivot_to_tool_mm`` along the tool's z. At pan = tilt = 0
the tool looks straight down with its x along the base's x. The tool's x axis is always
horizontal: the roll rule (24) of the paper with both its solutions.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mvp.kinematics.capsule import Capsules
from mvp.kinematics.model import (
    forward_one,
    inside_limits,
    on_nearest_turn,
)

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, Pose
    from mvp.kinematics.model import JointUnit

ROLL_TOLERANCE_RAD = 1e-6
_FREE_PAN = 24


def _low() -> FloatArray:
    return np.array([-600.0, -600.0, 0.0, -np.pi, -np.radians(100.0)])


def _high() -> FloatArray:
    return np.array([600.0, 600.0, 900.0, np.pi, np.radians(100.0)])


@dataclass(frozen=True, eq=False)
class Gantry:
    """Joints (5,): x, y, z of the pivot in mm, pan and tilt in rad."""

    name: str = "gantry_xyz_pan_tilt"
    joint_low: FloatArray = field(default_factory=_low)
    joint_high: FloatArray = field(default_factory=_high)
    pivot_to_tool_mm: float = 40.0
    column_length_mm: float = 700.0
    column_radius_mm: float = 45.0
    head_radius_mm: float = 40.0

    joint_names = ("x", "y", "z", "pan", "tilt")
    joint_units: tuple[JointUnit, ...] = ("mm", "mm", "mm", "rad", "rad")
    dof = 5
    dictates_roll = True
    margin_labels = joint_names
    margin_units = joint_units
    fixed_links: tuple[str, ...] = ()
    self_pairs: tuple[tuple[str, str], ...] = ()
    tool_pairs = ("column",)

    @property
    def joint_speed(self) -> FloatArray:
        """(5,) mm/s and rad/s."""
        return np.array([300.0, 300.0, 150.0, np.radians(90.0), np.radians(90.0)])

    @property
    def joint_acceleration(self) -> FloatArray:
        """(5,) mm/s^2 and rad/s^2."""
        return np.array([1000.0, 1000.0, 500.0, np.radians(300.0), np.radians(300.0)])

    @property
    def levers_mm(self) -> FloatArray:
        """Upper bounds (3, 5): see ``ArmModel.levers_mm``."""
        head = self.pivot_to_tool_mm
        return np.array(
            [[1.0, 1, 1, 0, 0], [1.0, 1, 1, head, head], [1.0, 1, 1, head, head]]
        )

    def forward(self, joints: FloatArray) -> Pose:
        """``base_from_tool`` of one configuration."""
        return forward_one(self, joints)

    def forward_batch(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotations (M, 3, 3) and flange points (M, 3), mm."""
        q = np.atleast_2d(np.asarray(joints, dtype=np.float64))
        rotation = _head(q[:, 3], q[:, 4])
        return rotation, q[:, :3] + self.pivot_to_tool_mm * rotation[:, :, 2]

    def inverse_batch(
        self,
        rotation: FloatArray,
        translation_mm: FloatArray,
        *,
        near: FloatArray | None = None,
    ) -> tuple[FloatArray, BoolArray]:
        """One branch of N poses: joints (N, 1, 5), and whether it exists (N, 1).

        It does not where the roll is not the one that the head gives.
        """
        reference = np.zeros(5) if near is None else np.asarray(near, np.float64)
        pan = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
        swing = np.stack([-np.sin(pan), np.cos(pan), np.zeros_like(pan)], axis=1)
        z = rotation[:, :, 2]
        tilt = np.arctan2((z * swing).sum(axis=1), -z[:, 2])
        pivot = translation_mm - self.pivot_to_tool_mm * rotation[:, :, 2]
        angles = on_nearest_turn(
            np.stack([pan, tilt], axis=1),
            reference[3:],
            self.joint_low[3:],
            self.joint_high[3:],
        )
        joints = np.concatenate([pivot, angles], axis=1)[:, None, :]
        level = np.abs(rotation[:, 2, 0]) <= ROLL_TOLERANCE_RAD
        inside = inside_limits(joints, self.joint_low, self.joint_high)
        return joints, inside & level[:, None]

    def margins(self, joints: FloatArray) -> FloatArray:
        """Slack (M, 5) to the limits, mm for the slides, rad for the head."""
        q = np.atleast_2d(joints)
        return np.asarray(np.minimum(q - self.joint_low, self.joint_high - q))

    def links_batch(self, joints: FloatArray) -> Capsules:
        """Column and head of M configurations, base frame."""
        q = np.atleast_2d(np.asarray(joints, dtype=np.float64))
        rotation, flange = self.forward_batch(q)
        pivot = q[:, :3]
        up = np.array([0.0, 0.0, 1.0])
        foot = pivot + (self.head_radius_mm + self.column_radius_mm) * up
        face = flange - rotation[:, :, 2] * min(
            self.head_radius_mm, self.pivot_to_tool_mm
        )
        return Capsules(
            ("column", "pan tilt head"),
            np.array([self.column_radius_mm, self.head_radius_mm]),
            np.stack([foot, pivot], axis=1),
            np.stack([pivot + self.column_length_mm * up, face], axis=1),
        )

    def camera_rotations(
        self,
        direction_base: FloatArray,
        camera_rotations: FloatArray,
        tool_from_camera: FloatArray,
    ) -> FloatArray:
        """The camera rotations (N, M', 3, 3) that the head can give.

        Two per viewing direction (head turned round); straight down along the pan axis
        every pan serves, and a fan of them is returned.
        """
        axis = np.asarray(tool_from_camera, np.float64)[:, 2]
        return _towards(np.asarray(direction_base, np.float64), axis) @ tool_from_camera


def _head(pan: FloatArray, tilt: FloatArray) -> FloatArray:
    """Rotations (..., 3, 3) Rz(pan) Rx(tilt) Rx(pi)."""
    cp, sp, ct, st = np.cos(pan), np.sin(pan), np.cos(tilt), np.sin(tilt)
    x = np.stack([cp, sp, np.zeros_like(cp)], axis=-1)
    y = np.stack([sp * ct, -cp * ct, -st], axis=-1)
    z = np.stack([-sp * st, cp * st, -ct], axis=-1)
    return np.stack([x, y, z], axis=-1)


def _towards(direction: FloatArray, axis_tool: FloatArray) -> FloatArray:
    """Head rotations (N, M, 3, 3) that turn ``axis_tool`` into each direction.

    nan where the axis sits askew on the flange and the direction is out of its cone.
    """
    ax, ay, az = axis_tool
    with np.errstate(invalid="ignore"):
        swing = np.arccos(np.clip(-direction[:, 2] / np.hypot(ay, az), -2, 2))
    tilt = np.arctan2(ay, az) + np.stack([swing, -swing], axis=1)
    across = az * np.sin(tilt) - ay * np.cos(tilt)
    heading = np.arctan2(direction[:, 1], direction[:, 0])[:, None]
    pan = heading - np.arctan2(across, ax)
    free = np.hypot(across, ax) < ROLL_TOLERANCE_RAD
    if free.any():
        fan = np.linspace(0.0, 2 * np.pi, _FREE_PAN, endpoint=False)
        tilt, pan, free = (np.tile(v, (1, _FREE_PAN // 2)) for v in (tilt, pan, free))
        pan = np.where(free, fan, pan)
    return _head(pan, tilt)
