"""Jog the arm: along the axes of a frame or joint by joint, checked as in a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.errors import InfeasibleError, LimitError, UsageError
from mvp.geometry import Pose
from mvp.kinematics import inverse, segment_clearance

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mvp.cell.engine import CellDevices
    from mvp.cell.jog_words import FrameName, Joint, Shift
    from mvp.cell.plan_job import Setting
    from mvp.cell.standstill import UnderWay
    from mvp.geometry import FloatArray

_ARM_SPARE_S = 15.0
_LONGEST_MM, _LONGEST_DEG = 100.0, 30.0


@dataclass(frozen=True, eq=False)
class JogArm:
    """Moves one arm.

    Attributes:
        setting: the cell, with the bodies that must not be touched.
        devices: opened.
        under_way: told what is being moved.
        speed: share of full speed.
    """

    setting: Setting
    devices: CellDevices
    under_way: UnderWay
    speed: float

    def shift(
        self, command: Shift, frame: FrameName, tool_from_camera: Callable[[], Pose]
    ) -> str:
        """Along or about an axis of a frame; says what was reached.

        Raises:
            LimitError, InfeasibleError, UsageError: refused; nothing has moved.
            DeviceError: it failed, or was stopped.
        """
        _refuse_far(command.amount, turns=command.turns)
        state = self.devices.arm.state()
        tool = Pose.from_matrix("base", "tool", np.asarray(state.base_from_tool))
        wanted = _moved(tool, command, frame, tool_from_camera)
        here = np.asarray(state.joints, np.float64)
        branches = inverse(self.setting.cell.arm, wanted, near=here)
        if not branches:
            raise InfeasibleError(
                "the arm cannot take that pose; nothing has moved",
                hint="a gantry cannot turn about its view axis; else go another way, "
                "or by single joints",
                where="arm",
            )
        return self._go(min(branches, key=lambda q: float(np.abs(q - here).max())))

    def joint(self, command: Joint) -> str:
        """One joint; says what was reached, and raises, as ``shift``."""
        model = self.setting.cell.arm
        if command.index >= model.dof:
            raise UsageError(f"{model.name} has {model.dof} joints")
        turns = model.joint_units[command.index] == "rad"
        _refuse_far(command.amount, turns=turns)
        target = np.asarray(self.devices.arm.state().joints, np.float64).copy()
        target[command.index] += np.radians(command.amount) if turns else command.amount
        return self._go(target)

    def words(self, joints: Sequence[float]) -> str:
        """Joints with their units, deg or mm."""
        return ", ".join(
            f"{np.degrees(j):z.2f} deg" if unit == "rad" else f"{j:z.2f} mm"
            for j, unit in zip(joints, self.setting.cell.arm.joint_units, strict=True)
        )

    def _go(self, target: FloatArray) -> str:
        """Check as a run would, then move straight there."""
        arm = self.devices.arm
        here = np.asarray(arm.state().joints, np.float64)
        self._check_margin(here, target)
        arm.check_joints(target.tolist())
        required = self.setting.arm.clearance_mm
        found = segment_clearance(
            self.setting.arm.bodies, here, target, required_mm=required
        )
        if found.certified_mm < required:
            raise LimitError(
                f"{found.nearest.body} would come within {found.certified_mm:.1f} mm of "
                f"{found.nearest.other}; {required:g} mm are asked",
                device="arm",
                hint="go another way; nothing has moved",
            )
        expected_s = arm.duration_s(
            here.tolist(), target.tolist(), speed_fraction=self.speed
        )
        timeout_s = 2 * expected_s + _ARM_SPARE_S
        with self.under_way.moving("the arm", timeout_s):
            reached = arm.move_joints(
                target.tolist(), speed_fraction=self.speed, timeout_s=timeout_s
            )
        return self.words(reached.joints)

    def _check_margin(self, here: FloatArray, target: FloatArray) -> None:
        """The margin of a run; going back into it from outside is allowed."""
        model, margin = self.setting.cell.arm, self.setting.cell.joint_margin
        low, high = model.joint_low + margin, model.joint_high - margin
        beyond = np.maximum(low - target, target - high)
        before = np.maximum(low - here, here - high)
        worse = (beyond > 0) & (beyond > before)
        if worse.any():
            raise LimitError(
                f"{model.joint_names[int(np.argmax(worse))]} would come too close to its "
                "limit; nothing has moved",
                device="arm",
                hint="[kinematics] joint_margin_deg says how close it may come",
            )


def _moved(
    tool: Pose,
    command: Shift,
    frame: FrameName,
    tool_from_camera: Callable[[], Pose],
) -> Pose:
    """The tool's new pose; turns are about the origin of the chosen frame."""
    step = np.zeros(3)
    step[command.axis] = command.amount
    if frame == "base":
        turn = Pose.from_rotvec("base", "base", np.zeros(3), step)
        if command.turns:
            about = tool.translation_mm
            turned = Pose.from_rotvec("base", "base", np.radians(step), np.zeros(3))
            shift = about - turned.apply(about)
            turn = Pose.from_rotvec("base", "base", np.radians(step), shift)
        return turn @ tool
    angle, way = (
        (np.radians(step), np.zeros(3)) if command.turns else (np.zeros(3), step)
    )
    if frame == "tool":
        return tool @ Pose.from_rotvec("tool", "tool", angle, way)
    hand = tool_from_camera()
    moved = Pose.from_rotvec("camera", "camera", angle, way)
    return tool @ hand @ moved @ hand.inverse()


def _refuse_far(amount: float, *, turns: bool) -> None:
    """A slip of the finger must not send the arm across the cell."""
    most, unit = (_LONGEST_DEG, "deg") if turns else (_LONGEST_MM, "mm")
    if abs(amount) > most:
        raise UsageError(
            f"{amount:g} {unit} is more than one jog may move ({most:g} {unit})",
            hint="go in several steps",
        )
