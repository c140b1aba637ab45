"""What planning asks of a kinematic model, and the names of those there are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

import numpy as np

from mvp.geometry import Pose

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray
    from mvp.kinematics.capsule import Capsules

JointUnit: TypeAlias = Literal["rad", "mm"]


class ArmModel(Protocol):
    """Kinematics of an arm: joints are rad for turning axes, mm for sliding ones."""

    @property
    def name(self) -> str:
        """As written in a cell file."""
        ...

    @property
    def joint_names(self) -> tuple[str, ...]:
        """One per axis, in the order of every joint array."""
        ...

    @property
    def joint_units(self) -> tuple[JointUnit, ...]:
        """Unit of each axis."""
        ...

    @property
    def dof(self) -> int:
        """Number of axes."""
        ...

    @property
    def joint_low(self) -> FloatArray:
        """(dof,) lowest value of each axis."""
        ...

    @property
    def joint_high(self) -> FloatArray:
        """(dof,) highest value of each axis."""
        ...

    @property
    def joint_speed(self) -> FloatArray:
        """(dof,) largest speed, unit per s."""
        ...

    @property
    def joint_acceleration(self) -> FloatArray:
        """(dof,) largest acceleration, unit per s^2."""
        ...

    @property
    def dictates_roll(self) -> bool:
        """True when a viewing direction leaves no free roll."""
        ...

    @property
    def margin_labels(self) -> tuple[str, ...]:
        """What each column of ``margins`` is about."""
        ...

    @property
    def margin_units(self) -> tuple[JointUnit, ...]:
        """Unit of each column of ``margins``."""
        ...

    @property
    def levers_mm(self) -> FloatArray:
        """(k + 1, dof) how far one unit of an axis can move a link; last row: flange.

        mm per rad or mm per mm; an upper bound over all configurations, of the points
        of the capsules' segments.
        """
        ...

    @property
    def self_pairs(self) -> tuple[tuple[str, str], ...]:
        """Links that can touch each other."""
        ...

    @property
    def tool_pairs(self) -> tuple[str, ...]:
        """Links that a body on the flange can touch."""
        ...

    @property
    def fixed_links(self) -> tuple[str, ...]:
        """Links that never move: never compared with obstacles."""
        ...

    def forward(self, joints: FloatArray) -> Pose:
        """``base_from_tool`` of one configuration (dof,)."""
        ...

    def forward_batch(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotations (M, 3, 3) and flange points (M, 3), mm, of M configurations."""
        ...

    def inverse_batch(
        self,
        rotation: FloatArray,
        translation_mm: FloatArray,
        *,
        near: FloatArray | None = None,
    ) -> tuple[FloatArray, BoolArray]:
        """All B branches of N poses: joints (N, B, dof) and which exist (N, B)."""
        ...

    def margins(self, joints: FloatArray) -> FloatArray:
        """Slack (M, r) of M configurations to the joint limits and the end of reach."""
        ...

    def links_batch(self, joints: FloatArray) -> Capsules:
        """The links of M configurations (M, dof), base frame."""
        ...

    def camera_rotations(
        self,
        direction_base: FloatArray,
        camera_rotations: FloatArray,
        tool_from_camera: FloatArray,
    ) -> FloatArray:
        """Attainable base_from_camera rotations (N, M', 3, 3) for N viewing directions.

        Args:
            direction_base: (N, 3) unit viewing directions.
            camera_rotations: (N, M, 3, 3) the rolls asked for.
            tool_from_camera: (3, 3) rotation of the hand-eye calibration.

        An arm with a free wrist returns what was asked for; one that dictates the
        roll returns the rolls that it can give.
        """
        ...


def forward_one(model: ArmModel, joints: FloatArray) -> Pose:
    """``ArmModel.forward`` by way of the batch."""
    rotation, point = model.forward_batch(np.asarray(joints, np.float64)[None])
    return Pose("base", "tool", rotation[0], point[0])


def inverse(
    model: ArmModel, base_from_tool: Pose, *, near: FloatArray | None = None
) -> tuple[FloatArray, ...]:
    """Every branch (dof,) within the joint limits, on the turn next to ``near``."""
    joints, exists = model.inverse_batch(
        base_from_tool.rotation[None], base_from_tool.translation_mm[None], near=near
    )
    return tuple(joints[0][exists[0]])


def on_nearest_turn(
    joints: FloatArray, near: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Add whole turns to angles (..., n): next to ``near``, but inside the limits."""
    turn = 2 * np.pi
    placed = joints + turn * np.round((near - joints) / turn)
    placed = placed - turn * np.ceil(np.maximum(placed - high, 0) / turn)
    return np.asarray(placed + turn * np.ceil(np.maximum(low - placed, 0) / turn))


def inside_limits(
    joints: FloatArray, low: FloatArray, high: FloatArray, *, slack: float = 1e-9
) -> BoolArray:
    """Which configurations (..., n) respect every limit (nan never does)."""
    return np.asarray(((joints >= low - slack) & (joints <= high + slack)).all(axis=-1))


def jacobian(model: ArmModel, joints: FloatArray, *, step: float = 1e-6) -> FloatArray:
    """Geometric Jacobian (6, dof) at one configuration by central differences.

    Rows: velocity of the flange (mm), then turning rate (rad), base axes, per unit of
    each axis.
    """
    q = np.asarray(joints, dtype=np.float64)
    shifts = step * np.eye(model.dof)
    rotation, point = model.forward_batch(np.concatenate([q + shifts, q - shifts]))
    n = model.dof
    spin = (rotation[:n] - rotation[n:]) / (2 * step) @ model.forward(q).rotation.T
    turning = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    return np.concatenate([(point[:n] - point[n:]) / (2 * step), turning], axis=1).T


def singularity_margin(
    model: ArmModel, joints: FloatArray, *, length_mm: float = 500.0
) -> float:
    """Smallest singular value of the Jacobian with lengths over ``length_mm``.

    Zero means that some small motion of the flange needs infinitely fast axes. Arms
    with fewer than six axes are judged on the motions that they have.
    """
    scaled = jacobian(model, joints)
    scaled[:3] /= length_mm
    sliding = [k for k, unit in enumerate(model.joint_units) if unit == "mm"]
    scaled[:, sliding] *= length_mm
    return float(np.linalg.svd(scaled, compute_uv=False)[model.dof - 1])
