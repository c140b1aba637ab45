"""Move arm and lens by hand, inside the same limits as a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from mvp.cell.homing import HOMING_S, home_arm, homing_of, is_homed
from mvp.cell.jog_arm import JogArm
from mvp.cell.jog_camera import JogCamera, frame_words
from mvp.cell.jog_lens import JogLens
from mvp.cell.jog_words import (
    HELP,
    Expose,
    FrameName,
    JogCommand,
    Joint,
    Live,
    LiveOff,
    Optical,
    Plain,
    Shift,
    Shot,
    Steps,
    UseFrame,
)
from mvp.cell.live_picture import LivePicture
from mvp.cell.standstill import UnderWay
from mvp.errors import UsageError
from mvp.fileedge import FileModel
from mvp.geometry import Pose

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.engine import CellDevices
    from mvp.cell.plan_job import Setting
    from mvp.devices import ArmState, Frame, Homing

JOG_SCHEMA: Literal["mvp-cell/jog/1"] = "mvp-cell/jog/1"


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
        save: writes a picture into a file, whole or not at all; from any thread.
        show: shows a picture to the person.
        speed: share of full speed.
        frame: whose axes a shift is in.
        homing_told: what a person knows that homing would do.
        under_way: what is being moved.
        live: pictures one after the other; to be ended before the devices are closed.
    """

    setting: Setting
    devices: CellDevices
    save: Callable[[Path, Frame], None]
    show: Callable[[Frame], None]
    speed: float
    frame: FrameName = "base"
    homing_told: Homing | None = None
    under_way: UnderWay = field(default_factory=UnderWay)
    live: LivePicture = field(init=False)

    def __post_init__(self) -> None:
        self._arm = JogArm(self.setting, self.devices, self.under_way, self.speed)
        self._lens = JogLens(self.setting, self.devices, self.under_way)
        self._camera = JogCamera(self.devices)
        self.live = LivePicture(
            self._camera.picture, self.save, self._where, self._camera.stop
        )

    def do(self, command: JogCommand) -> str:
        """Carry out one command; says what was reached.

        Raises:
            LimitError, InfeasibleError: refused; nothing has moved.
            DeviceError: a device failed, or was stopped.
            OutputError: a picture cannot be kept.
            UsageError: it needs something else first.
        """
        match command:
            case Shift():
                return self._arm.shift(command, self.frame, self._lens.tool_from_camera)
            case Joint():
                return self._arm.joint(command)
            case Steps():
                return self._lens.steps(command)
            case Optical():
                return self._lens.optical(command)
            case UseFrame():
                self.frame = command.frame
                return f"in the axes of the {command.frame} frame"
            case Expose():
                return self._camera.expose(command.seconds)
            case Shot():
                return self._shot(command)
            case Live():
                return self._live(command)
            case LiveOff():
                return "the live picture is off" if self.live.end() else "it was off"
            case Plain():
                return self._plain(command)

    def following(self) -> Callable[[], str]:
        """What says during one command where that which is being moved is by now.

        For another thread than that of ``do``; says nothing while nothing moves, and
        raises ``DeviceError`` where it cannot be asked. Each has a lens setting of its
        own: one that is late changes nothing for the next command.
        """
        return partial(self._position, cache(self._lens.tool_from_camera))

    def _position(self, hand: Callable[[], Pose]) -> str:
        moving = self.under_way.text
        if moving.startswith("the arm"):
            # The lens stands meanwhile: it is asked once.
            return self._arm_words(self.devices.arm.state(), hand())
        if moving.startswith("the lens"):
            return f"lens {self._lens.words(self.devices.lens.state().steps())}"
        return ""

    def document(self) -> JogDocument:
        """Where everything stands."""
        arm, lens = self.devices.arm.state(), self.devices.lens.state()
        setting = self._lens.at(lens.steps())
        tool = Pose.from_matrix("base", "tool", np.asarray(arm.base_from_tool))
        hand = self._lens.tool_from_camera()
        return JogDocument(
            cell=self.setting.cell.config.name,
            joints=[float(j) for j in arm.joints],
            base_from_tool=tool.matrix.tolist(),
            base_from_camera=(tool @ hand).matrix.tolist(),
            lens_steps=lens.steps(),
            f_mm=setting.f_mm if setting else None,
            d_mm=setting.d_mm if setting else None,
            a_mm=setting.a_mm if setting else None,
        )

    def _plain(self, command: Plain) -> str:
        match command.word:
            case "where":
                return self._where()
            case "home":
                return self._home()
            case "see":
                frame = self._camera.picture()
                self.show(frame)
                return frame_words(frame)
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
        return self._lens.home()

    def _shot(self, command: Shot) -> str:
        frame = self._camera.picture()
        self.save(Path(command.file), frame)
        return f"{command.file}: {frame_words(frame)}"

    def _live(self, command: Live) -> str:
        if not command.file:
            raise UsageError(
                "there is no terminal to show a live picture on",
                hint="let it be kept in a file: live picture.png",
            )
        frame = self.live.to_file(Path(command.file))
        return f"{command.file}: {frame_words(frame)}, live until live off"

    def _where(self) -> str:
        arm, lens = self.devices.arm.state(), self.devices.lens.state()
        homed = "" if lens.homed else " (not homed)"
        return (
            f"{self._arm_words(arm, self._lens.tool_from_camera())}\n"
            f"lens {self._lens.words(lens.steps())}{homed}"
        )

    def _arm_words(self, arm: ArmState, tool_from_camera: Pose) -> str:
        tool = Pose.from_matrix("base", "tool", np.asarray(arm.base_from_tool))
        camera = (tool @ tool_from_camera).matrix
        eye, view = camera[:3, 3], camera[:3, 2]
        known = "" if is_homed(self.devices.arm) else " (not homed: only a count)"
        return (
            f"joints {self._arm.words(arm.joints)}{known}\n"
            f"camera at ({eye[0]:.1f}, {eye[1]:.1f}, {eye[2]:.1f}) mm, looks along "
            f"({view[0]:.3f}, {view[1]:.3f}, {view[2]:.3f}), base frame"
        )
