r"""A link in memory: a driver is tested by the table of what it sends and is answered.

::

    far_end = FarEnd("lens", lambda sent: {b"$S\n": b"1.0, A, B, C\r\n"}.get(sent, b""))
    context = DeviceContext(transports=far_end.as_link)
"""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING

from mvp.errors import LinkLost

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.devices import Transport, TransportConfig


class FarEnd:
    """A ``Transport`` whose other end is a function.

    Args:
        name: of the device.
        answer: gets every write and returns what comes back at once.

    Attributes:
        answer: the function; may be replaced at any time.
        sent: every write, in order.
        unplugged: set it to lose the link.
    """

    def __init__(self, name: str, answer: Callable[[bytes], bytes]) -> None:
        self.name = name
        self.sent: list[bytes] = []
        self.unplugged = False
        self.answer = answer
        self._changed = threading.Condition()
        self._incoming: deque[bytes] = deque()
        self._open = False
        self._reading = False

    @property
    def address(self) -> str:
        """Says that it is no port."""
        return "memory"

    def as_link(self, config: TransportConfig, name: str) -> Transport:
        """For ``DeviceContext.transports``; port and speed mean nothing here."""
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
        """Hand to the function, and keep its answer for reading.

        Raises:
            LinkLost: unplugged or not open.
        """
        self._require()
        self.sent.append(data)
        self.say(self.answer(data))

    def say(self, data: bytes) -> None:
        """Send something that nobody asked for."""
        with self._changed:
            if data:
                self._incoming.append(data)
            self._changed.notify_all()

    def unplug(self) -> None:
        """Lose the link."""
        with self._changed:
            self.unplugged = True
            self._changed.notify_all()

    def read(self, *, timeout_s: float) -> bytes:
        """What was said.

        Raises:
            LinkLost: unplugged or not open.
        """
        with self._changed:
            self._reading = True
            self._changed.notify_all()
            self._changed.wait_for(
                lambda: self._incoming or self.unplugged or not self._open, timeout_s
            )
            self._reading = False
            self._require()
            return self._incoming.popleft() if self._incoming else b""

    def wait_heard(self, timeout_s: float) -> bool:
        """Until everything that was said has been read, and somebody waits for more.

        Returns:
            False when that did not come about in time.
        """
        with self._changed:
            return self._changed.wait_for(
                lambda: not self._open or (self._reading and not self._incoming),
                timeout_s,
            )

    def _require(self) -> None:
        if self.unplugged or not self._open:
            raise LinkLost("the link memory is gone", device=self.name)
