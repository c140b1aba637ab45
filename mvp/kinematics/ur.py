"""Universal Robots arms: forward and inverse kinematics in closed form.

Nominal Denavit-Hartenberg values as published by the maker. A real arm carries its own
calibrated values, which differ by up to a few millimetres; with its factory calibration
the closed form is only where the search for the true solutions starts. The pose that a
run records is the controller's in any case, never this model's. Base frame as the controller's (not the one
turned by 180 degrees that ROS uses).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.kinematics.capsule import Capsules
from mvp.kinematics.model import (
    forward_one,
    inside_limits,
    on_nearest_turn,
)
from mvp.kinematics.ur_calibration import FARTHEST_MM

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, Pose
    from mvp.kinematics.model import JointUnit
    from mvp.kinematics.ur_calibration import UrCalibration

JOINTS = ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3")
LINKS = (
    "base link",
    "shoulder link",
    "upper arm",
    "forearm",
    "wrist 1 link",
    "wrist 2 link",
    "wrist 3 link",
)
_WRIST_SINGULAR = 1e-9
_SIGN = np.array([1.0, -1.0])
# Where a calibrated arm may reach although the nominal one just cannot.
_CALIBRATED_SLACK = 0.1
_EDGE = 0.999


@dataclass(frozen=True)
class UrGeometry:
    """Denavit-Hartenberg lengths and link sizes, mm.

    ``upper_arm_offset`` and ``forearm_offset``: where the tubes run, along the shoulder
    axis. ``radii``: of base, shoulder, upper arm, forearm and the three wrist links,
    on the safe side of the castings. ``speeds_deg_s``: of the six joints.
    """

    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float
    upper_arm_offset: float
    forearm_offset: float
    radii: tuple[float, float, float, float, float, float, float]
    speeds_deg_s: tuple[float, float, float, float, float, float]


_SIZE_3 = (64.0, 58.0, 50.0, 42.0, 40.0, 38.0, 36.0)
_SIZE_5 = (76.0, 70.0, 60.0, 52.0, 48.0, 46.0, 42.0)
_SIZE_10 = (96.0, 90.0, 75.0, 62.0, 58.0, 56.0, 50.0)
_SIZE_20 = (125.0, 118.0, 100.0, 80.0, 70.0, 68.0, 60.0)
_FAST = (180.0,) * 6
_LARGE = (120.0, 120.0, 180.0, 180.0, 180.0, 180.0)
_HEAVY = (120.0, 120.0, 150.0, 210.0, 210.0, 210.0)

_UR5 = UrGeometry(162.5, -425.0, -392.2, 133.3, 99.7, 99.6, 138.0, 7.0, _SIZE_5, _FAST)
_UR10 = UrGeometry(
    180.7, -612.7, -571.55, 174.15, 119.85, 116.55, 176.0, 39.3, _SIZE_10, _LARGE
)
UR_FAMILY: dict[str, UrGeometry] = {
    "ur3e": UrGeometry(
        151.85,
        -243.55,
        -213.2,
        131.05,
        85.35,
        92.1,
        120.0,
        27.0,
        _SIZE_3,
        (180.0, 180.0, 180.0, 360.0, 360.0, 360.0),
    ),
    "ur5e": _UR5,
    "ur7e": _UR5,
    "ur10e": _UR10,
    "ur12e": _UR10,
    "ur16e": UrGeometry(
        180.7, -478.4, -360.0, 174.15, 119.85, 116.55, 176.0, 39.3, _SIZE_10, _LARGE
    ),
    "ur20": UrGeometry(
        236.3, -862.0, -728.7, 201.0, 159.3, 154.3, 260.0, 43.0, _SIZE_20, _HEAVY
    ),
    "ur30": UrGeometry(
        236.3, -637.0, -503.7, 201.0, 159.3, 154.3, 260.0, 43.0, _SIZE_20, _HEAVY
    ),
}

_LIMIT = np.radians([360.0, 360.0, 180.0, 360.0, 360.0, 360.0])
_ACCELERATION_RAD_S2 = 1.4


@dataclass(frozen=True, eq=False)
class UrArm:
    """One arm of the family; joints (6,) in rad."""

    name: str
    geometry: UrGeometry
    joint_low: FloatArray
    joint_high: FloatArray
    calibration: UrCalibration | None = None

    joint_names = JOINTS
    joint_units: tuple[JointUnit, ...] = ("rad",) * 6
    dof = 6
    dictates_roll = False
    margin_labels = (*JOINTS, "elbow from straight", "wrist from the shoulder axis")
    margin_units: tuple[JointUnit, ...] = ("rad",) * 8
    fixed_links = (LINKS[0],)
    tool_pairs = LINKS[:4]
    self_pairs = tuple((LINKS[i], LINKS[j]) for i in (0, 1, 2) for j in (5, 6)) + tuple(
        (LINKS[i], LINKS[j]) for i, j in ((0, 3), (0, 4), (2, 4), (3, 6))
    )

    @classmethod
    def of(
        cls,
        name: str,
        *,
        joint_low: FloatArray | None = None,
        joint_high: FloatArray | None = None,
    ) -> UrArm:
        """An arm of the family by name, with the maker's or narrower joint limits."""
        low = -_LIMIT if joint_low is None else np.asarray(joint_low, np.float64)
        high = _LIMIT if joint_high is None else np.asarray(joint_high, np.float64)
        return cls(name, UR_FAMILY[name], low, high)

    @property
    def joint_speed(self) -> FloatArray:
        """(6,) rad/s."""
        return np.radians(self.geometry.speeds_deg_s)

    @property
    def joint_acceleration(self) -> FloatArray:
        """(6,) rad/s^2, the controller's default for joint moves."""
        return np.full(6, _ACCELERATION_RAD_S2)

    @property
    def levers_mm(self) -> FloatArray:
        """Upper bounds (8, 6), mm per rad: see ``ArmModel.levers_mm``.

        The links of wrist 1, 2 and 3 lie on their own axes. Links stay where a nominal
        arm has them; only the flange is a calibrated one's.
        """
        g = self.geometry
        a2, a23 = abs(g.a2), abs(g.a2) + abs(g.a3)
        side = max(abs(g.upper_arm_offset), abs(g.forearm_offset), g.d4)
        hand = g.d5 + g.d6
        forearm = [a23 + side, a23, abs(g.a3), 0, 0, 0]
        flange = [a23 + hand + side, a23 + hand, abs(g.a3) + hand, hand, g.d6, 0]
        off = 0.0 if self.calibration is None else FARTHEST_MM
        return np.array(
            [
                [0] * 6,
                [abs(g.upper_arm_offset), 0, 0, 0, 0, 0],
                [a2 + side, a2, 0, 0, 0, 0],
                forearm,
                forearm,
                [a23 + g.d5 + side, a23 + g.d5, abs(g.a3) + g.d5, g.d5, 0, 0],
                flange,
                [lever + off for lever in flange],
            ],
            dtype=np.float64,
        )

    def forward(self, joints: FloatArray) -> Pose:
        """``base_from_tool`` of one configuration."""
        return forward_one(self, joints)

    def forward_batch(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotations (M, 3, 3) and flange points (M, 3), mm."""
        if self.calibration is not None:
            return self.calibration.forward(joints)
        frames = _Frames.of(self.geometry, joints)
        return frames.rotation, frames.points[:, 6]

    def inverse_batch(
        self,
        rotation: FloatArray,
        translation_mm: FloatArray,
        *,
        near: FloatArray | None = None,
    ) -> tuple[FloatArray, BoolArray]:
        """Eight branches of N poses: joints (N, 8, 6), and which of them exist (N, 8).

        At a wrist singularity wrist 3 is free and takes its value from ``near``.
        """
        reference = np.zeros(6) if near is None else np.asarray(near, np.float64)
        slack = 0.0 if self.calibration is None else _CALIBRATED_SLACK
        joints = _branches(
            self.geometry, rotation, translation_mm, reference[5], slack=slack
        )
        if self.calibration is not None:
            found = np.isfinite(joints).all(axis=-1)
            pose = np.nonzero(found)[0]
            joints[found] = self.calibration.refine(
                joints[found], rotation[pose], translation_mm[pose]
            )
        joints = on_nearest_turn(joints, reference, self.joint_low, self.joint_high)
        exists = np.isfinite(joints).all(axis=-1)
        return joints, exists & inside_limits(joints, self.joint_low, self.joint_high)

    def margins(self, joints: FloatArray) -> FloatArray:
        """Slack (M, 8), rad: six joint limits, elbow angle, angle to the inner wall."""
        q = np.atleast_2d(joints)
        limits = np.minimum(q - self.joint_low, self.joint_high - q)
        wrist = _Frames.of(self.geometry, q).points[:, 5]
        ratio = self.geometry.d4 / np.maximum(np.hypot(wrist[:, 0], wrist[:, 1]), 1e-9)
        inner = np.arccos(np.clip(ratio, -1, 1))
        return np.column_stack([limits, np.abs(q[:, 2]), inner])

    def links_batch(self, joints: FloatArray) -> Capsules:
        """The seven links of M configurations, base frame."""
        g = self.geometry
        frames = _Frames.of(g, joints)
        p, side = frames.points, frames.shoulder_axis
        upper, fore = side * g.upper_arm_offset, side * g.forearm_offset
        # The last link ends at the flange's face, so its round end stays behind it.
        face = p[:, 6] - frames.rotation[:, :, 2] * min(g.radii[6], g.d6)
        starts = [p[:, 0], p[:, 1], p[:, 1] + upper, p[:, 2] + fore, p[:, 3] + fore]
        ends = [p[:, 1], p[:, 1] + upper, p[:, 2] + upper, p[:, 3] + fore, p[:, 4]]
        return Capsules(
            LINKS,
            np.array(g.radii),
            np.stack([*starts, p[:, 4], p[:, 5]], axis=1),
            np.stack([*ends, p[:, 5], face], axis=1),
        )

    def camera_rotations(
        self,
        direction_base: FloatArray,
        camera_rotations: FloatArray,
        tool_from_camera: FloatArray,
    ) -> FloatArray:
        """What was asked for: the wrist gives any roll."""
        return camera_rotations


@dataclass(frozen=True, eq=False)
class _Frames:
    """Origins (M, 7, 3) of the DH frames, the shoulder axis and the flange rotation."""

    points: FloatArray
    shoulder_axis: FloatArray
    rotation: FloatArray

    @classmethod
    def of(cls, g: UrGeometry, joints: FloatArray) -> _Frames:
        q = np.atleast_2d(np.asarray(joints, dtype=np.float64))
        c, s = np.cos(q), np.sin(q)
        zero = np.zeros(len(q))
        outwards = np.stack([c[:, 0], s[:, 0], zero], axis=1)
        side = np.stack([s[:, 0], -c[:, 0], zero], axis=1)

        def ray(angle: FloatArray) -> FloatArray:
            up = np.sin(angle)[:, None] * np.array([0.0, 0.0, 1.0])
            return np.asarray(np.cos(angle)[:, None] * outwards + up)

        x4 = ray(q[:, 1] + q[:, 2] + q[:, 3])
        z4 = np.cross(x4, side)
        x5 = c[:, 4:5] * x4 + s[:, 4:5] * side
        z5 = c[:, 4:5] * side - s[:, 4:5] * x4
        x6 = c[:, 5:6] * x5 - s[:, 5:6] * z4
        y6 = -s[:, 5:6] * x5 - c[:, 5:6] * z4
        p1 = np.broadcast_to([0.0, 0.0, g.d1], (len(q), 3))
        p2 = p1 + g.a2 * ray(q[:, 1])
        p3 = p2 + g.a3 * ray(q[:, 1] + q[:, 2])
        p4 = p3 + g.d4 * side
        p5 = p4 + g.d5 * z4
        points = [np.zeros_like(p1), p1, p2, p3, p4, p5, p5 + g.d6 * z5]
        rotation = np.stack([x6, y6, z5], axis=2)
        return cls(np.stack(points, axis=1), side, rotation)


def _branches(
    g: UrGeometry,
    rotation: FloatArray,
    point_mm: FloatArray,
    free_wrist_rad: float,
    *,
    slack: float,
) -> FloatArray:
    """All branches (N, 8, 6) before turns and limits; nan where there is none.

    Two shoulders, for each two wrists, for each two elbows. With ``slack``, poses out
    of reach by that share are given the branches of the nearest pose within.
    """
    x6, y6, z6 = (rotation[:, None, :, k] for k in range(3))
    p5 = point_mm[:, None, :] - g.d6 * z6
    with np.errstate(invalid="ignore", divide="ignore"):
        q1 = _shoulder_angles(g, p5, slack)
        out = np.stack([np.cos(q1), np.sin(q1), np.zeros_like(q1)], axis=-1)
        side = np.stack([out[..., 1], -out[..., 0], out[..., 2]], axis=-1)
        vx, vy, vz = (_dot(axis, side)[..., None] for axis in (x6, y6, z6))
        s5 = _SIGN * np.hypot(vx, vy)
        q5 = np.arctan2(s5, vz)
        q6 = np.arctan2(-vy * _SIGN, vx * _SIGN)
        q6 = np.where(np.abs(s5) < _WRIST_SINGULAR, free_wrist_rad, q6)
        c6, s6 = np.cos(q6)[..., None], np.sin(q6)[..., None]
        x6, y6, z6, out = x6[:, None], y6[:, None], z6[:, None], out[:, :, None]
        x5, y5 = c6 * x6 - s6 * y6, s6 * x6 + c6 * y6
        x4 = np.cos(q5)[..., None] * x5 - np.sin(q5)[..., None] * z6
        q234 = np.arctan2(x4[..., 2], _dot(x4, out))[..., None]
        reach = p5[:, None] + g.d5 * y5 - np.array([0.0, 0.0, g.d1])
        q2, q3 = _two_links(g, _dot(reach, out)[..., None], reach[..., 2:], slack)
    q1, q5, q6 = q1[..., None, None], q5[..., None], q6[..., None]
    joints = np.stack(np.broadcast_arrays(q1, q2, q3, q234 - q2 - q3, q5, q6), axis=-1)
    return joints.reshape(len(rotation), 8, 6)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray((a * b).sum(axis=-1))


def _shoulder_angles(g: UrGeometry, p5: FloatArray, slack: float) -> FloatArray:
    """q1 (N, 2) that leaves the wrist d4 beside the arm's plane; nan if too close."""
    heading = np.arctan2(p5[..., 1], p5[..., 0])
    ratio = g.d4 / np.hypot(p5[..., 0], p5[..., 1])
    lean = np.arcsin(_within(ratio, slack))
    return np.concatenate([heading + lean, heading + np.pi - lean], axis=1)


def _two_links(
    g: UrGeometry, x: FloatArray, y: FloatArray, slack: float
) -> tuple[FloatArray, FloatArray]:
    """Shoulder lift and elbow (..., 2) that put the wrist at (x, y); nan out of reach."""
    cosine = (x * x + y * y - g.a2**2 - g.a3**2) / (2 * g.a2 * g.a3)
    q3 = _SIGN * np.arccos(_within(cosine, slack))
    q2 = np.arctan2(y, x) - np.arctan2(g.a3 * np.sin(q3), g.a2 + g.a3 * np.cos(q3))
    return q2, q3


def _within(ratio: FloatArray, slack: float) -> FloatArray:
    """Bring what lies just outside of -1 .. 1 inside; the rest stays, to become nan."""
    if slack:
        # Not to the very edge: two solutions meet there, and the search must part them.
        near = (np.abs(ratio) > 1) & (np.abs(ratio) < 1 + slack)
        return np.where(near, np.copysign(_EDGE, ratio), ratio)
    # Rounding must not lose a stretched arm.
    return np.where(np.abs(ratio) < 1 + 1e-12, np.clip(ratio, -1, 1), ratio)
