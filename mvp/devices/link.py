"""What every driver keeps by composition: being connected, and one action at a time."""

from __future__ import annotations

import logging
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from mvp.errors import ConnectError, DeviceFault

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from mvp.devices.context import Clock

_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)


class Link:
    """Connection of one device, and the action it is busy with.

    A driver holds one and hands ``open``, ``close`` and ``stop`` on to it; what it takes
    to connect and disconnect stays in the driver.

    Args:
        name: of the device, for errors and log lines.
        clock: what waiting is measured with.
        connect: makes the connection, or raises; moves nothing.
        disconnect: stops what still moves and ends the connection.
    """

    def __init__(
        self,
        name: str,
        clock: Clock,
        *,
        connect: Callable[[], None],
        disconnect: Callable[[], None],
    ) -> None:
        self._name = name
        self._clock = clock
        self._connect = connect
        self._disconnect = disconnect
        self._lock = threading.Lock()
        self._interrupted = threading.Event()
        self._open = False
        self._busy = False

    @property
    def is_open(self) -> bool:
        """Whether the device is connected."""
        return self._open

    @property
    def interrupted(self) -> bool:
        """Whether the last action was cut short."""
        return self._interrupted.is_set()

    def open(self) -> None:
        """Connect, unless connected already.

        Raises:
            Whatever ``connect`` raises; it is not connected then.
        """
        if self._open:
            return
        self._connect()
        self._open = True
        _LOG.info("%s: connected", self._name)

    def close(self) -> None:
        """Disconnect, unless disconnected already; closed even when that fails."""
        if not self._open:
            return
        try:
            self._disconnect()
        finally:
            self._open = False
            _LOG.info("%s: disconnected", self._name)

    def require_open(self) -> None:
        """Raise ``ConnectError`` unless connected."""
        if not self._open:
            raise ConnectError(
                "not connected", device=self._name, hint="call open() first"
            )

    @contextmanager
    def busy(self, begin: Callable[[], _T]) -> Iterator[_T]:
        """Begin an action and stay busy with it; ``interrupt`` reaches it from then on.

        Args:
            begin: hands the action to the device and returns at once; it holds a lock
                that ``interrupt`` needs.

        Raises:
            DeviceFault: another action is in progress.
        """
        with self._lock:
            if self._busy:
                raise DeviceFault(
                    "another action is in progress already", device=self._name
                )
            self._interrupted.clear()
            # Under the lock: a stop cannot fall between the start and being busy.
            started = begin()
            self._busy = True
        try:
            yield started
        finally:
            with self._lock:
                self._busy = False

    def interrupt(self) -> bool:
        """Cut the action in progress short, from any thread; False when there is none."""
        with self._lock:
            reached = self._busy
            if reached:
                self._interrupted.set()
        if reached:
            _LOG.info("%s: told to stop while busy", self._name)
        return reached

    def wait_until(self, moment_s: float) -> bool:
        """Wait for a moment of the clock; False when interrupted."""
        while (left := moment_s - self._clock.now_s()) > 0:
            if self._clock.wait(self._interrupted, left):
                return False
        return True
