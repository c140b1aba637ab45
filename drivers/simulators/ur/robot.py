"""The controller: one arm, its safety, its registers and the program it runs."""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from drivers.simulators.ur.kinematics import Kinematics
from drivers.simulators.ur.mechanism import Mechanism
from drivers.simulators.ur.motion import brake, tool_brake
from drivers.simulators.ur.profiles import PROFILES
from drivers.simulators.ur.program import (
    ControlProgram,
    ForeignProgram,
    Runnable,
    TextProgram,
)
from drivers.simulators.ur.registers import Ownership, Registers
from drivers.simulators.ur.safety import OnStop, Safety

if TYPE_CHECKING:
    from drivers.simulators.ur.script import Program

_LOG = logging.getLogger(__name__)
_BOOTED_S = 1000.0
_LOGGED = 200
HOME = (0.0, -1.57, 1.57, -1.57, -1.57, 0.0)


class RuntimeState(IntEnum):
    """``runtime_state``."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


@dataclass(frozen=True)
class RobotSettings:
    """What one simulated robot is.

    Attributes:
        model: ur3e to ur30.
        profile: key of ``PROFILES``.
        joints_rad: (6,) where it stands at first.
        speed_scale: moves take this many times less time.
        serial: digits.
        on_protective_stop: pause or stop the program.
        unlock_delay_s: a protective stop stays locked so long.
        script_start_s: from the upload to the running program.
        remote: remote control, where the controller has it.
    """

    model: str = "ur5e"
    profile: str = "e5.12"
    joints_rad: tuple[float, ...] = HOME
    speed_scale: float = 1.0
    serial: str = "20225500123"
    on_protective_stop: OnStop = "pause"
    unlock_delay_s: float = 5.0
    script_start_s: float = 0.05
    remote: bool = True


class Robot:
    """Everything behind the sockets, advanced cycle by cycle, without any I/O."""

    def __init__(self, settings: RobotSettings) -> None:
        self.settings = settings
        self.profile = PROFILES[settings.profile]
        self.kin = Kinematics(settings.model)
        self.arm = Mechanism(
            np.array(settings.joints_rad), speed_scale=settings.speed_scale
        )
        self.registers = Registers()
        self.owners = Ownership()
        self.safety = Safety(
            self,
            on_protective_stop=settings.on_protective_stop,
            unlock_delay_s=settings.unlock_delay_s,
        )
        self.cycle = 0
        self.frozen_s: float | None = None
        self.tcp: tuple[float, ...] = (0.0,) * 6
        self.payload_kg = 0.0
        self.payload_centre_m: tuple[float, ...] = (0.0,) * 3
        self.payload_inertia: tuple[float, ...] = (0.0,) * 6
        self.freedrive = 0
        self.remote = settings.remote
        self.serial = settings.serial
        self.model = settings.model
        self.loaded = ""
        self.rejects_scripts = False
        self.scripts = 0
        self.commands: deque[dict[str, object]] = deque(maxlen=_LOGGED)
        self.endings: deque[str] = deque(maxlen=_LOGGED)
        self.state = RuntimeState.STOPPED
        self.program: Runnable | None = None
        self._upload: Program | None = None
        self._upload_at_s = 0.0

    @property
    def cycle_s(self) -> float:
        """Length of a control cycle."""
        return 1.0 / self.profile.base_hz

    @property
    def now_s(self) -> float:
        """The controller's own time."""
        return _BOOTED_S + self.cycle * self.cycle_s

    @property
    def timestamp_s(self) -> float:
        """What clients see of the time."""
        return self.now_s if self.frozen_s is None else self.frozen_s

    @property
    def paused(self) -> bool:
        """Whether a program waits to be resumed."""
        return self.state == RuntimeState.PAUSED

    @property
    def is_program_running(self) -> bool:
        """Bit 1 of ``robot_status_bits``: also while the program is paused."""
        return self.state not in (RuntimeState.STOPPED, RuntimeState.STOPPING)

    @property
    def status_bits(self) -> int:
        """``robot_status_bits``."""
        return int(self.safety.power > 3) | int(self.is_program_running) << 1

    def tick(self) -> None:
        """One control cycle."""
        self.cycle += 1
        self.safety.tick()
        if self._upload is not None and self.now_s >= self._upload_at_s:
            self._start(self._upload)
        if self.state == RuntimeState.PLAYING and self.program is not None:
            self._step(self.program)
        self.arm.slider = self.registers.slider
        self.arm.tick(self.cycle_s)
        if self.arm.streaming and not self.kin.reachable(self.arm.joints):
            self.safety.protective_stop()

    def upload(self, program: Program) -> None:
        """Take a program from a script port: it replaces the running one."""
        self.scripts += 1
        local = self.profile.has_remote_mode and not self.remote
        if self.rejects_scripts or local or not self.safety.may_run:
            _LOG.info("program %r ignored", program.name)
            return
        self.end_program("replaced by an upload")
        self._upload = program
        self._upload_at_s = self.now_s + self.settings.script_start_s

    def play_foreign(self, name: str) -> bool:
        """Run a program that did not come over a script port."""
        if not self.safety.may_run:
            return False
        self.end_program("replaced by a program of the pendant")
        self._run(ForeignProgram(name))
        return True

    def end_program(self, why: str) -> None:
        """Stop the running program and what it moves."""
        self._upload = None
        if self.program is not None:
            self.endings.append(why)
            _LOG.info("program %s ended: %s", self.program.name, why)
            self.program = None
        self.state = RuntimeState.STOPPED
        if self.safety.may_run and not self.arm.idle:
            self.arm.held = False
            self.arm.halt()

    def pause(self) -> None:
        """Hold the program and the move."""
        if self.state == RuntimeState.PLAYING:
            self.state = RuntimeState.PAUSED
        self.arm.held = True

    def resume(self) -> bool:
        """Go on where ``pause`` stopped; False without a paused program."""
        self.arm.held = False
        if not self.paused or not self.safety.may_run:
            return False
        self.state = RuntimeState.PLAYING
        return True

    def stop_motion(self, deceleration: float, *, linear: bool) -> None:
        """``stopj`` (rad/s^2) or ``stopl`` (m/s^2).

        Raises:
            ScriptError: a deceleration that is not above zero.
        """
        arm = self.arm
        scaled = arm.scaled_deceleration(deceleration)
        if linear:
            stop = tool_brake(self.kin, arm.joints, arm.rate, self.tcp, scaled)
        else:
            stop = brake(arm.joints, arm.rate, scaled)
        arm.halt(stop)

    def log_command(self, command: int, values: list[float], flag: int) -> None:
        """Remember what a client asked for."""
        self.commands.append(
            {"t_s": self.now_s, "command": command, "values": values, "flag": flag}
        )

    def _start(self, upload: Program) -> None:
        self._upload = None
        if upload.is_control:
            self._run(ControlProgram(self, upload))
        else:
            self._run(TextProgram(self, upload))

    def _run(self, program: Runnable) -> None:
        self.program = program
        self.state = RuntimeState.PLAYING
        self.arm.held = False

    def _step(self, program: Runnable) -> None:
        try:
            if not program.step():
                self.end_program("it came to its end")
        except (ValueError, LookupError, ArithmeticError) as error:
            self.end_program(f"run-time error: {error}")
