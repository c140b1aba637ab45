"""One conversation over a link: a reader, one command at a time, and everything else.

One thread reads and offers every frame to the command that waits; what that does not
take goes to the push handler. A command is answered, refused (its ``accept`` raised),
aborted (by the push handler or a stop), timed out, or lost with the link.

After a time-out an answer may still come, and would be taken for the next command's.
The session is then *out of step*: before the next command it waits until nothing
unexpected comes any more and asks a question with a recognisable answer.
"""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

from mvp.devices.command_slot import CommandSlot
from mvp.devices.framing import EchoStripper
from mvp.devices.recording import dumping_faults
from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceTimeout,
    LinkLost,
    MvpCellError,
    WireError,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager
    from pathlib import Path

    from mvp.devices.command_slot import Accept, Ask
    from mvp.devices.context import Clock
    from mvp.devices.framing import Framer
    from mvp.devices.transport import Transport

_LOG = logging.getLogger(__name__)
_READ_S = 0.1  # how often the reader looks whether it shall end
_JOIN_S, _DRAIN_LIMIT_S = 5.0, 10.0


def _no_push(frame: bytes) -> bool:
    """Knows no unsolicited message."""
    return False


class Session:
    """A driver's conversation with its device.

    Args:
        transport: carries the bytes; opened and closed by the session.
        framer: cuts them into frames.
        clock: monotonic time and waiting.
        on_push: gets every frame that no command took, on the reader's thread. True
            when the device may say that unasked; False counts it as stray. A
            ``MvpCellError`` that it raises fails the command that waits.
        sync: asks a question with a recognisable answer through the function that it
            gets; None waits for quiet only.
        on_lost: told once when the link is lost, on the reader's thread.
        strip_echo: the link returns what is sent.
        quiet_s: silence after which no late answer is expected.
        dump_folder: where the traffic of a failed command goes; None for nowhere.
    """

    def __init__(
        self,
        transport: Transport,
        framer: Framer,
        *,
        clock: Clock,
        on_push: Callable[[bytes], bool] = _no_push,
        sync: Callable[[Ask], None] | None = None,
        on_lost: Callable[[DeviceError], None] | None = None,
        strip_echo: bool = False,
        quiet_s: float = 0.2,
        dump_folder: Path | None = None,
    ) -> None:
        self._name = transport.name
        self._transport = transport
        self._framer = framer
        self._clock = clock
        self._on_push = on_push
        self._sync = sync
        self._on_lost = on_lost
        self._echo = EchoStripper() if strip_echo else None
        self._quiet_s = quiet_s
        self._dump_folder = dump_folder
        self._lock = threading.Lock()
        self._reader: threading.Thread | None = None
        self._ending = threading.Event()
        self._slot = CommandSlot(clock, transport.name)
        self._lost: str | None = None
        self._out_of_step = False
        self._forget_partial = False
        self._stray_frames = 0
        self._last_stray_s = clock.now_s()

    @property
    def is_open(self) -> bool:
        """Whether it was opened; stays so when the link is lost, until ``close``."""
        return self._reader is not None

    @property
    def is_lost(self) -> bool:
        """Whether the link was lost since it was opened."""
        return self._lost is not None

    @property
    def out_of_step(self) -> bool:
        """Whether an answer may still come that nobody waits for."""
        return self._out_of_step

    @property
    def stray_frames(self) -> int:
        """Frames that neither a command nor the push handler knew."""
        return self._stray_frames

    @property
    def garbage_bytes(self) -> int:
        """Bytes that belonged to no frame."""
        return self._framer.garbage_bytes

    @property
    def address(self) -> str:
        """Where the link leads."""
        return self._transport.address

    def open(self) -> None:
        """Connect and begin to read; safe to repeat, opens anew after a loss.

        Raises:
            ConnectError: see ``Transport.open``.
        """
        if self._reader is not None and self._lost is None:
            return
        self.close()
        self._transport.open()
        with self._lock:
            self._lost = None
            self._out_of_step = False
            self._forget_partial = True
            self._ending = threading.Event()
            self._reader = threading.Thread(
                target=self._read,
                args=(self._ending,),
                name=f"{self._name}-reader",
                daemon=True,
            )
        self._reader.start()

    def close(self) -> None:
        """Disconnect; a command that waits fails. Safe to repeat."""
        with self._lock:
            reader, self._reader = self._reader, None
        self._ending.set()
        self._transport.close()
        if reader is not None and reader is not threading.current_thread():
            reader.join(_JOIN_S)
        self.abort(ConnectError("closed while a command waited", device=self._name))

    def request(
        self, data: bytes, accept: Accept, *, timeout_s: float, optional: bool = False
    ) -> tuple[bytes, ...]:
        """Send a command and wait for its answer; commands of other threads wait.

        Args:
            data: the bytes of the command.
            accept: told every frame until the answer is complete, on the reader's
                thread. A ``MvpCellError`` that it raises ends the command.
            timeout_s: from sending, or from the last sign of life; the wait for
                another command's end comes before it and takes at most as long.
            optional: the device may leave it unanswered; that is no error then.

        Returns:
            The frames taken as PART and DONE; none after an unanswered optional one.

        Raises:
            ConnectError: not open.
            LinkLost: the link is gone.
            DeviceTimeout: no complete answer in time; out of step from now on.
            MvpCellError: whatever ``accept`` or the push handler raised.
        """
        with self.dumping():
            self._get_ready()
            return self._exchange(data, accept, timeout_s=timeout_s, optional=optional)

    def request_until(
        self,
        data: bytes,
        accept: Accept,
        *,
        timeout_s: float,
        tries: int = 1,
        patience_s: float = 0.0,
    ) -> tuple[bytes, ...]:
        """Ask a harmless question again until it is answered.

        For disturbed lines and devices that are still booting. Never to move.

        Args:
            data: the bytes of the question.
            accept: as of ``request``.
            timeout_s: for each answer.
            tries: ask at least so often.
            patience_s: go on asking for so long.

        Raises:
            ConnectError, LinkLost: as ``request``.
            DeviceTimeout, WireError: no sensible answer in all that time.
        """
        end_s = self._clock.now_s() + patience_s
        with self.dumping():
            while True:
                tries -= 1
                try:
                    self._get_ready()
                    return self._exchange(data, accept, timeout_s=timeout_s)
                except (DeviceTimeout, WireError) as error:
                    if tries <= 0 and self._clock.now_s() >= end_s:
                        raise
                    _LOG.warning("%s: asked again", error.message)

    def send(self, data: bytes) -> None:
        """Send bytes that have no answer, at once, past a command that waits.

        Raises:
            ConnectError: not open.
            LinkLost: the link is gone.
            DeviceTimeout: the far end takes no bytes.
        """
        self._require()
        if self._echo is not None:
            self._echo.sent(data)
        try:
            self._transport.write(data)
        except LinkLost as error:
            self._lose(error)
            raise

    def abort(self, error: MvpCellError, *, in_step: bool = True) -> bool:
        """Fail the command that waits; False when none does. Any thread.

        Args:
            error: what it raises.
            in_step: False when its answer may still come.
        """
        failed = self._slot.fail(error)
        self._out_of_step = self._out_of_step or (failed and not in_step)
        self._slot.settle()
        return failed

    def fall_out_of_step(self) -> None:
        """Resynchronise before the next command: an answer may still come."""
        self._out_of_step = True

    def resync(self) -> None:
        """Wait for quiet and ask the question with the recognisable answer.

        Raises:
            ConnectError, LinkLost: not open, or gone.
            DeviceTimeout: no answer; still out of step.
            WireError: the device does not fall silent, or answers nonsense.
        """
        with self.dumping():
            self._require()
            self._step_in()

    def drain(self) -> None:
        """Wait until nothing unexpected comes any more, handling what comes.

        Raises:
            WireError: it never falls silent.
        """
        self._last_stray_s = self._clock.now_s()
        end_s = self._last_stray_s + _DRAIN_LIMIT_S
        while (
            left_s := self._last_stray_s + self._quiet_s - self._clock.now_s()
        ) > 0 and self._lost is None:
            if self._clock.now_s() > end_s:
                hint = "check shield, ground and baud"
                raise WireError("does not fall silent", device=self._name, hint=hint)
            self._clock.wait(self._ending, left_s)
        self._forget_partial = True

    def dumping(self) -> AbstractContextManager[None]:
        """Write the traffic down when a device error passes, and name the file."""
        return dumping_faults(self._transport, self._dump_folder)

    def _get_ready(self) -> None:
        """Open, not lost, and in step."""
        self._require()
        if self._out_of_step:
            self._step_in()

    def _step_in(self) -> None:
        """Get back into step."""
        _LOG.info("%s: out of step, waiting for quiet", self._name)
        self.drain()
        if self._sync is not None:
            try:
                self._sync(self._exchange)
            except DeviceTimeout:
                # Half a command in the device's buffer has swallowed the question.
                self.drain()
                self._sync(self._exchange)
        self._out_of_step = False

    def _exchange(
        self, data: bytes, accept: Accept, *, timeout_s: float, optional: bool = False
    ) -> tuple[bytes, ...]:
        """Send and wait, in step or not."""
        pending = self._slot.take(accept, timeout_s)
        answered = False
        try:
            self.send(data)
            answered = self._slot.wait(pending)
        finally:
            self._slot.release(pending)
            self._out_of_step = self._out_of_step or not (answered or optional)
        if pending.error is not None:
            raise pending.error
        if not answered and not optional:
            raise DeviceTimeout(
                f"no answer within {timeout_s:g} s",
                device=self._name,
                hint="is it switched on, and is this the right port and speed?",
            )
        return tuple(pending.frames)

    def _require(self) -> None:
        if self._reader is None:
            hint = "call open() first"
            raise ConnectError("not connected", device=self._name, hint=hint)
        if self._lost is not None:
            raise self._lost_error()

    def _lost_error(self) -> LinkLost:
        return LinkLost(
            self._lost or "the link is gone",
            device=self._name,
            hint="check cable and supply, close and open it, and home it again",
        )

    def _read(self, ending: threading.Event) -> None:
        """The reader's thread."""
        while not ending.is_set():
            try:
                data = self._transport.read(timeout_s=_READ_S)
                self._received(data)
            except DeviceError as error:
                if not ending.is_set():
                    self._lose(error)
                return
            except Exception as error:
                self._lose(WireError(f"cannot read: {error!r}", device=self._name))
                raise

    def _received(self, data: bytes) -> None:
        if self._forget_partial:
            self._forget_partial = False
            self._framer.reset()
            if self._echo is not None and not self._slot.is_taken:
                self._echo.reset()
        if self._echo is not None:
            data = self._echo.feed(data)
        if not data:
            return
        garbage = self._framer.garbage_bytes
        for frame in self._framer.feed(data):
            self._dispatch(frame)
        if self._framer.garbage_bytes != garbage:
            self._last_stray_s = self._clock.now_s()
        self._slot.settle()

    def _dispatch(self, frame: bytes) -> None:
        """Offer a frame to the command that waits, then to the push handler."""
        try:
            if not self._slot.offer(frame) and not self._on_push(frame):
                self._stray(frame)
        except MvpCellError as error:
            self._slot.fail(error)

    def _stray(self, frame: bytes) -> None:
        _LOG.info("%s: nobody waits for %r", self._name, frame)
        self._stray_frames += 1
        self._last_stray_s = self._clock.now_s()

    def _lose(self, error: DeviceError) -> None:
        """Note that the link is gone; tell whoever waits, and the driver, once."""
        said = error.message.removeprefix(f"{self._name}: ")
        with self._lock:
            first, self._lost = self._lost is None, said
        self.abort(self._lost_error())
        if first:
            _LOG.warning("%s: %s", self._name, said)
        if first and self._on_lost is not None:
            self._on_lost(error)
