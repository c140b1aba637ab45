"""The lens of a block camera that speaks VISCA: zoom, focus and iris in its own counts.

A motion is done when the device has completed it and two readings of the position in a
row are equal and at the target: some devices complete when they accept, and some
completions get lost. Automatic focus and exposure would undo what was set, so manual
modes are made sure of before every move.
"""

from __future__ import annotations

import threading
from contextlib import contextmanager, suppress
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
from drivers._visca import ViscaConfig, ViscaWire
from drivers._visca_motion import ViscaMotion
from mvp.devices import AXES, Axis, DeviceContext, DeviceInfo, LensState, Link, Role
from mvp.errors import DeviceError, DeviceFault, LimitError

if TYPE_CHECKING:
    from collections.abc import Iterator


class ViscaLens:
    """The lens of a VISCA device."""

    role: ClassVar[Role] = "lens"
    Config = ViscaConfig

    def __init__(self, config: ViscaConfig, context: DeviceContext, name: str) -> None:
        self.name = name
        self._config = config
        self._clock = context.clock
        self._axes = LensAxes(
            config,
            context.folder,
            name,
            ends={
                "zoom": (0, config.optical_end),
                "focus": (0, 0xFFFF),
                "iris": (0, 0xFF),
            },
        )
        self._wire = ViscaWire(
            config,
            context,
            name,
            on_lost=self._on_lost,
            on_restart=self._forget_home,
        )
        self._link = Link(
            name, context.clock, connect=self._connect, disconnect=self._disconnect
        )
        self._motion = ViscaMotion(
            self._wire,
            Pace(self._link, context.clock, name),
            context.clock,
            name,
            tolerance_counts=config.tolerance_counts,
        )
        self._lock = threading.Lock()
        self._identity = ("", "")
        self._homed = False
        self._moves = False

    @classmethod
    def from_config(
        cls, config: ViscaConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the device; no I/O."""
        return cls(config, context, name)

    def open(self) -> None:
        """Connect and identify. Moves nothing.

        Raises:
            ConnectError: no such port, in use, or no such device there.
            ConfigError, CalibrationError: no usable ranges.
        """
        self._link.open()

    def close(self) -> None:
        """Stop the motors and disconnect."""
        self._link.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def info(self) -> DeviceInfo:
        """Identity and versions."""
        self._link.require_open()
        model, firmware = self._identity
        return DeviceInfo(
            self.name,
            "visca",
            model,
            self._config.serial,
            firmware,
            simulated=False,
            extra={
                "address": f"{self._wire.session.address} #{self._config.address}",
                "can_stop": "yes",
            },
        )

    def limits(self) -> dict[Axis, tuple[int, int]]:
        """Lowest and highest count of each axis."""
        return self._axes.limits()

    def state(self) -> LensState:
        """What the device tells.

        Raises:
            ConnectError, LinkLost, DeviceTimeout, WireError: no sensible answer.
        """
        self._link.require_open()
        steps = {axis: self._motion.read(axis) for axis in AXES}
        with self._lock:
            homed, standing = self._homed, not self._moves
        return state_of(steps, homed=homed, standing=standing)

    def home(self, *, timeout_s: float) -> LensState:
        """Switch it on, let it find its own reference, and take manual control. Moves.

        Raises:
            DeviceTimeout, DeviceFault, MotionStopped: see the protocol.
        """
        self._link.require_open()
        deadline = Deadline(self._clock, timeout_s)
        with self._moving():
            self._forget_home()
            self._wire.session.resync()
            self._motion.switch_on(deadline)
            if self._config.initialise:
                self._motion.initialise(deadline)
            self._motion.take_control(deadline)
            for axis in AXES:
                self._motion.until_steady(axis, deadline)
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
            self._motion.take_control(deadline)
            legs = self._axes.legs(steps_of(before), targets)
            self._axes.disengage()
            for leg in legs:
                for axis, target in leg.items():
                    self._motion.go(axis, target, deadline)
            reached = self._reached(targets)
        return reached

    def stop(self) -> None:
        """Stop zoom and focus now, from any thread; the iris needs no stopping."""
        self._link.interrupt()
        if self._link.is_open and not self._wire.session.is_lost:
            self._motion.send_stops()

    def _connect(self) -> None:
        self._axes.ranges()
        try:
            self._identity = self._wire.open()
        except BaseException:
            self._wire.session.close()
            raise
        self._forget_home()
        warn_untried(self.name, "VISCA lenses")

    def _disconnect(self) -> None:
        # Closing must work on a dead link, too.
        with suppress(DeviceError):
            self.stop()
        self._wire.session.close()
        self._forget_home()

    def _on_lost(self, error: DeviceError) -> None:
        self._forget_home()

    def _forget_home(self) -> None:
        with self._lock:
            self._homed = False
        self._axes.disengage()

    @contextmanager
    def _moving(self) -> Iterator[None]:
        """One move at a time; nothing is left in motion, whatever ends it early."""
        with self._wire.session.dumping(), self._link.busy(nothing_to_begin):
            self._moves = True
            try:
                yield
            except LimitError:
                raise
            except BaseException:
                self._motion.halt()
                raise
            finally:
                self._moves = False

    def _reached(self, targets: Steps) -> LensState:
        """Where all axes stand after the last motion; one may have moved another.

        Raises:
            DeviceFault: not where it was sent.
        """
        steps = {axis: self._motion.read(axis) for axis in AXES}
        for axis in AXES:
            if abs(steps[axis] - targets[axis]) > self._config.tolerance_counts:
                raise self._motion.stalled(axis, steps[axis], targets[axis])
        with self._lock:
            homed = self._homed
        if not homed:
            raise DeviceFault(
                "was switched off and on while it moved",
                device=self.name,
                code="restart",
                hint="home it again",
            )
        self._axes.engage()
        return state_of(steps, homed=True, standing=True)
