"""The lens of a block camera that speaks VISCA: zoom, focus and iris in its own counts.

A motion is done when the device has completed it and two readings of the position in a
row are equal and at the target: some devices complete when they accept, and some
completions get lost. Automatic focus and exposure would undo what was set, so manual
modes are made sure of before every move.
"""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, ClassVar

from drivers._lens import Deadline, LensAxes, Pace, Steps, state_of
from drivers._motor_lens import MotorLens
from drivers._visca import ViscaConfig, ViscaWire
from drivers._visca_motion import ViscaMotion
from mvp.devices import AXES, DeviceContext, DeviceInfo, LensState, Role
from mvp.errors import DeviceFault

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from mvp.devices import Session


class ViscaLens:
    """The motors of a VISCA device; ``from_config`` hands out the lens over them."""

    role: ClassVar[Role] = "lens"
    Config = ViscaConfig
    usb_ids: ClassVar[dict[str, str]] = {
        "0403:6001": "a VISCA device behind an FTDI adapter",
        "067b:2303": "a VISCA device behind a Prolific adapter",
    }

    product: ClassVar[str] = "VISCA lenses"

    def __init__(
        self, config: ViscaConfig, context: DeviceContext, name: str, pace: Pace
    ) -> None:
        self.name = name
        self._config = config
        self.axes = LensAxes(
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
            on_lost=lambda error: self.forget_home(),
            on_restart=self.forget_home,
        )
        self._motion = ViscaMotion(
            self._wire,
            pace,
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
    ) -> MotorLens:
        """Build the device; no I/O."""
        return MotorLens(
            name, context.clock, lambda pace: cls(config, context, name, pace)
        )

    @property
    def session(self) -> Session:
        """The conversation with the device."""
        return self._wire.session

    def connect(self) -> None:
        """Open the session and learn who answers. Moves nothing."""
        self._identity = self._wire.open()

    def info(self) -> DeviceInfo:
        """Identity and versions."""
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

    def state(self) -> LensState:
        """What the device tells."""
        steps = {axis: self._motion.read(axis) for axis in AXES}
        with self._lock:
            homed, standing = self._homed, not self._moves
        return state_of(steps, homed=homed, standing=standing)

    def home(self, deadline: Deadline) -> None:
        """Switch it on, let it find its own reference, and take manual control."""
        self.forget_home()
        with self._halting():
            self._wire.session.resync()
            self._motion.switch_on(deadline)
            if self._config.initialise:
                self._motion.initialise(deadline)
            self._motion.take_control(deadline)
            for axis in AXES:
                self._motion.until_steady(axis, deadline)
        with self._lock:
            self._homed = True

    def move(self, legs: Sequence[Steps], targets: Steps, deadline: Deadline) -> None:
        """One axis after the other; then all must stand where they were sent.

        Raises:
            DeviceFault: one stands elsewhere, or it was switched off meanwhile.
        """
        with self._halting():
            self._motion.take_control(deadline)
            for leg in legs:
                for axis, target in leg.items():
                    self._motion.go(axis, target, deadline)
            self._check_reached(targets)

    def stop(self) -> None:
        """Stop zoom and focus at once; the iris needs no stopping."""
        self._motion.stop_now()

    def forget_home(self) -> None:
        """Where the motors are is not known any more."""
        with self._lock:
            self._homed = False
        self.axes.disengage()

    @contextmanager
    def _halting(self) -> Iterator[None]:
        """Leave no motor in motion, whatever ends the motion early."""
        self._moves = True
        try:
            yield
        except BaseException:
            self._motion.halt()
            raise
        finally:
            self._moves = False

    def _check_reached(self, targets: Steps) -> None:
        """One axis may have moved another, and a restart moves all."""
        for axis in AXES:
            place = self._motion.read(axis)
            if abs(place - targets[axis]) > self._config.tolerance_counts:
                raise self._motion.stalled(axis, place, targets[axis])
        with self._lock:
            homed = self._homed
        if not homed:
            raise DeviceFault(
                "was switched off and on while it moved",
                device=self.name,
                code="restart",
                hint="home it again",
            )
