"""Theia MCR 400/500/600: zoom, focus and iris, driven by a board that keeps no position.

The host counts steps from the last homing, so every position is an estimate. The board
hears nothing while a motor turns: a motion cannot be stopped half-way over USB. ``stop``
ends a move after the motion that is under way; nothing more is sent, and
``info().extra["can_stop"]`` says so. A move that cannot end in time is refused before it
begins.
"""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING, ClassVar

from drivers._lens import Deadline, LensAxes, Pace, Steps, state_of
from drivers._motor_lens import MotorLens
from drivers._theia import (
    Setup,
    TheiaConfig,
    TheiaMotor,
    TheiaWire,
    end_frame,
    shift_frame,
    to_switch_frame,
)
from mvp.devices import Axis, DeviceContext, DeviceInfo, LensState, Role
from mvp.errors import DeviceError, DeviceFault, DeviceTimeout

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.devices import Session

_LOG = logging.getLogger(__name__)
_SLOWER = 1.3  # a motion may take so much longer than its steps at their speed
_SPARE_S = 0.5
_CLEAR_STEPS = 200  # away from the barrier, for certain
_HOME_ORDER: tuple[Axis, Axis, Axis] = ("zoom", "focus", "iris")


class TheiaLens:
    """The motors of an MCR board; ``from_config`` hands out the lens over them."""

    role: ClassVar[Role] = "lens"
    Config = TheiaConfig

    product: ClassVar[str] = "the Theia MCR"

    def __init__(
        self, config: TheiaConfig, context: DeviceContext, name: str, pace: Pace
    ) -> None:
        self.name = name
        self._config = config
        self._motors = config.motors()
        ends = {
            axis: (0, motor.switch or motor.steps)
            for axis, motor in self._motors.items()
        }
        self.axes = LensAxes(config, context.folder, name, ends=ends)
        self._wire = TheiaWire(
            config,
            context,
            name,
            on_lost=lambda error: self.forget_home(),
            on_late=self._on_late,
        )
        self._pace = pace
        self._lock = threading.Lock()
        self._identity = ("", "")
        self._counted: Steps = {"zoom": 0, "focus": 0, "iris": 0}
        self._homed = False
        self._turning = False

    @classmethod
    def from_config(
        cls, config: TheiaConfig, context: DeviceContext, *, name: str
    ) -> MotorLens:
        """Build the device; no I/O."""
        return MotorLens(
            name, context.clock, lambda pace: cls(config, context, name, pace)
        )

    @property
    def session(self) -> Session:
        """The conversation with the board."""
        return self._wire.session

    def connect(self) -> None:
        """Open the session and learn who answers. Moves nothing."""
        self._identity = self._wire.open()
        # It answers, and it would not while a motor turns.
        self._on_late()

    def info(self) -> DeviceInfo:
        """Identity and versions."""
        firmware, serial = self._identity
        return DeviceInfo(
            self.name,
            "theia-mcr",
            "Theia MCR",
            serial,
            firmware,
            simulated=False,
            extra={
                "address": self._wire.session.address,
                "can_stop": "no: a motion under way goes on to its end",
            },
        )

    def state(self) -> LensState:
        """Where the motors are by the host's count; asks the board nothing."""
        with self._lock:
            return state_of(
                self._counted,
                homed=self._homed,
                standing=not self._turning,
                estimated=True,
            )

    def home(self, deadline: Deadline) -> None:
        """Find the barrier of zoom and focus, and close the iris.

        Raises:
            DeviceTimeout: an answer did not come in time, or could not.
        """
        self._require_time(sum(map(_home_s, self._motors.values())), deadline)
        self.forget_home()
        for axis in _HOME_ORDER:
            self._set_up(axis)
        for axis in _HOME_ORDER:
            self._home_axis(axis, deadline)
        self._pace.require_going()
        with self._lock:
            self._homed = True

    def move(self, legs: Sequence[Steps], targets: Steps, deadline: Deadline) -> None:
        """One axis after the other.

        Raises:
            DeviceTimeout: an answer did not come in time, or could not.
        """
        self._require_time(self._duration_s(legs), deadline)
        for leg in legs:
            for axis, target in leg.items():
                self._shift(axis, target, deadline)
        self._pace.require_going()

    def stop(self) -> None:
        """Nothing to send: the motion under way goes on to its end."""

    def forget_home(self) -> None:
        """Where the motors are is not known any more."""
        with self._lock:
            self._homed = False
        self.axes.disengage()

    def _on_late(self) -> None:
        """A motion has ended that was given up: nothing turns any more."""
        with self._lock:
            self._turning = False

    def _require_time(self, needed_s: float, deadline: Deadline) -> None:
        """Refuse before the first motion what could not be stopped when it is late."""
        if needed_s > deadline.left_s:
            raise DeviceTimeout(
                f"needs {needed_s:.1f} s and has {deadline.left_s:.1f} s, and cannot be "
                "stopped half-way; nothing has moved",
                device=self.name,
                hint="allow more time",
            )

    def _duration_s(self, legs: Sequence[Steps]) -> float:
        """Time of all motions at their speed."""
        at = dict(self._counted)
        total_s = 0.0
        for leg in legs:
            for axis, target in leg.items():
                total_s += abs(target - at[axis]) / self._motors[axis].speed
                total_s += self._config.rest_s
                at[axis] = target
        return total_s

    def _set_up(self, axis: Axis) -> None:
        """Compare what the board keeps of a motor; write only what differs."""
        wanted, kept = Setup.wanted(self._motors[axis]), self._wire.setup(axis)
        if wanted == kept:
            return
        if not self._config.write_setup:
            raise DeviceFault(
                f"keeps {kept} of {axis}, configured is {wanted}",
                device=self.name,
                code="setup",
                hint="correct [lens], or let it be written with write_setup = true",
            )
        _LOG.warning(
            "%s: set-up of %s was %s, is now %s", self.name, axis, kept, wanted
        )
        self._wire.write_setup(axis, wanted)

    def _home_axis(self, axis: Axis, deadline: Deadline) -> None:
        """To the reference; twice where there is a barrier.

        A motor that was switched on beyond its barrier sees it covered at once: only
        from the right side is the place where it switches known.
        """
        motor = self._motors[axis]
        _LOG.info("%s: homing %s", self.name, axis)
        if motor.switch is None:
            self._run(end_frame(axis, motor), motor.steps / motor.speed, deadline)
        else:
            seek_s = motor.steps / motor.speed
            self._run(to_switch_frame(axis, motor), seek_s, deadline)
            away = -_beyond_steps(motor)
            self._run(shift_frame(axis, away, motor), -away / motor.speed, deadline)
            self._run(to_switch_frame(axis, motor), seek_s, deadline)
        with self._lock:
            self._counted[axis] = motor.home_step

    def _shift(self, axis: Axis, target: int, deadline: Deadline) -> None:
        """Relative motion to a step, which is counted when it has ended."""
        motor = self._motors[axis]
        steps = target - self._counted[axis]
        if steps:
            expected_s = abs(steps) / motor.speed
            self._run(shift_frame(axis, steps, motor), expected_s, deadline)
        with self._lock:
            self._counted[axis] = target

    def _run(self, frame: bytes, expected_s: float, deadline: Deadline) -> None:
        """One motion to its end, unless a stop was asked for before it.

        Raises:
            DeviceTimeout: no answer; where the motor is, is unknown from now on.
        """
        self._pace.require_ready(self._wire.session)
        if expected_s > deadline.left_s:
            raise DeviceTimeout(
                "no time is left for the next motion; nothing more was sent",
                device=self.name,
                hint="allow more time",
            )
        allowed_s = min(_SLOWER * expected_s + _SPARE_S, deadline.left_s)
        with self._lock:
            self._turning = True
        try:
            self._wire.move(frame, timeout_s=allowed_s)
        except DeviceError as error:
            self.forget_home()
            if isinstance(error, DeviceTimeout):
                error.hint = f"a motor may still turn; then home it. {error.hint}"
            raise
        finally:
            if not self._wire.session.out_of_step:
                self._on_late()
        self._pace.rest(self._config.rest_s)


def _beyond_steps(motor: TheiaMotor) -> int:
    """Enough to get from the upper end of travel to the right side of the barrier."""
    return motor.steps - (motor.switch or 0) + _CLEAR_STEPS


def _home_s(motor: TheiaMotor) -> float:
    """Longest time of homing one motor, s."""
    if motor.switch is None:
        return motor.steps / motor.speed
    return (motor.steps + 2 * _beyond_steps(motor)) / motor.speed
