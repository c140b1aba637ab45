"""VISCA's side of the wire: packets that end with FF, sockets, and inquiries.

A command is acknowledged with the number of a socket and completed later under that
number; inquiries are answered in between. Two commands may be open at a time.
"""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from drivers._lens import LensConfig, stopped
from mvp.devices import DelimiterFramer, DeviceContext, Session, Take
from mvp.errors import ConnectError, DeviceError, DeviceFault, DeviceTimeout, WireError

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.devices import Ask

_LOG = logging.getLogger(__name__)
_END = b"\xff"
_LONGEST = 16
_TRIES = 3
_SOCKETS = (1, 2)
_ACK, _COMPLETION, _ERROR = 0x40, 0x50, 0x60
_CANCELLED, _NO_SOCKET = 0x04, 0x05
SYNTAX, BUSY, NOT_NOW = 0x02, 0x03, 0x41
_WORDS = {
    0x01: "the message has a wrong length",
    SYNTAX: "it does not know the command or its values",
    BUSY: "both of its sockets are busy",
    _CANCELLED: "the command was cancelled",
    _NO_SOCKET: "there is no such socket",
    NOT_NOW: "it cannot do that now",
}


class ViscaConfig(LensConfig):
    """Keys of ``[lens]`` for VISCA, beside port and ranges.

    Attributes:
        baud: as set on the device.
        address: of the device on the line, 1 to 7.
        assign_address: give the devices of the line their addresses when it is opened.
        acknowledges: False for clones that complete without having acknowledged.
        initialise: let ``home`` run the device's own lens initialisation.
        optical_end: highest zoom position that is not digital zoom.
        tolerance_counts: how far the position that is read back may be off.
        serial: of the device; the protocol knows none.
    """

    baud: int = Field(default=9600, gt=0)
    address: int = Field(default=1, ge=1, le=7)
    assign_address: bool = True
    acknowledges: bool = True
    initialise: bool = True
    optical_end: int = Field(default=0x4000, gt=0, le=0xFFFF)
    tolerance_counts: int = Field(default=0, ge=0)
    serial: str = Field(default="unknown", min_length=1)


@dataclass(eq=False)
class Command:
    """One command and what became of it.

    Attributes:
        refused: the device's code when it did not take it; 0 when it did.
        ended: whether it was completed, or failed later.
        error: the device's code when it failed later.
    """

    refused: int = 0
    ended: bool = False
    error: int = 0


def nibbles(value: int, count: int) -> bytes:
    """A number with four bits in every byte."""
    return bytes(value >> 4 * k & 0x0F for k in reversed(range(count)))


def from_nibbles(data: bytes) -> int | None:
    """The number; None when a byte holds more than four bits."""
    if any(byte > 0x0F for byte in data):
        return None
    return sum(byte << 4 * k for k, byte in enumerate(reversed(data)))


def meaning(code: int) -> str:
    """What an error code says."""
    return _WORDS.get(code, f"error {code:02x}")


class ViscaWire:
    """Conversation with one device.

    Args:
        config: port, address and waiting times.
        context: clock, links, where traffic is written after a fault.
        name: of the device.
        on_lost: told when the link breaks.
        on_restart: told when the device says that it was switched on.
    """

    def __init__(
        self,
        config: ViscaConfig,
        context: DeviceContext,
        name: str,
        *,
        on_lost: Callable[[DeviceError], None],
        on_restart: Callable[[], None],
    ) -> None:
        self.name = name
        self._config = config
        self._on_restart = on_restart
        self._to = bytes([0x80 | config.address])
        self._from = 0x80 | config.address << 4
        self._lock = threading.Lock()
        self._sockets: dict[int, Command] = {}
        # The last command that was sent and not acknowledged: some devices never do.
        self._unplaced: Command | None = None
        self._addressed = False
        self.session = Session(
            context.transports(config, name),
            DelimiterFramer(_END, max_bytes=_LONGEST),
            clock=context.clock,
            on_push=self._unasked,
            sync=self._sync,
            on_lost=on_lost,
            strip_echo=config.strip_echo,
            quiet_s=config.quiet_s,
            dump_folder=context.dump_folder,
        )

    @property
    def busy(self) -> bool:
        """Whether a command is open."""
        with self._lock:
            return bool(self._sockets)

    def open(self) -> tuple[str, str]:
        """Connect; model and firmware of who answers.

        Raises:
            ConnectError: no such port, in use, or no VISCA device there.
            LinkLost: unplugged meanwhile.
        """
        self._addressed = False
        self.session.open()
        # What the device was told by others is forgotten before it is asked anything.
        self.session.fall_out_of_step()
        try:
            (frame,) = self.session.request_until(
                self._packet(b"\x09\x00\x02"),
                self._is_version,
                timeout_s=self._config.answer_s,
                patience_s=self._config.identify_s,
            )
        except DeviceTimeout as error:
            raise ConnectError(
                f"no VISCA device answers as number {self._config.address}",
                device=self.name,
                hint="is it switched on, and are baud and address as set there?",
            ) from error
        if len(frame) < 10:
            return "VISCA, version not told", "unknown"
        return f"VISCA {frame[2:4].hex()}:{frame[4:6].hex()}", frame[6:8].hex()

    def inquire(self, what: bytes, count: int) -> bytes | None:
        """The data of an answer with ``count`` bytes; None when it does not know it.

        Raises:
            DeviceFault: it refuses otherwise.
            DeviceTimeout, LinkLost, ConnectError: see ``Session.request``.
        """
        (frame,) = self.session.request_until(
            self._packet(b"\x09" + what),
            lambda frame: self._is_answer(frame, count),
            timeout_s=self._config.answer_s,
            tries=_TRIES,
        )
        if frame[1] == _COMPLETION:
            return frame[2:-1]
        if frame[2] == SYNTAX:
            return None
        raise self.refusal(frame[2], f"inquiry {what.hex(' ')}")

    def number(self, what: bytes) -> int:
        """A position: four nibbles.

        Raises:
            WireError: it tells none.
            DeviceFault, DeviceTimeout, LinkLost, ConnectError: as ``inquire``.
        """
        data = self.inquire(what, 4)
        value = None if data is None else from_nibbles(data)
        if value is None:
            raise WireError(f"tells no position for {what.hex(' ')}", device=self.name)
        return value

    def command(self, what: bytes) -> Command:
        """Send a command; returns when it was acknowledged, completed or refused.

        Raises:
            DeviceTimeout, LinkLost, ConnectError: see ``Session.request``.
        """
        command = Command()
        with self._lock:
            self._unplaced = command
        self.session.request(
            self._packet(b"\x01" + what),
            lambda frame: self._is_taken(frame, command),
            timeout_s=self._config.answer_s,
            optional=not self._config.acknowledges,
        )
        return command

    def stop_now(self, *whats: bytes) -> None:
        """Cancel what is open and send commands, past one that waits, which ends.

        No answer is awaited. Cancelling first leaves a socket for each command; where
        one was never acknowledged, it may be in either.

        Raises:
            LinkLost, ConnectError, DeviceTimeout: it cannot be sent.
        """
        with self._lock:
            unplaced = () if self._unplaced is None else _SOCKETS
            numbers = sorted({*self._sockets, *unplaced})
        for number in numbers:
            self.session.send(self._packet(bytes([0x20 | number])))
        for what in whats:
            self.session.send(self._packet(b"\x01" + what))
        self.session.abort(stopped(self.name), in_step=False)
        self.session.fall_out_of_step()

    def forget(self, command: Command) -> None:
        """Wait for its completion no longer."""
        with self._lock:
            self._sockets = {n: c for n, c in self._sockets.items() if c is not command}

    def refusal(self, code: int, what: str) -> DeviceFault:
        """The fault of a refused or failed command."""
        return DeviceFault(
            f"{what}: {meaning(code)}",
            device=self.name,
            code=f"{code:02x}",
            hint="is it in manual focus and exposure, and is the value in its range?",
        )

    def _packet(self, payload: bytes) -> bytes:
        return self._to + payload + _END

    def _is_version(self, frame: bytes) -> Take:
        if not self._is_ours(frame):
            return Take.OTHER
        version = len(frame) == 10 and frame[1] == _COMPLETION
        unknown = len(frame) == 4 and frame[1:3] == bytes([_ERROR, SYNTAX])
        return Take.DONE if version or unknown else Take.OTHER

    def _is_answer(self, frame: bytes, count: int) -> Take:
        if not self._is_ours(frame):
            return Take.OTHER
        if frame[1] == _COMPLETION and len(frame) == 3 + count:
            if from_nibbles(frame[2:-1]) is None:
                self.session.fall_out_of_step()
                raise WireError(f"answers {frame.hex(' ')}", device=self.name)
            return Take.DONE
        refused = frame[1] & 0xF0 == _ERROR and len(frame) == 4
        return Take.DONE if refused and frame[2] != _CANCELLED else Take.OTHER

    def _is_taken(self, frame: bytes, command: Command) -> Take:
        """Whether this tells the fate of a command that was just sent."""
        if not self._is_ours(frame):
            return Take.OTHER
        kind, socket = frame[1] & 0xF0, frame[1] & 0x0F
        if kind == _ACK and len(frame) == 3:
            with self._lock:
                self._sockets[socket] = command
                self._unplaced = None
            return Take.DONE
        if kind == _ERROR and len(frame) == 4 and frame[2] != _CANCELLED:
            command.refused = frame[2]
            self._place()
            return Take.DONE
        if kind == _COMPLETION and len(frame) == 3 and not self._is_open(socket):
            command.ended = True
            self._place()
            return Take.DONE
        return Take.OTHER

    def _place(self) -> None:
        """The last command is in no socket: it was refused, or has ended."""
        with self._lock:
            self._unplaced = None

    def _unasked(self, frame: bytes) -> bool:
        """Ends of open commands, and the message that the device was switched on."""
        if not self._is_ours(frame):
            return False
        kind, socket = frame[1] & 0xF0, frame[1] & 0x0F
        if frame[1:] == b"\x38\xff":
            self._restarted()
            return True
        if kind == _COMPLETION and len(frame) == 3:
            return self._end(socket, 0)
        if kind == _ERROR and len(frame) == 4:
            return self._end(socket, frame[2])
        return False

    def _end(self, socket: int, error: int) -> bool:
        """A command has ended; False when none is open there."""
        with self._lock:
            command = self._sockets.pop(socket, None)
            if command is None:
                command, self._unplaced = self._unplaced, None
            if command is None:
                return False
            command.error = error
            command.ended = True
            return True

    def _restarted(self) -> None:
        _LOG.warning("%s: says that it was switched on", self.name)
        with self._lock:
            commands, self._sockets = list(self._sockets.values()), {}
        for command in commands:
            command.error = _CANCELLED
            command.ended = True
        self._on_restart()

    def _is_open(self, socket: int) -> bool:
        with self._lock:
            return socket in self._sockets

    def _is_ours(self, frame: bytes) -> bool:
        return len(frame) >= 3 and frame[0] == self._from

    def _sync(self, ask: Ask) -> None:
        """Give the addresses once, empty the sockets, and have that confirmed."""
        if self._config.assign_address and not self._addressed:
            (frame,) = ask(
                b"\x88\x30\x01\xff", _is_network, timeout_s=self._config.answer_s
            )
            if frame[2] <= self._config.address:
                raise ConnectError(
                    f"the line has {frame[2] - 1} devices, number "
                    f"{self._config.address} is not among them",
                    device=self.name,
                    hint="correct address, or set assign_address = false",
                )
        self._addressed = True
        ask(
            self._packet(b"\x01\x00\x01"),
            self._is_clear,
            timeout_s=self._config.answer_s,
        )
        with self._lock:
            self._sockets.clear()
            self._unplaced = None

    def _is_clear(self, frame: bytes) -> Take:
        clear = self._is_ours(frame) and frame[1:] == b"\x50\xff"
        return Take.DONE if clear else Take.OTHER


def _is_network(frame: bytes) -> Take:
    answer = len(frame) == 4 and frame[:2] == b"\x88\x30" and 2 <= frame[2] <= 8
    return Take.DONE if answer else Take.OTHER
