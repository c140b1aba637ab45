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
from contextlib import contextmanager
from typing import TYPE_CHECKING, ClassVar, Self

from drivers._lens import (
    Deadline,
    LensAxes,
    Pace,
    Steps,
    not_homed,
    nothing_to_begin,
    state_of,
    steps_of,
    warn_untried,
)
from drivers._theia import (
    Setup,
    TheiaConfig,
    TheiaMotor,
    TheiaWire,
    end_frame,
    shift_frame,
    to_switch_frame,
)
from mvp.devices import Axis, DeviceContext, DeviceInfo, LensState, Link, Role
from mvp.errors import DeviceError, DeviceFault, DeviceTimeout

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_LOG = logging.getLogger(__name__)
_SLOWER = 1.3  # a motion may take so much longer than its steps at their speed
_SPARE_S = 0.5
_CLEAR_STEPS = 200  # away from the barrier, for certain
_HOME_ORDER: tuple[Axis, Axis, Axis] = ("zoom", "focus", "iris")


class TheiaLens:
    """A lens on a Theia MCR board."""

    role: ClassVar[Role] = "lens"
    Config = TheiaConfig

    def __init__(self, config: TheiaConfig, context: DeviceContext, name: str) -> None:
        self.name = name
        self._config = config
        self._clock = context.clock
        self._motors = config.motors()
        ends = {
            axis: (0, motor.switch or motor.steps)
            for axis, motor in self._motors.items()
        }
        self._axes = LensAxes(config, context.folder, name, ends=ends)
        self._wire = TheiaWire(
            config, context, name, on_lost=self._on_lost, on_late=self._on_late
        )
        self._link = Link(
            name, context.clock, connect=self._connect, disconnect=self._disconnect
        )
        self._pace = Pace(self._link, context.clock, name)
        self._lock = threading.Lock()
        self._identity = ("", "")
        self._counted: Steps = {"zoom": 0, "focus": 0, "iris": 0}
        self._homed = False
        self._turning = False

    @classmethod
    def from_config(
        cls, config: TheiaConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the device; no I/O."""
        return cls(config, context, name)

    def open(self) -> None:
        """Connect and identify. Moves nothing.

        Raises:
            ConnectError: no such port, in use, or no MCR there.
            ConfigError, CalibrationError: no usable ranges.
        """
        self._link.open()

    def close(self) -> None:
        """Disconnect; a motion under way goes on to its end."""
        self._link.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def info(self) -> DeviceInfo:
        """Identity and versions."""
        self._link.require_open()
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

    def limits(self) -> dict[Axis, tuple[int, int]]:
        """Lowest and highest step of each axis."""
        return self._axes.limits()

    def state(self) -> LensState:
        """Where the motors are by the host's count; asks the board nothing.

        Raises:
            ConnectError: not open.
        """
        self._link.require_open()
        with self._lock:
            return state_of(
                self._counted,
                homed=self._homed,
                standing=not self._turning,
                estimated=True,
            )

    def home(self, *, timeout_s: float) -> LensState:
        """Find the barrier of zoom and focus, and close the iris. Moves.

        Raises:
            DeviceTimeout: an answer did not come in time, or could not.
            DeviceFault, MotionStopped: see the protocol.
        """
        self._link.require_open()
        deadline = Deadline(self._clock, timeout_s)
        self._require_time(sum(map(_home_s, self._motors.values())), timeout_s)
        with self._moving():
            with self._lock:
                self._homed = False
            for axis in _HOME_ORDER:
                self._set_up(axis)
            for axis in _HOME_ORDER:
                self._home_axis(axis, deadline)
            self._pace.require_going()
            with self._lock:
                self._homed = True
        return self.state()

    def check_steps(self, *, zoom: int, focus: int, iris: int) -> None:
        """Raise ``LimitError`` when outside the limits. Never moves."""
        self._axes.check({"zoom": zoom, "focus": focus, "iris": iris})

    def move_steps(
        self, *, zoom: int, focus: int, iris: int, timeout_s: float
    ) -> LensState:
        """Move one axis after the other, arriving from the side of the lens table.

        Raises:
            LimitError, DeviceTimeout, DeviceFault, MotionStopped: see the protocol.
        """
        self._link.require_open()
        targets: Steps = {"zoom": zoom, "focus": focus, "iris": iris}
        self._axes.check(targets)
        deadline = Deadline(self._clock, timeout_s)
        with self._moving():
            before = self.state()
            if not before.homed:
                raise not_homed(self.name)
            legs = self._axes.legs(steps_of(before), targets)
            self._require_time(self._duration_s(steps_of(before), legs), timeout_s)
            self._axes.disengage()
            for leg in legs:
                for axis, target in leg.items():
                    self._shift(axis, target, deadline)
            self._pace.require_going()
            self._axes.engage()
        return self.state()

    def stop(self) -> None:
        """Send no further motion; the one under way goes on to its end. Any thread."""
        self._link.interrupt()

    def _connect(self) -> None:
        self._axes.ranges()
        try:
            self._identity = self._wire.open()
        except BaseException:
            self._wire.session.close()
            raise
        # It answers, and it would not while a motor turns.
        self._on_late()
        warn_untried(self.name, "the Theia MCR")

    def _disconnect(self) -> None:
        self._link.interrupt()
        self._wire.session.close()
        self._forget_home()

    def _on_lost(self, error: DeviceError) -> None:
        self._forget_home()

    def _on_late(self) -> None:
        """A motion has ended that was given up: nothing turns any more."""
        with self._lock:
            self._turning = False

    def _forget_home(self) -> None:
        with self._lock:
            self._homed = False
        self._axes.disengage()

    @contextmanager
    def _moving(self) -> Iterator[None]:
        """One move at a time; the traffic is written down when it fails."""
        with self._wire.session.dumping(), self._link.busy(nothing_to_begin):
            yield

    def _require_time(self, needed_s: float, timeout_s: float) -> None:
        """Refuse before the first motion what could not be stopped when it is late."""
        if needed_s > timeout_s:
            raise DeviceTimeout(
                f"needs {needed_s:.1f} s and has {timeout_s:g} s, and cannot be stopped "
                "half-way; nothing has moved",
                device=self.name,
                hint="allow more time",
            )

    def _duration_s(self, now: Steps, legs: Sequence[Steps]) -> float:
        """Time of all motions at their speed."""
        at = dict(now)
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
        self._pace.require_going()
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
            self._forget_home()
            if isinstance(error, DeviceTimeout):
                error.hint = f"a motor may still turn; then home it. {error.hint}"
            raise
        finally:
            if not self._wire.session.out_of_step:
                self._on_late()
        self._link.wait_until(self._clock.now_s() + self._config.rest_s)


def _beyond_steps(motor: TheiaMotor) -> int:
    """Enough to get from the upper end of travel to the right side of the barrier."""
    return motor.steps - (motor.switch or 0) + _CLEAR_STEPS


def _home_s(motor: TheiaMotor) -> float:
    """Longest time of homing one motor, s."""
    if motor.switch is None:
        return motor.steps / motor.speed
    return (motor.steps + 2 * _beyond_steps(motor)) / motor.speed
