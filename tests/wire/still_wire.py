"""A wire in memory and a clock that stands still while anything is on its way.

A driver that waits for what never comes has waited at once, however long its deadline:
conversations by the hundred thousand, and the same each time.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING

from mvp.errors import LinkLost

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.devices import Transport, TransportConfig

_STUCK_S = 60.0


class StillWire:
    """A ``Transport`` whose other end is a function, and the ``Clock`` that fits it.

    Args:
        answer: gets every write and returns what comes back at once.
    """

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self.name = "still"
        self.address = "memory"
        self.answer = answer
        self._changed = threading.Condition()
        self._incoming: deque[bytes] = deque()
        self._open = False
        self._reading = False
        self._now_s = 1000.0

    def as_link(self, config: TransportConfig, name: str) -> Transport:
        """For ``DeviceContext.transports``."""
        del config
        self.name = name
        return self

    def open(self) -> None:
        """Connect."""
        self._open = True

    def close(self) -> None:
        """Disconnect."""
        with self._changed:
            self._open = False
            self._incoming.clear()
            self._changed.notify_all()

    def write(self, data: bytes) -> None:
        """Keep the function's answer for reading."""
        self.say(self.answer(data))

    def say(self, data: bytes) -> None:
        """Send something that nobody asked for."""
        with self._changed:
            if data:
                self._incoming.append(data)
                self._changed.notify_all()

    def read(self, *, timeout_s: float) -> bytes:
        """What was said."""
        with self._changed:
            self._reading = True
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._incoming or not self._open, timeout_s)
            self._reading = False
            if not self._open:
                raise LinkLost("closed", device=self.name)
            return self._incoming.popleft() if self._incoming else b""

    def now_s(self) -> float:
        """Time that passes only while somebody waits."""
        return self._now_s

    def wait(self, event: threading.Event, seconds: float) -> bool:
        """Until everything that was said has been read; then the time is over."""
        with self._changed:
            if not self._changed.wait_for(self._is_quiet, _STUCK_S):
                raise RuntimeError("the reader does not come back")
        if event.is_set():
            return True
        self._now_s += max(seconds, 1e-4)
        return False

    def _is_quiet(self) -> bool:
        return not self._open or (self._reading and not self._incoming)
