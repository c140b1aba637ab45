"""Move arm and lens by hand, inside the same limits as a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from mvp.cell.homing import HOMING_S, home_arm, homing_of, is_homed
from mvp.cell.jog_words import (
    HELP,
    Expose,
    FrameName,
    JogCommand,
    Joint,
    Optical,
    Plain,
    Shift,
    Shot,
    Steps,
    UseFrame,
)
from mvp.cell.standstill import UnderWay
from mvp.errors import InfeasibleError, LimitError, UsageError
from mvp.fileedge import FileModel
from mvp.geometry import Pose
from mvp.kinematics import MountedCamera, inverse, segment_clearance
from mvp.optics import LensTable

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from mvp.cell.engine import CellDevices
    from mvp.cell.plan_job import Setting
    from mvp.devices import Frame, Homing
    from mvp.geometry import FloatArray
    from mvp.optics import LensSetting

JOG_SCHEMA: Literal["mvp-cell/jog/1"] = "mvp-cell/jog/1"
_ARM_SPARE_S = 15.0
_LENS_S = 120.0
_CAPTURE_SPARE_S = 10.0
_LONGEST_MM, _LONGEST_DEG = 100.0, 30.0


class JogDocument(FileModel):
    """Where arm and lens stand at the end of jogging.

    f, d and a are null where the motors stand outside of the lens table, as after
    homing; the camera's pose is that of the hand-eye's own lens setting then.
    """

    schema_: Literal["mvp-cell/jog/1"] = Field(default=JOG_SCHEMA, alias="schema")
    cell: str
    joints: list[float]
    base_from_tool: list[list[float]]
    base_from_camera: list[list[float]]
    lens_steps: dict[str, int]
    f_mm: float | None
    d_mm: float | None
    a_mm: float | None


@dataclass(eq=False)
class Jogger:
    """Carries out one command after the other.

    Attributes:
        setting: the cell, with the bodies that must not be touched.
        devices: opened.
        save: writes a picture into a file.
        show: shows a picture to the person.
        speed: share of full speed.
        frame: whose axes a shift is in.
        exposure_s: of the next picture.
        homing_told: what a person knows that homing would do.
        under_way: what is being moved.
    """

    setting: Setting
    devices: CellDevices
    save: Callable[[Path, Frame], None]
    show: Callable[[Frame], None]
    speed: float
    frame: FrameName = "base"
    exposure_s: float = 0.01
    homing_told: Homing | None = None
    under_way: UnderWay = field(default_factory=UnderWay)

    def do(self, command: JogCommand) -> str:
        """Carry out one command; says what was reached.

        Raises:
            LimitError, InfeasibleError: refused; nothing has moved.
            DeviceError: a device failed, or was stopped.
            UsageError: it needs something else first.
        """
        match command:
            case Shift():
                return self._shift(command)
            case Joint():
                return self._joint(command)
            case Steps():
                return self._steps(command)
            case Optical():
                return self._optical(command)
            case UseFrame():
                self.frame = command.frame
                return f"in the axes of the {command.frame} frame"
            case Expose():
                return self._expose(command.seconds)
            case Shot():
                return self._shot(command)
            case Plain():
                return self._plain(command)

    def document(self) -> JogDocument:
        """Where everything stands."""
        arm, lens = self.devices.arm.state(), self.devices.lens.state()
        setting = self._setting(lens.steps())
        tool = Pose.from_matrix("base", "tool", np.asarray(arm.base_from_tool))
        return JogDocument(
            cell=self.setting.cell.config.name,
            joints=[float(j) for j in arm.joints],
            base_from_tool=tool.matrix.tolist(),
            base_from_camera=(tool @ self._tool_from_camera()).matrix.tolist(),
            lens_steps=lens.steps(),
            f_mm=setting.f_mm if setting else None,
            d_mm=setting.d_mm if setting else None,
            a_mm=setting.a_mm if setting else None,
        )

    # ------------------------------------------------------------ arm

    def _shift(self, command: Shift) -> str:
        self._refuse_far(command.amount, turns=command.turns)
        state = self.devices.arm.state()
        tool = Pose.from_matrix("base", "tool", np.asarray(state.base_from_tool))
        wanted = self._moved(tool, command)
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

    def _moved(self, tool: Pose, command: Shift) -> Pose:
        """The tool's new pose; turns are about the origin of the chosen frame."""
        step = np.zeros(3)
        step[command.axis] = command.amount
        if self.frame == "base":
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
        if self.frame == "tool":
            return tool @ Pose.from_rotvec("tool", "tool", angle, way)
        hand = self._tool_from_camera()
        moved = Pose.from_rotvec("camera", "camera", angle, way)
        return tool @ hand @ moved @ hand.inverse()

    def _joint(self, command: Joint) -> str:
        model = self.setting.cell.arm
        if command.index >= model.dof:
            raise UsageError(f"{model.name} has {model.dof} joints")
        turns = model.joint_units[command.index] == "rad"
        self._refuse_far(command.amount, turns=turns)
        target = np.asarray(self.devices.arm.state().joints, np.float64).copy()
        target[command.index] += np.radians(command.amount) if turns else command.amount
        return self._go(target)

    def _go(self, target: FloatArray) -> str:
        """Check as a run would, then move straight there."""
        arm, cell = self.devices.arm, self.setting.cell
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
        return _joints_text(reached.joints, cell.arm.joint_units)

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

    def _refuse_far(self, amount: float, *, turns: bool) -> None:
        """A slip of the finger must not send the arm across the cell."""
        most, unit = (_LONGEST_DEG, "deg") if turns else (_LONGEST_MM, "mm")
        if abs(amount) > most:
            raise UsageError(
                f"{amount:g} {unit} is more than one jog may move ({most:g} {unit})",
                hint="go in several steps",
            )

    # ------------------------------------------------------------ lens

    @property
    def _table(self) -> LensTable:
        cell = self.setting.cell
        return LensTable.from_calibration(
            cell.calibrations.lens_table, tube_mm=cell.config.optics.mounted_tube_mm
        )

    def _tool_from_camera(self) -> Pose:
        found = self.setting.cell.calibrations
        setting = self._setting(self.devices.lens.state().steps())
        if setting is None:
            return found.tool_from_camera
        mounted = MountedCamera.of(found.camera, found.lens_table, found.hand_eye)
        return mounted.tool_from_camera_at(setting)

    def _steps(self, command: Steps) -> str:
        target = self._homed_steps()
        before = target[command.axis] if command.relative else 0
        target[command.axis] = before + command.steps
        return self._set(target)

    def _optical(self, command: Optical) -> str:
        target = self._homed_steps()
        now = self._setting(target)
        if now is None:
            raise UsageError(
                "the lens stands outside of its table, where it has no f, d and a",
                hint="give steps first: zoom, focus and iris",
            )
        wanted = {"f": now.f_mm, "d": now.d_mm, "a": now.a_mm}
        wanted[command.quantity] = command.value_mm
        try:
            steps = self._table.steps(wanted["f"], wanted["d"], wanted["a"])
        except ValueError as error:
            raise LimitError(
                str(error), device="lens", hint="nothing has moved"
            ) from error
        return self._set({"zoom": steps.zoom, "focus": steps.focus, "iris": steps.iris})

    def _homed_steps(self) -> dict[str, int]:
        state = self.devices.lens.state()
        if not state.homed:
            raise UsageError("the lens is not homed", hint="say home first")
        return state.steps()

    def _set(self, target: dict[str, int]) -> str:
        with self.under_way.moving("the lens", _LENS_S):
            state = self.devices.lens.move_steps(**target, timeout_s=_LENS_S)
        return self._lens_text(state.steps())

    def _lens_text(self, steps: dict[str, int]) -> str:
        at = self._setting(steps)
        optical = (
            f"f {at.f_mm:.3f}, d {at.d_mm:.3f}, a {at.a_mm:.3f} mm"
            if at
            else "outside of the lens table"
        )
        motors = ", ".join(f"{axis} {step}" for axis, step in steps.items())
        return f"{motors} steps; {optical}"

    def _setting(self, steps: dict[str, int]) -> LensSetting | None:
        """f, d and a at these steps; None outside of the table."""
        table = self._table
        inside = all(
            low <= steps[motor.name] <= high
            for motor in (table.zoom, table.focus, table.iris)
            for low, high in [motor.range_steps]
        )
        return table.setting(**steps) if inside else None

    # ------------------------------------------------------------ pictures

    def _expose(self, seconds: float) -> str:
        low, high = self.devices.camera.exposure_range_s()
        if not low <= seconds <= high:
            raise UsageError(
                f"the camera exposes {low * 1e3:g} to {high * 1e3:g} ms, not "
                f"{seconds * 1e3:g} ms"
            )
        self.exposure_s = seconds
        return f"exposure {seconds * 1e3:g} ms"

    def _capture(self) -> Frame:
        camera = self.devices.camera
        low, high = camera.exposure_range_s()
        camera.configure(exposure_s=min(max(self.exposure_s, low), high))
        return camera.capture(
            not_before_s=self.devices.clock.now_s(),
            timeout_s=4 * self.exposure_s + _CAPTURE_SPARE_S,
        )

    def _shot(self, command: Shot) -> str:
        from pathlib import Path

        frame = self._capture()
        self.save(Path(command.file), frame)
        return f"{command.file}: {_frame_text(frame)}"

    # ------------------------------------------------------------ words

    def _plain(self, command: Plain) -> str:
        match command.word:
            case "where":
                return self._where()
            case "home":
                return self._home()
            case "see":
                frame = self._capture()
                self.show(frame)
                return _frame_text(frame)
            case "help":
                return HELP
            case "quit":
                return ""

    def _home(self) -> str:
        """References, and back to the marks where that way is clear."""
        homing = homing_of(self.devices.arm)
        simulated = "arm" in self.devices.simulated_roles
        if homing is not None and homing != self.homing_told and not simulated:
            self.homing_told = homing
            raise UsageError(homing.words, hint="say home again where that is so")
        arm = self.setting.arm
        with self.under_way.moving("the arm, homing", HOMING_S):
            home_arm(self.devices, arm.bodies, arm.clearance_mm)
        with self.under_way.moving("the lens, homing", _LENS_S):
            state = self.devices.lens.home(timeout_s=_LENS_S)
        return self._lens_text(state.steps())

    def _where(self) -> str:
        here = self.document()
        units = self.setting.cell.arm.joint_units
        camera = np.array(here.base_from_camera)
        eye, view = camera[:3, 3], camera[:3, 2]
        homed = "" if self.devices.lens.state().homed else " (not homed)"
        known = "" if is_homed(self.devices.arm) else " (not homed: only a count)"
        return (
            f"joints {_joints_text(here.joints, units)}{known}\n"
            f"camera at ({eye[0]:.1f}, {eye[1]:.1f}, {eye[2]:.1f}) mm, looks along "
            f"({view[0]:.3f}, {view[1]:.3f}, {view[2]:.3f}), base frame\n"
            f"lens {self._lens_text(here.lens_steps)}{homed}"
        )


def _joints_text(
    joints: list[float] | tuple[float, ...], units: tuple[str, ...]
) -> str:
    return ", ".join(
        f"{np.degrees(j):z.2f} deg" if unit == "rad" else f"{j:z.2f} mm"
        for j, unit in zip(joints, units, strict=True)
    )


def _frame_text(frame: Frame) -> str:
    rows, columns = frame.pixels.shape
    saturated = float((frame.pixels >= frame.full_scale).mean())
    return (
        f"{columns} x {rows} px, exposed {frame.exposure_s * 1e3:g} ms, mean "
        f"{frame.pixels.mean() / frame.full_scale:.0%}, saturated {saturated:.1%}"
    )
