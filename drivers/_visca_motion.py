"""Motions and modes of a VISCA lens: what is sent, and how its end is seen."""

from __future__ import annotations

import logging
import threading
from functools import partial
from typing import TYPE_CHECKING

from drivers._lens import Deadline, Pace, despite_stops
from drivers._visca import BUSY, NOT_NOW, SYNTAX, Command, ViscaWire, nibbles
from mvp.devices import AXES, Axis
from mvp.errors import DeviceError, DeviceFault

if TYPE_CHECKING:
    from mvp.devices import Clock

_LOG = logging.getLogger(__name__)
_POLL_S = 0.06
_BUSY_S = 0.1
_LOST_S = 1.5  # without completion, but standing: that message was lost
_HALT_S = 3.0
_ZOOM, _FOCUS, _IRIS = b"\x04\x47", b"\x04\x48", b"\x04\x4b"
_ITEMS: dict[Axis, bytes] = {"zoom": _ZOOM, "focus": _FOCUS, "iris": _IRIS}
_POWER, _FOCUS_MODE, _EXPOSURE_MODE = b"\x04\x00", b"\x04\x38", b"\x04\x39"
_ON, _MANUAL, _IRIS_PRIORITY = b"\x02", b"\x03", b"\x0b"
_INITIALISE = b"\x04\x19\x01"
_STOPS = (b"\x04\x07\x00", b"\x04\x08\x00")


class ViscaMotion:
    """The motors of one device.

    Args:
        wire: conversation with it.
        pace: waiting that a stop cuts short.
        clock: monotonic time.
        name: of the device.
        tolerance_counts: how far a position that is read back may be off.
    """

    def __init__(
        self,
        wire: ViscaWire,
        pace: Pace,
        clock: Clock,
        name: str,
        *,
        tolerance_counts: int,
    ) -> None:
        self._wire = wire
        self._pace = pace
        self._clock = clock
        self._name = name
        self._tolerance = tolerance_counts

    def read(self, axis: Axis) -> int:
        """A position."""
        return self._wire.number(_ITEMS[axis])

    def switch_on(self, deadline: Deadline) -> None:
        """Wait until it says that it is on; tell it to be."""
        if self._wire.inquire(_POWER, 1) in (_ON, None):
            return
        _LOG.info("%s: switched on", self._name)
        self._taken(_POWER + _ON, deadline)
        while self._wire.inquire(_POWER, 1) != _ON:
            self._pace.pause(_POLL_S, deadline)

    def initialise(self, deadline: Deadline) -> None:
        """The device's own reference run, where it has one."""
        command = self._taken(_INITIALISE, deadline, may_lack=True)
        if command.refused:
            _LOG.info("%s: has no lens initialisation", self._name)
            return
        self._until_ended(command, deadline)

    def take_control(self, deadline: Deadline) -> None:
        """Manual focus, and an exposure mode in which the iris obeys."""
        self._make_sure(_FOCUS_MODE, (_MANUAL,), deadline)
        self._make_sure(_EXPOSURE_MODE, (_MANUAL, _IRIS_PRIORITY), deadline)

    def _make_sure(
        self, item: bytes, modes: tuple[bytes, ...], deadline: Deadline
    ) -> None:
        """Set a mode unless it is set, and read it back.

        Raises:
            DeviceFault: it does not take the mode.
        """
        if self._wire.inquire(item, 1) in (*modes, None):
            return
        self._until_ended(self._taken(item + modes[0], deadline), deadline)
        mode = self._wire.inquire(item, 1)
        if mode not in modes:
            raise DeviceFault(
                f"stays in mode {mode!r} of {item.hex(' ')}",
                device=self._name,
                code="mode",
                hint="set focus and exposure to manual on the device itself",
            )

    def go(self, axis: Axis, target: int, deadline: Deadline) -> None:
        """One axis to one place; once more when it had gone back to automatic mode."""
        _LOG.debug("%s: %s towards %d", self._name, axis, target)
        what = _ITEMS[axis] + nibbles(target, 4)
        command = self._taken(what, deadline, may_lack=True)
        if command.refused == NOT_NOW:
            # It was not carried out, and it is absolute: sending it again is safe.
            self.take_control(deadline)
            command = self._taken(what, deadline)
        if command.refused:
            raise self._wire.refusal(command.refused, f"{axis} to {target}")
        self._arrive(axis, target, command, deadline)

    def _taken(
        self, what: bytes, deadline: Deadline, *, may_lack: bool = False
    ) -> Command:
        """Send a command, again while both sockets are busy.

        Raises:
            DeviceFault: refused; with ``may_lack`` the caller sees that itself where
                it does not know the command or cannot do it now.
        """
        self._pace.require_ready(self._wire.session)
        command = self._wire.command(what)
        while command.refused == BUSY:
            self._pace.pause(_BUSY_S, deadline)
            self._pace.require_ready(self._wire.session)
            command = self._wire.command(what)
        if command.refused and not (may_lack and command.refused in (SYNTAX, NOT_NOW)):
            raise self._wire.refusal(command.refused, what.hex(" "))
        return command

    def _until_ended(self, command: Command, deadline: Deadline) -> None:
        """Wait for completion; its loss is found out by reading back."""
        lost = Deadline(self._clock, _LOST_S)
        positions: list[int] = []
        while not command.ended:
            self._pace.pause(_POLL_S, deadline)
            now = [self.read(axis) for axis in AXES]
            if now != positions:
                positions, lost = now, Deadline(self._clock, _LOST_S)
            elif lost.passed:
                _LOG.warning("%s: a completion was lost", self._name)
                self._wire.forget(command)
                return
        if command.error:
            raise self._wire.refusal(command.error, "a command failed")

    def _arrive(
        self, axis: Axis, target: int, command: Command, deadline: Deadline
    ) -> None:
        """Wait until it is completed, and stands at the target twice in a row.

        Raises:
            DeviceFault: it failed, or stands elsewhere.
        """
        last: int | None = None
        steady = Deadline(self._clock, _LOST_S)
        while True:
            self._pace.pause(_POLL_S, deadline)
            ended = command.ended
            place = self.read(axis)
            if command.error:
                self._pace.require_going()
                raise self._wire.refusal(command.error, f"{axis} to {target}")
            if place != last:
                last, steady = place, Deadline(self._clock, _LOST_S)
                continue
            there = abs(place - target) <= self._tolerance
            if there and (ended or steady.passed):
                self._wire.forget(command)
                return
            if not there and steady.passed:
                raise self.stalled(axis, place, target)

    def stalled(self, axis: Axis, place: int, target: int) -> DeviceFault:
        return DeviceFault(
            f"{axis} stands at {place} instead of {target}",
            device=self._name,
            code="stall",
            hint="home the lens; if it happens again the axis sticks, or the count is "
            "beyond the device's range",
        )

    def until_steady(self, axis: Axis, deadline: Deadline) -> None:
        last: int | None = None
        while (place := self.read(axis)) != last:
            last = place
            self._pace.pause(_POLL_S, deadline)

    def stop_now(self) -> None:
        """Stop zoom and focus, whatever waits for an answer."""
        self._wire.stop_now(*_STOPS)

    def halt(self) -> None:
        """Stop, and wait until it stands; best effort after a fault."""
        try:
            self.stop_now()
            if not self._until_standing(Deadline(self._clock, _HALT_S)):
                _LOG.error("%s: still moves", self._name)
        except DeviceError as error:
            _LOG.error("%s: may still move: %s", self._name, error.detail)

    def _until_standing(self, deadline: Deadline) -> bool:
        """Two equal readings; told again to stop, as the word may have been lost."""
        never = threading.Event()
        despite_stops(self._wire.session.resync)
        before = self._places()
        while True:
            self._clock.wait(never, _POLL_S)
            now = self._places()
            if now == before:
                return True
            if deadline.passed:
                return False
            before = now
            self.stop_now()

    def _places(self) -> list[int]:
        return [despite_stops(partial(self.read, axis)) for axis in AXES]
