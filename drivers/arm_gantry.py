"""A serial gantry with a pan/tilt head: GRBL, grblHAL, FluidNC or Marlin.

The envelope is checked here before anything is sent; arrival is the firmware's word and
a position read back. The driver never unlocks an alarm, writes a setting or repeats a
motion by itself.
"""

from __future__ import annotations

import logging
import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from drivers._gantry.axes import GantryAxes, share_of
from drivers._gantry.config import USB_IDS, GantryConfig
from drivers._gantry.grbl_wire import GrblWire
from drivers._gantry.homing import (
    homing_of,
    homing_step,
    is_known,
    require_clear,
    require_found,
    require_marks,
    way_to_marks,
)
from drivers._gantry.marlin_wire import MarlinWire
from drivers._gantry.verdicts import (
    late,
    refuse_held,
    require_arrived,
    require_ready,
    require_same,
)
from drivers._gantry.wire import Activity
from mvp.devices import (
    ArmState,
    DeviceContext,
    DeviceInfo,
    Homing,
    Link,
    RecoveryStep,
    Role,
    link_resource,
    require_real_time,
)
from mvp.errors import DeviceError, DeviceTimeout, MotionStopped

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from drivers._gantry.wire import GantryWire, Identity, Report
    from mvp.devices import Finding
    from mvp.devices.protocols import ClearWay
    from mvp.geometry import FloatArray

_LOG = logging.getLogger(__name__)
_LAST_REST_S = 8.0  # to come to rest before the port is closed
_MARK_SPEED = 0.3  # share of full speed on the way to the marks


class GantryArm:
    """A gantry on one serial port."""

    role: ClassVar[Role] = "arm"
    Config = GantryConfig
    usb_ids: ClassVar[dict[str, str]] = USB_IDS

    def __init__(self, config: GantryConfig, context: DeviceContext, name: str) -> None:
        self.name = name
        self._config = config
        self._clock = context.clock
        require_real_time(context.clock, name)
        self._axes = GantryAxes(config, name)
        self._stopping = threading.Event()
        wire = MarlinWire if config.firmware == "marlin" else GrblWire
        self._wire: GantryWire = wire(
            config,
            context,
            name,
            on_home_lost=self._lose_home,
            stopping=self._stopping,
        )
        self._link = Link(
            name, context.clock, connect=self._connect, disconnect=self._disconnect
        )
        self._lock = threading.Lock()
        self._sending_stop = threading.Lock()
        self._idle = threading.Event()
        self._idle.set()
        self._homed = False
        self._identity: Identity | None = None

    @classmethod
    def from_config(
        cls, config: GantryConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the device; no I/O."""
        return cls(config, context, name)

    def open(self) -> None:
        """Connect and identify. Moves nothing.

        Raises:
            ConnectError: no such port, in use, or another machine.
        """
        self._link.open()

    def close(self) -> None:
        """Stop a motion and disconnect."""
        self._link.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def info(self) -> DeviceInfo:
        """Identity and versions."""
        self._link.require_open()
        identity = self._identity
        return DeviceInfo(
            self.name,
            "gantry",
            self._config.model,
            self._config.serial or (identity.serial if identity else ""),
            f"{identity.firmware} {identity.version}" if identity else "",
            simulated=False,
            extra={
                "address": self._wire.session.address,
                "can_stop": self._wire.can_stop,
                "declared_axes": ", ".join(self._declared) or "none",
            },
        )

    def doubts(self) -> tuple[Finding, ...]:
        """Settings of the machine that are not as a camera on it needs them."""
        return self._wire.doubts

    def resource(self) -> str:
        """The port that it is driven through."""
        return link_resource(self._config.port, device=self.name)

    @property
    def homed(self) -> bool:
        """Whether it is known where the axes are."""
        return self._homed

    def state(self) -> ArmState:
        """Where the counters say that it is; an alarm is its ``fault``.

        Raises:
            DeviceFault: it is held, or an alarm keeps it from answering.
            ConnectError, DeviceTimeout, LinkLost, WireError: no sensible answer.
        """
        self._link.require_open()
        report = self._wire.report()
        self._refuse_alarm(report)
        return self._state_of(report)

    def check_joints(self, joints: Sequence[float]) -> None:
        """Raise ``LimitError`` when the target is outside the limits. Never moves."""
        self._axes.checked(joints)

    def duration_s(
        self,
        start: Sequence[float],
        target: Sequence[float],
        *,
        speed_fraction: float = 1.0,
    ) -> float:
        """How long such a move takes, s: ramps and settling included."""
        way = self._axes.duration_s(
            np.asarray(start, np.float64),
            np.asarray(target, np.float64),
            share_of(speed_fraction),
        )
        return way + self._config.settle_s

    def homing(self) -> Homing:
        """What ``home`` would move now, and which axes are only believed."""
        self._link.require_open()
        return homing_of(self._config.axes, self._wire.report())

    def home(self, *, timeout_s: float, clear: ClearWay | None = None) -> ArmState:
        """Let the firmware find its switches; declared axes are believed. Moves.

        Raises:
            DeviceFault: an alarm stands, a switch was not found, or an axis without one
                is away from its mark and nobody says that the way there is clear.
            DeviceTimeout, MotionStopped: see the protocol.
            Whatever ``clear`` raises.
        """
        self._link.require_open()
        with self._wire.session.dumping(), self._acting():
            self._lose_home("homing")
            with self._stopped_cleanly():
                self._wire.home(timeout_s=min(timeout_s, self._config.homing_s))
            require_found(self._wire.report(), self._config.axes, self.name)
            self._to_marks(timeout_s, clear)
            require_marks(self._wire.report(), self._config.axes, self.name)
            with self._lock:
                self._homed = True
        return self.state()

    def move_joints(
        self, joints: Sequence[float], *, speed_fraction: float = 1.0, timeout_s: float
    ) -> ArmState:
        """Move along a straight line in joint space; return where it stands.

        Raises:
            LimitError, DeviceTimeout, DeviceFault, MotionStopped: see the protocol.
        """
        self._link.require_open()
        target = self._axes.checked(joints)
        share = share_of(speed_fraction)
        with self._wire.session.dumping(), self._acting():
            here = self._ready()
            feed = self._axes.feed_min(here, target, share)
            with self._stopped_cleanly():
                self._wire.move(
                    self._axes.words(target), feed_min=feed, timeout_s=timeout_s
                )
                self._settle()
                return self._arrived(target)

    def stop(self) -> None:
        """Stop now, from any thread; a homing that is stopped loses the position."""
        if not self._link.is_open or self._wire.session.is_lost:
            return
        with self._sending_stop:
            self._stopping.set()
            if self._link.interrupt():
                self._wire.halt()
                return
        self._stop_what_nobody_began()

    def _stop_what_nobody_began(self) -> None:
        """It may move without a motion of ours: of another program, or left behind."""
        with suppress(DeviceError):
            if self._wire.report().activity is Activity.MOVES:
                _LOG.warning("%s: moves, and no motion of ours is under way", self.name)
                self._halted()

    def recovery(self) -> Iterator[RecoveryStep]:
        """Out of an alarm: reset, then home; each step is for a person to allow.

        Raises:
            DeviceError: it cannot be asked what is the matter.
        """
        self.open()
        for words, act in self._wire.reset_steps():
            yield RecoveryStep(words, acknowledge=True, act=act)
        if not self._homed:
            yield homing_step(self.homing, self._home_for_person)

    # ------------------------------------------------------------ inside

    @property
    def _declared(self) -> list[str]:
        """Letters of the axes that nothing measures."""
        return [axis.letter for axis in self._config.axes if axis.declared]

    def _home_for_person(self) -> str:
        self.home(timeout_s=self._config.homing_s)
        return "homed"

    def _connect(self) -> None:
        try:
            self._identity = self._wire.open()
            require_same(self._identity, self._config.serial, self.name)
            report = self._wire.report()
        except BaseException:
            self._wire.session.close()
            raise
        with self._lock:
            self._homed = is_known(report, self._config.axes)
        _LOG.warning("%s: this driver was not tried on hardware yet", self.name)

    def _disconnect(self) -> None:
        with suppress(DeviceError):
            self.stop()
        self._idle.wait(_LAST_REST_S)
        self._wire.session.close()
        with self._lock:
            self._homed = False

    def _lose_home(self, why: str) -> None:
        with self._lock:
            lost, self._homed = self._homed, False
        if lost:
            _LOG.warning("%s: not homed any more: %s", self.name, why)

    def _refuse_alarm(self, report: Report) -> None:
        if report.activity is Activity.ALARM and self._homed:
            self._lose_home(report.state)
        refuse_held(report, self.name)

    def _state_of(self, report: Report) -> ArmState:
        joints = self._axes.joints(report.machine)
        pose = self._axes.model.forward(np.array(joints)).matrix
        standing = report.activity in (Activity.STANDS, Activity.ALARM)
        fault = ""
        if report.activity is Activity.ALARM:
            alarm = self._wire.alarm
            fault = (
                alarm.detail if alarm else f"the controller is locked ({report.state})"
            )
        return ArmState(joints, pose, standing, self._clock.now_s(), fault)

    def _ready(self) -> FloatArray:
        """Joints it starts from; refuses when it should not move at all."""
        report = self._wire.report()
        self._refuse_alarm(report)
        if report.activity is Activity.ALARM and (alarm := self._wire.alarm):
            raise alarm
        require_ready(report, self.name, homed=self._homed)
        return np.array(self._axes.joints(report.machine))

    def _begin(self) -> None:
        self._stopping.clear()
        self._idle.clear()

    @contextmanager
    def _acting(self) -> Iterator[None]:
        """One motion; a stop in its very last moment leaves no hold behind."""
        try:
            with self._link.busy(self._begin):
                yield
        finally:
            with self._sending_stop:  # its byte must not meet a machine at rest
                stopped = self._stopping.is_set()
            if stopped:
                self._come_to_rest()
            self._idle.set()
        if stopped:
            raise MotionStopped("stopped as it came to rest", device=self.name)

    @contextmanager
    def _stopped_cleanly(self) -> Iterator[None]:
        """Whatever ends a motion early: stop it, unless somebody has, and bring it to rest.

        The caller's exception may come from anywhere; the machine knows nothing of it.
        """
        try:
            yield
        except BaseException as error:
            is_late = isinstance(error, DeviceTimeout)
            if self._stopping.is_set():
                if is_late:
                    raise MotionStopped("stopped", device=self.name) from error
                raise
            rests = self._halted()
            if is_late:
                raise late(self.name, rests=rests) from error
            raise

    def _halted(self) -> bool:
        """Stop it from here; whether it was seen to stand."""
        with suppress(DeviceError):
            self._wire.halt()
        return self._come_to_rest()

    def _come_to_rest(self) -> bool:
        known = not self._wire.session.is_lost and self._wire.settle_halt()
        if not known:
            self._lose_home("it was stopped in a way that may lose steps")
        return known

    def _settle(self) -> None:
        """Ringing is not visible to the firmware."""
        self._clock.wait(self._stopping, self._config.settle_s)

    def _arrived(self, target: FloatArray) -> ArmState:
        """Where it stands: a lost byte or a clamped target shows here."""
        report = self._wire.report()
        require_arrived(report, self._axes.off(report.machine, target), self.name)
        return self._state_of(report)

    def _to_marks(self, timeout_s: float, clear: ClearWay | None) -> None:
        """Drive what no switch measures to its marks: a person sees if it is there."""
        way = way_to_marks(self._axes, self._config.axes, self._wire.report())
        if way is None:
            return
        require_clear(way, clear, self.name)
        start, end = np.array(way[0]), np.array(way[1])
        with self._stopped_cleanly():
            self._wire.move(
                self._axes.words(end, "".join(self._declared)),
                feed_min=self._axes.feed_min(start, end, _MARK_SPEED),
                timeout_s=timeout_s,
            )
        letters = ", ".join(self._declared)
        _LOG.warning("%s: are the axes %s at their marks?", self.name, letters)
