"""The driver's end of its worker process: requests with deadlines, and its death."""

from __future__ import annotations

import contextlib
import logging
import signal
import subprocess
import sys
import threading
from collections import deque
from typing import TYPE_CHECKING

from drivers._ur.codes import connect_failure
from drivers._ur.messages import LONGEST, Message, decode, encode
from drivers._ur.status import Freshness, Implausible, Status
from mvp.errors import ConnectError, DeviceError, DeviceFault, DeviceTimeout, LinkLost

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import BinaryIO

    from mvp.devices import Clock

_LOG = logging.getLogger(__name__)
_START_S = 20.0
_GONE_S = 2.0
_TAIL = 5
_CONNECTING = ("listen", "control")
COMMAND = (sys.executable, "-P", "-m", "drivers._ur.worker")


class Pending:
    """A request under way."""

    def __init__(self, do: str) -> None:
        self.do = do
        self.arrived = threading.Event()
        self.message: Message = {}

    def done(self) -> bool:
        """Whether the answer is here, or will never come."""
        return self.arrived.is_set()


class WorkerProcess:
    """One worker; ends for good when it is closed, killed or dies.

    Args:
        name: of the device, for errors.
        clock: what ages are measured with.
        command: what to start.
    """

    def __init__(
        self, name: str, clock: Clock, *, command: Sequence[str] = COMMAND
    ) -> None:
        self._name = name
        self._clock = clock
        self._lock = threading.Lock()
        self._pending: dict[int, Pending] = {}
        self._count = 0
        self._dead = ""
        self._hello = threading.Event()
        self._status: Status | None = None
        self._freshness = Freshness()
        self._words: deque[str] = deque(maxlen=_TAIL)
        self._process = subprocess.Popen(
            list(command),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        self._threads = [
            threading.Thread(target=run, name=f"{name}-worker-{what}", daemon=True)
            for what, run in (("answers", self._read), ("words", self._listen))
        ]
        for thread in self._threads:
            thread.start()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it can still be asked."""
        return not self._dead

    def wait_started(self) -> None:
        """Wait for its first word.

        Raises:
            ConnectError: it does not start.
        """
        if self._hello.wait(_START_S) and self.alive:
            return
        why = self._dead or f"said nothing for {_START_S:.0f} s"
        self.kill("did not start")
        raise ConnectError(
            f"the process for the robot's client library does not start: {why}",
            device=self._name,
            hint="is ur-rtde installed for this Python? `pip install ur-rtde`",
        )

    def status(self) -> tuple[Status, float]:
        """The newest state of the robot and its age, s.

        Raises:
            LinkLost: the worker is gone, or has not seen a state yet.
        """
        self.require_alive()
        with self._lock:
            found, age_s = self._status, self._freshness.age_s(self._clock.now_s())
        if found is None:
            raise LinkLost("no state of the robot yet", device=self._name)
        return found, age_s

    def post(self, do: str, **arguments: object) -> Pending:
        """Send a request and return at once.

        Raises:
            LinkLost: the worker is gone.
        """
        self.require_alive()
        pending = Pending(do)
        with self._lock:
            self._count += 1
            self._pending[self._count] = pending
            line = encode({"id": self._count, "do": do, **arguments})
            try:
                self._input.write(line)
                self._input.flush()
            except OSError as error:
                raise self._lost(f"its pipe is closed ({error})") from error
        if not self.alive:
            pending.arrived.set()
        return pending

    def result(self, pending: Pending) -> Message:
        """The answer of a request that is done.

        Raises:
            LinkLost: the worker died before it answered.
            DeviceError: the client library refused; by its words.
        """
        said = pending.message
        if not said:
            self.require_alive()
        if said.get("ok"):
            return said
        words = str(said.get("message"))
        if pending.do in _CONNECTING:
            raise connect_failure(words, self._name)
        raise DeviceFault(
            f"the client library refused {pending.do!r}: {words}",
            device=self._name,
            code="library",
            hint="`mvp-cell check CELL` connects anew",
        )

    def request(self, do: str, *, timeout_s: float, **arguments: object) -> Message:
        """Ask and wait; a worker that does not answer in time is killed.

        Raises:
            DeviceTimeout: no answer in time.
            LinkLost, DeviceError: as for ``result``.
        """
        pending = self.post(do, **arguments)
        if not pending.arrived.wait(timeout_s):
            self.kill(f"{do!r} was not answered within {timeout_s:g} s")
            raise DeviceTimeout(
                f"the robot's client library did not answer {do!r} "
                f"within {timeout_s:g} s",
                device=self._name,
                hint="is the network healthy and the controller not overloaded? "
                "`mvp-cell check CELL` connects anew",
            )
        return self.result(pending)

    def require_alive(self) -> None:
        """Raise ``LinkLost`` with the reason when the worker is gone."""
        if self._dead:
            raise self._lost(self._dead)

    def kill(self, why: str) -> None:
        """End the process now, by its number; safe to repeat."""
        self._mark_dead(why)
        with contextlib.suppress(OSError):
            self._process.kill()
        self._reap()

    def close(self, *, timeout_s: float, deceleration_rad_s2: float) -> bool:
        """Let it leave the robot standing without a program; killed if it does not.

        Returns:
            Whether it said that it has.
        """
        left = False
        if self.alive:
            with contextlib.suppress(DeviceError):
                pending = self.post("leave", deceleration_rad_s2=deceleration_rad_s2)
                pending.arrived.wait(timeout_s)
                left = bool(pending.message.get("over"))
        self.kill("closed")
        return left

    @property
    def _input(self) -> BinaryIO:
        return _pipe(self._process.stdin)

    def _lost(self, why: str) -> LinkLost:
        return LinkLost(
            f"the link to the robot is gone: {why}",
            device=self._name,
            hint="check network and controller; nothing is sent again by itself",
        )

    def _reap(self) -> None:
        """Leave no process, thread or pipe behind."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_GONE_S)
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(_GONE_S)
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            with contextlib.suppress(OSError):
                _pipe(pipe).close()

    def _read(self) -> None:
        """Sort what the worker says until it ends."""
        try:
            for line in iter(lambda: self._output_line(), b""):
                self._sort(decode(line))
        except (ValueError, TypeError, OSError) as error:
            self._mark_dead(f"its worker said what makes no sense ({error})")
        self._mark_dead(self._last_words())

    def _output_line(self) -> bytes:
        return _pipe(self._process.stdout).readline(LONGEST)

    def _sort(self, message: Message) -> None:
        if "status" in message and "id" not in message:
            self._note(Status.from_wire(_mapping(message["status"])))
        elif "lost" in message:
            self._mark_dead(str(message["lost"]))
        elif "hello" in message:
            self._hello.set()
        else:
            self._hand_over(message)

    def _hand_over(self, message: Message) -> None:
        if "status" in message:
            self._note(Status.from_wire(_mapping(message["status"])))
        with self._lock:
            pending = self._pending.pop(int(str(message.get("id", 0))), None)
        if pending is not None:
            pending.message = message
            pending.arrived.set()

    def _note(self, status: Status) -> None:
        with self._lock:
            self._freshness.note(status.t_controller_s, self._clock.now_s())
            self._status = status

    def _mark_dead(self, why: str) -> None:
        """The first reason counts; whoever waits is woken."""
        if not self._dead:
            self._dead = why
            _LOG.info("%s: worker %d: %s", self._name, self.pid, why)
        with self._lock:
            waiting, self._pending = list(self._pending.values()), {}
        for pending in waiting:
            pending.arrived.set()
        self._hello.set()

    def _listen(self) -> None:
        """Keep the last lines of the library's chatter for the log."""
        with contextlib.suppress(OSError, ValueError):
            for line in _pipe(self._process.stderr):
                text = line.decode(errors="replace").strip()
                self._words.append(text)
                _LOG.debug("%s: worker %d: %s", self._name, self.pid, text)

    def _last_words(self) -> str:
        """How the process ended."""
        try:
            code = self._process.wait(_GONE_S)
        except subprocess.TimeoutExpired:
            return "its worker closed its pipe"
        words = f" ({self._words[-1]})" if self._words else ""
        if code < 0:
            return f"its worker was ended by {_signal_name(-code)}{words}"
        return f"its worker ended with code {code}{words}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _pipe(pipe: object) -> BinaryIO:
    if pipe is None:
        raise ValueError("the worker was started without pipes")
    return pipe  # type: ignore[return-value]


def _mapping(value: object) -> Message:
    if not isinstance(value, dict):
        raise Implausible("a status that is no object")
    return value
