"""Kurokesu SCF4: a lens controller with three stepper axes, spoken to in lines.

A move is acknowledged when it is understood, not when it is done; arrival is seen by
polling the status. The controller knows no limits and compensates no backlash; the
counters have 16 bits and are lost when it restarts.
"""

from __future__ import annotations

import logging
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, ClassVar

from drivers._lens import Deadline, LensAxes, Pace, Steps, despite_stops, state_of
from drivers._motor_lens import MotorLens
from drivers._scf4 import (
    COUNTER,
    UPPER,
    Scf4Config,
    Scf4Motor,
    Scf4Status,
    Scf4Wire,
    words,
)
from mvp.devices import AXES, Axis, DeviceContext, DeviceInfo, LensState, Role
from mvp.errors import ConfigError, DeviceError, DeviceFault

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from mvp.devices import Session

_LOG = logging.getLogger(__name__)
_POLL_S = 0.02
_START_S = 1.0  # within which a motor must be seen to move, or to be there already
_HALT_S = 3.0
_BACK_OFF_STEPS = 200
_SEEK_STEPS = 100  # only the sign counts while a sensor is looked for
_BEYOND = 1.25  # of the range, to meet the end of travel from anywhere


class Scf4Lens:
    """The motors of an SCF4; ``from_config`` hands out the lens over them."""

    role: ClassVar[Role] = "lens"
    Config = Scf4Config
    usb_ids: ClassVar[dict[str, str]] = {"0483:5740": "an SCF4"}

    product: ClassVar[str] = "the Kurokesu SCF4"

    def __init__(
        self, config: Scf4Config, context: DeviceContext, name: str, pace: Pace
    ) -> None:
        self.name = name
        self._config = config
        self._clock = context.clock
        self._motors: dict[Axis, Scf4Motor] = {
            "zoom": config.zoom_motor,
            "focus": config.focus_motor,
            "iris": config.iris_motor,
        }
        self.axes = LensAxes(
            config,
            context.folder,
            name,
            ends=dict.fromkeys(AXES, (0, COUNTER - 1)),
        )
        self._wire = Scf4Wire(
            config, context, name, on_lost=lambda error: self.forget_home()
        )
        self._pace = pace
        self._lock = threading.Lock()
        self._identity = ("", "", "", "")
        self._homed = False
        # What the counters must read while nothing was commanded; None while moving.
        self._expected: Steps | None = None

    @classmethod
    def from_config(
        cls, config: Scf4Config, context: DeviceContext, *, name: str
    ) -> MotorLens:
        """Build the device; no I/O."""
        return MotorLens(
            name, context.clock, lambda pace: cls(config, context, name, pace)
        )

    @property
    def session(self) -> Session:
        """The conversation with the controller."""
        return self._wire.session

    def connect(self) -> None:
        """Open the session and learn who answers. Moves nothing."""
        self._identity = self._wire.open()
        self._wire.status()

    def info(self) -> DeviceInfo:
        """Identity and versions."""
        firmware, board, brand, serial = self._identity
        return DeviceInfo(
            self.name,
            "scf4",
            f"{brand} {board}",
            serial,
            firmware,
            simulated=False,
            extra={"address": self._wire.session.address, "can_stop": "yes"},
        )

    def state(self) -> LensState:
        """The counters, compared with what they must read: a restart clears them."""
        with self._lock:
            expected = self._expected
        status = self._wire.status()
        with self._lock:
            # Otherwise something moved while the question was on its way.
            undisturbed = expected is not None and expected is self._expected
            if self._homed and undisturbed and status.steps != expected:
                _LOG.warning("%s: the counters changed, home is lost", self.name)
                self._homed = False
            homed = self._homed
        return state_of(status.steps, homed=homed, standing=status.standing)

    def home(self, deadline: Deadline) -> None:
        """Find the reference of every axis, one after the other."""
        self._require_travel()
        self.forget_home()
        with self._halting():
            self._set_up()
            for axis in self._config.home_order:
                self._home_axis(axis, deadline)
            self._order("M239", "G90")
        self._stand(homed=True)

    def _require_travel(self) -> None:
        """What runs against an end must know how far away that may be.

        Raises:
            ConfigError: the range of such a motor is a single step.
        """
        for axis in self._config.home_order:
            range_ = self.axes.ranges()[axis]
            if self._motors[axis].home == "stop" and range_.low == range_.high:
                raise ConfigError(
                    f"{self.name}: {axis} is homed against the end of its travel, but "
                    f"its range is the one step {range_.low}",
                    hint=f"give low and high of its whole travel as [lens.{axis}]",
                    where=self.name,
                )

    def move(self, legs: Sequence[Steps], targets: Steps, deadline: Deadline) -> None:
        """All axes of a leg at once.

        Raises:
            DeviceFault: they stand elsewhere.
        """
        with self._lock:
            self._expected = None
        with self._halting():
            for leg in legs:
                self._travel(leg, deadline)
            # A disturbed order can have moved an axis that it did not name.
            reached = self._wire.status()
            if reached.steps != targets or not reached.standing:
                raise self._elsewhere(reached.steps, targets)
        self._stand(homed=True, at=targets)

    def stop(self) -> None:
        """Stop all motors, whatever waits for an answer; the counters stay right."""
        self._wire.stop_now()

    def forget_home(self) -> None:
        """Where the motors are is not known any more."""
        with self._lock:
            self._homed = False
            self._expected = None
        self.axes.disengage()

    def _stand(self, *, homed: bool, at: Steps | None = None) -> None:
        """Note where the motors stand from now on."""
        steps = self._wire.status().steps if at is None else at
        with self._lock:
            self._homed = homed and not self._wire.session.is_lost
            self._expected = dict(steps)

    def _order(self, *lines: str) -> None:
        """Orders of a motion; none goes out after a stop."""
        for line in lines:
            self._pace.require_ready(self._wire.session)
            self._wire.order(line)

    def _set_up(self) -> None:
        """Reset the driver chip and tell it everything that it forgets."""
        motors = self._motors.values()
        self._order(
            "$B2",
            words("M234", {m.letter: m.run_current for m in motors}),
            words("M235", {m.letter: m.idle_current for m in motors}),
            words(
                "M232",
                {m.letter: m.sensor_low for m in motors}
                | {UPPER[m.letter]: m.sensor_high for m in motors},
            ),
            words("M240", {m.letter: self._config.step_period for m in motors}),
        )
        if self._config.micro_steps is not None:
            self._order(f"M243 C{self._config.micro_steps}")
        self._order("M238", "M230 A", "M230 B", "M230 C", "G91")

    def _home_axis(self, axis: Axis, deadline: Deadline) -> None:
        _LOG.info("%s: homing %s", self.name, axis)
        if self._motors[axis].home == "sensor":
            self._home_on_sensor(axis, deadline)
        else:
            self._home_on_stop(axis, deadline)
        motor = self._motors[axis]
        self._order(f"G92 {motor.letter}{motor.home_step}", f"M230 {motor.letter}")

    def _home_on_sensor(self, axis: Axis, deadline: Deadline) -> None:
        """To the edge, back off, and to the edge again, always upwards."""
        letter = self._motors[axis].letter
        inside = self._wire.status().sensor[axis]
        self._seek(axis, deadline, upwards=not inside)
        self._order(f"M230 {letter}")
        self._shift(axis, -_BACK_OFF_STEPS, deadline)
        if self._wire.status().sensor[axis]:
            raise DeviceFault(
                f"the sensor of {axis} does not let go",
                device=self.name,
                code="home",
                hint="check its thresholds (sensor_low, sensor_high) and its wiring",
            )
        self._seek(axis, deadline, upwards=True)

    def _seek(self, axis: Axis, deadline: Deadline, *, upwards: bool) -> None:
        """Run until the sensor changes to ``upwards``; the count is ignored."""
        letter = self._motors[axis].letter
        steps = _SEEK_STEPS if upwards else -_SEEK_STEPS
        self._order(f"M231 {letter}", f"G0 {letter}{steps:+d}")
        while True:
            self._pace.pause(_POLL_S, deadline)
            status = self._wire.status()
            if status.sensor[axis] == upwards and not status.moving[axis]:
                return

    def _home_on_stop(self, axis: Axis, deadline: Deadline) -> None:
        """Against the lower end of travel at low current."""
        motor = self._motors[axis]
        low, high = self.axes.ranges()[axis].reach
        beyond = round(_BEYOND * (high - low))
        self._order(words("M234", {motor.letter: self._config.stop_current}))
        self._shift(axis, -beyond, deadline)
        self._order(words("M234", {motor.letter: motor.run_current}))

    def _shift(self, axis: Axis, steps: int, deadline: Deadline) -> None:
        """Relative move of one axis."""
        target = (self._wire.status().steps[axis] + steps) % COUNTER
        self._order(f"G0 {self._motors[axis].letter}{steps:+d}")
        self._arrive({axis: target}, deadline)

    def _travel(self, leg: Steps, deadline: Deadline) -> None:
        """Absolute move of some axes at once."""
        _LOG.debug("%s: towards %s", self.name, leg)
        steps = {self._motors[axis].letter: step for axis, step in leg.items()}
        self._order("G90", words("G0", steps))
        self._arrive(leg, deadline)

    def _arrive(self, target: Mapping[Axis, int], deadline: Deadline) -> None:
        """Wait until the axes were seen to move, or are there, and stand.

        Raises:
            DeviceFault: they stand elsewhere.
        """
        started = Deadline(self._clock, _START_S)
        seen = False
        while True:
            self._pace.pause(_POLL_S, deadline)
            status = self._wire.status()
            there = all(status.steps[axis] == step for axis, step in target.items())
            seen = seen or not status.standing
            if status.standing and there:
                break
            if status.standing and (seen or started.passed):
                raise self._elsewhere(status.steps, target)
        self._pace.pause(self._config.settle_s, deadline)

    def _elsewhere(self, steps: Steps, target: Mapping[Axis, int]) -> DeviceFault:
        with self._lock:
            self._homed = False
        return DeviceFault(
            f"stands at {steps} instead of {dict(target)}",
            device=self.name,
            code="position",
            hint="it restarted, or the line is disturbed; home it again",
        )

    @contextmanager
    def _halting(self) -> Iterator[None]:
        """Leave no motor in motion, whatever ends the motion early."""
        try:
            yield
        except BaseException:
            self._halt()
            raise

    def _halt(self) -> None:
        """Stop the motors and wait until they stand; best effort after a fault."""
        try:
            status = self._stopped(Deadline(self._clock, _HALT_S))
            if not status.standing:
                _LOG.error("%s: still moves", self.name)
            with self._lock:
                homed = self._homed
            self._stand(homed=homed and status.standing, at=status.steps)
        except DeviceError as error:
            _LOG.error("%s: may still move: %s", self.name, error.detail)
            self.forget_home()

    def _stopped(self, deadline: Deadline) -> Scf4Status:
        """Tell them to stop until they do; the word may have been lost on the way."""
        never = threading.Event()
        while True:
            self._wire.stop_now()
            self._clock.wait(never, _POLL_S)
            despite_stops(self._wire.session.resync)
            status = despite_stops(self._wire.status)
            if status.standing or deadline.passed:
                return status
