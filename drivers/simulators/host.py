"""Runs a byte machine in a thread behind a port that a driver can open.

A machine is pure: bytes and a time go in, bytes come out. It can be stepped by hand
with a made-up clock; here it lives on the real one.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Protocol

import numpy as np

from drivers.simulators.line_ends import LineEnd, PtyEnd, TcpEnd
from drivers.simulators.noise import Due, Noise, NoisyLine

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.random import Generator

    from drivers.simulators.control import Verb

_LOG = logging.getLogger(__name__)
_TICK_S = 0.002
_BITS_PER_BYTE = 10


class Machine(Protocol):
    """A device as seen from its wire: no ports, no threads, no clock of its own."""

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the host."""
        ...

    def tick(self, now_s: float) -> None:
        """Let time pass up to ``now_s``; never earlier than before."""
        ...

    def take_output(self) -> bytes:
        """What it said since it was last asked."""
        ...


class SerialHost:
    """A machine behind a port.

    A machine that has a method ``opened(now_s)`` is told when a host opens the port
    (boards that restart then), and one that has ``power_up(now_s)`` when it is plugged
    in again.

    Args:
        machine: only touched under ``lock`` once it runs.
        listen: ``"pty"`` or ``"127.0.0.1:<port>"``; port 0 takes any.
        noise: of the line.
        rng: of the noise.
        baud: bits per second that bytes are paced with; None for no pacing.
        name: of the device.
    """

    def __init__(
        self,
        machine: Machine,
        *,
        listen: str = "pty",
        noise: Noise | None = None,
        rng: Generator | None = None,
        baud: int | None = None,
        name: str = "device",
    ) -> None:
        self.lock = threading.RLock()
        self._machine = machine
        self._listen = listen
        self._name = name
        self._line = NoisyLine(
            noise or Noise(),
            np.random.default_rng(0) if rng is None else rng,
            byte_s=_BITS_PER_BYTE / baud if baud else 0.0,
        )
        self._end: LineEnd | None = None
        self._to_device: deque[Due] = deque()
        self._to_host: deque[Due] = deque()
        self._to_do: deque[tuple[Callable[[LineEnd], None], threading.Event]] = deque()
        self._was_connected = False
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None
        self._failure: Exception | None = None

    @property
    def address(self) -> str:
        """What a driver gets as its ``port``; empty when it does not run."""
        return self._end.address if self._end is not None else ""

    @property
    def connected(self) -> bool:
        """Whether a host had the port open when the thread last looked.

        A pseudo-terminal that is closed and opened again within a few milliseconds is
        not seen to have been closed.
        """
        return self._end is not None and self._was_connected

    def start(self) -> str:
        """Appear on the port and run; the address. Safe to repeat.

        Raises:
            OSError: no port left.
        """
        if self._end is None:
            self._end = self._new_end()
            self._end.plug_in()
            self._ending.clear()
            self._thread = threading.Thread(
                target=self._run, args=(self._end,), name=f"simulator-{self._name}"
            )
            self._thread.start()
        return self._end.address

    def stop(self) -> None:
        """Disappear; safe to repeat.

        Raises:
            Exception: what the machine raised while it ran, a bug in it.
        """
        self._ending.set()
        if self._thread is not None:
            self._thread.join()
        if self._end is not None:
            self._end.close()
        self._thread = self._end = None
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def set_noise(self, noise: Noise) -> None:
        """Make the line better or worse from now on."""
        with self.lock:
            self._line.noise = noise

    def unplug(self, *, reset: bool = False) -> None:
        """Pull the cable; what is under way is lost. Not under ``lock``."""
        self._have_done(lambda end: self._pull_out(end, reset=reset))

    def replug(self) -> None:
        """Plug the cable in again and switch the machine on. Not under ``lock``."""
        self._have_done(self._plug_in)

    def say(self, data: bytes) -> None:
        """Put bytes on the line that the machine never said."""
        with self.lock:
            self._to_host += self._line.to_host(data, time.monotonic())

    def verbs(self) -> dict[str, Verb]:
        """What the fault channel can do to any line.

        ``noise`` (keys of ``Noise``), ``unplug`` (``reset``), ``replug``, ``say``
        (``hex``), ``hold_next`` (``seconds``, ``count``) and ``drop_next`` (``count``).
        """
        return {
            "noise": self.locked(self._set_noise),
            "unplug": lambda a: self.unplug(reset=bool(a.get("reset"))),
            "replug": lambda a: self.replug(),
            "say": self.locked(lambda a: self.say(bytes.fromhex(str(a["hex"])))),
            "hold_next": self.locked(
                lambda a: self._line.hold_next(
                    float(str(a["seconds"])), count=int(str(a.get("count", 1)))
                )
            ),
            "drop_next": self.locked(
                lambda a: self._line.drop_next(int(str(a["count"])))
            ),
        }

    def locked(
        self, verb: Callable[[Mapping[str, object]], Mapping[str, object] | None]
    ) -> Verb:
        """A verb that has the machine for itself while it runs."""

        def under_lock(asked: Mapping[str, object]) -> Mapping[str, object] | None:
            with self.lock:
                return verb(asked)

        return under_lock

    def _have_done(self, what: Callable[[LineEnd], None]) -> None:
        """Let the thread do something to its end of the line, and wait for it."""
        thread = self._thread
        if thread is None:
            return
        done = threading.Event()
        self._to_do.append((what, done))
        while thread.is_alive() and not done.wait(_TICK_S * 10):
            pass

    def _pull_out(self, end: LineEnd, *, reset: bool) -> None:
        end.pull_out(reset=reset)
        self._to_device.clear()
        self._to_host.clear()

    def _plug_in(self, end: LineEnd) -> None:
        end.plug_in()
        tell(self._machine, "power_up", time.monotonic())

    def _set_noise(self, asked: Mapping[str, object]) -> None:
        self.set_noise(Noise.model_validate(dict(asked)))

    def _new_end(self) -> LineEnd:
        if self._listen == "pty":
            return PtyEnd(self._name)
        host, _, port = self._listen.rpartition(":")
        if host != "127.0.0.1":
            raise ValueError(f"{self._listen!r} is not on 127.0.0.1")
        return TcpEnd(int(port))

    def _run(self, end: LineEnd) -> None:
        """The thread: bytes in, time on, bytes out.

        A machine with a bug leaves the port: silence would look like a fault that was
        meant.
        """
        try:
            while not self._ending.is_set():
                data = end.receive(_TICK_S)
                with self.lock:
                    self._step(end, data, time.monotonic())
                    self._do_what_is_asked(end)
        except Exception as error:
            _LOG.exception("the simulated %s broke down", self._name)
            self._failure = error
            end.pull_out()

    def _do_what_is_asked(self, end: LineEnd) -> None:
        while self._to_do:
            what, done = self._to_do.popleft()
            what(end)
            done.set()

    def _step(self, end: LineEnd, data: bytes, now_s: float) -> None:
        connected = end.connected
        if connected and not self._was_connected:
            tell(self._machine, "opened", now_s)
            self._to_host += self._line.opening(now_s)
        self._was_connected = connected
        if data:
            self._to_host += self._line.echoed(data, now_s)
            self._to_device += self._line.to_device(data, now_s)
        while self._to_device and self._to_device[0].at_s <= now_s:
            self._machine.receive(self._to_device.popleft().data, now_s)
        self._machine.tick(now_s)
        self._to_host += self._line.to_host(self._machine.take_output(), now_s)
        while self._to_host and self._to_host[0].at_s <= now_s:
            piece = self._to_host.popleft().data
            if connected:
                end.send(piece)


def tell(machine: Machine, what: str, now_s: float) -> None:
    """Call an optional method of the machine."""
    method = getattr(machine, what, None)
    if method is not None:
        method(now_s)
