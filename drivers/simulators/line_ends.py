"""Where a simulated device is plugged in: a pseudo-terminal or a TCP port."""

from __future__ import annotations

import errno
import os
import pty
import select
import socket
import struct
import time
import tty
from contextlib import suppress
from typing import Protocol

from drivers.simulators.leftovers import OwnFolder

LOOPBACK = "127.0.0.1"
_CHUNK = 4096


class LineEnd(Protocol):
    """The device's end of a line that a host can open."""

    @property
    def address(self) -> str:
        """What a driver gets as its ``port``; the same after being plugged in again."""
        ...

    @property
    def connected(self) -> bool:
        """Whether a host has it open."""
        ...

    def plug_in(self) -> None:
        """Appear; safe to repeat.

        Raises:
            OSError: no port left.
        """
        ...

    def pull_out(self, *, reset: bool = False) -> None:
        """Disappear, abruptly if the line can tell; safe to repeat."""
        ...

    def close(self) -> None:
        """Disappear for good."""
        ...

    def receive(self, timeout_s: float) -> bytes:
        """What the host sent; empty when nothing came in time."""
        ...

    def send(self, data: bytes) -> None:
        """Give bytes to the host; lost when it does not listen."""
        ...


class PtyEnd:
    """A raw pseudo-terminal under a stable name.

    The name is a link: being plugged in again gives a new terminal under the old name,
    as links by identity do for real ports.
    """

    def __init__(self, name: str) -> None:
        self._folder = OwnFolder()
        self._link = self._folder.path / name
        self._master = -1

    @property
    def address(self) -> str:
        """Path of the link."""
        return str(self._link)

    @property
    def connected(self) -> bool:
        """Whether a host has the terminal open."""
        if self._master < 0:
            return False
        return not self._poll(0.0) & select.POLLHUP

    def plug_in(self) -> None:
        """Make a terminal and point the link at it."""
        if self._master >= 0:
            return
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(os.ttyname(slave))
        # Only after the other side was closed once does the terminal say that it is.
        os.close(slave)

    def pull_out(self, *, reset: bool = False) -> None:
        """Close the terminal; the host reads an error."""
        del reset
        self._link.unlink(missing_ok=True)
        master, self._master = self._master, -1
        if master >= 0:
            os.close(master)

    def close(self) -> None:
        """Take the link away, too."""
        self.pull_out()
        self._folder.remove()

    def receive(self, timeout_s: float) -> bytes:
        """What the host sent."""
        if self._master < 0:
            time.sleep(timeout_s)
            return b""
        event = self._poll(timeout_s)
        if event & select.POLLIN:
            with suppress(OSError):
                return os.read(self._master, _CHUNK)
        if event & select.POLLHUP:
            time.sleep(timeout_s)
        return b""

    def send(self, data: bytes) -> None:
        """Give bytes to the host; lost when its buffer is full."""
        with suppress(OSError):
            os.write(self._master, data)

    def _poll(self, timeout_s: float) -> int:
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        events = poll.poll(timeout_s * 1000)
        return events[0][1] if events else 0


class TcpEnd:
    """A TCP port of this machine for one host at a time."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None

    @property
    def address(self) -> str:
        """``socket://127.0.0.1:port``."""
        return f"socket://{LOOPBACK}:{self._port}"

    @property
    def connected(self) -> bool:
        """Whether a host is connected."""
        return self._client is not None

    def plug_in(self) -> None:
        """Listen."""
        if self._listener is None:
            self._listener = socket.create_server((LOOPBACK, self._port), backlog=1)
            self._port = self._listener.getsockname()[1]

    def pull_out(self, *, reset: bool = False) -> None:
        """Hang up and listen no more."""
        self._hang_up(reset=reset)
        listener, self._listener = self._listener, None
        if listener is not None:
            listener.close()

    def close(self) -> None:
        """Hang up and listen no more."""
        self.pull_out()

    def receive(self, timeout_s: float) -> bytes:
        """What the host sent; takes a new host in when there is none."""
        waits_for = self._client or self._listener
        if waits_for is None:
            time.sleep(timeout_s)
            return b""
        if not select.select([waits_for], [], [], timeout_s)[0]:
            return b""
        if self._client is None:
            self._accept()
            return b""
        try:
            data = self._client.recv(_CHUNK)
        except OSError:
            data = b""
        if not data:
            self._hang_up(reset=False)
        return data

    def send(self, data: bytes) -> None:
        """Give bytes to the host; lost when it does not take them."""
        if self._client is not None:
            with suppress(OSError):
                self._client.sendall(data)

    def _accept(self) -> None:
        if self._listener is None:
            return
        try:
            self._client, _ = self._listener.accept()
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.ECONNABORTED):
                raise
            return
        self._client.settimeout(1.0)
        self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _hang_up(self, *, reset: bool) -> None:
        client, self._client = self._client, None
        if client is None:
            return
        if reset:
            # With no time to linger, closing sends RST instead of FIN.
            client.setsockopt(
                socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0)
            )
        client.close()
