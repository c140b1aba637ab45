"""A TCP server on 127.0.0.1 whose connections are read line by line, and all end with it."""

from __future__ import annotations

import contextlib
import socket
import socketserver
import threading
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

LOOPBACK = "127.0.0.1"
_LINE_MAX = 65536


class Outlet(Protocol):
    """Where an answer is written."""

    def write(self, data: bytes, /) -> object:
        """Send all of it."""
        ...


class LineServer:
    """Serves from threads of its own, one per connection, until stopped.

    Args:
        handle: gets each line and where to write the answer.
        name: of the thread.
        port: 0 takes any.

    Raises:
        OSError: the port is taken.
    """

    def __init__(
        self, handle: Callable[[bytes, Outlet], None], *, name: str, port: int = 0
    ) -> None:
        self._server = _Server(handle, port)
        self._thread = threading.Thread(
            target=self._server.serve_forever,
            kwargs={"poll_interval": 0.05},
            name=name,
        )
        self._thread.start()

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._server.server_address[1])

    def stop(self) -> None:
        """Stop listening and close every connection."""
        self._server.shutdown()
        self._server.hang_up()
        self._server.server_close()
        self._thread.join()


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = False

    def __init__(self, handle: Callable[[bytes, Outlet], None], port: int) -> None:
        self.handle = handle
        self._turn = threading.Lock()
        self._connections: set[socket.socket] = set()
        super().__init__((LOOPBACK, port), _Handler)

    def keep(self, connection: socket.socket) -> None:
        with self._turn:
            self._connections.add(connection)

    def forget(self, connection: socket.socket) -> None:
        with self._turn:
            self._connections.discard(connection)

    def hang_up(self) -> None:
        """Wake the threads that wait for a line."""
        with self._turn:
            for connection in self._connections:
                with contextlib.suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)


class _Handler(socketserver.StreamRequestHandler):
    server: _Server

    def setup(self) -> None:
        super().setup()
        self.server.keep(self.connection)

    def handle(self) -> None:
        with contextlib.suppress(OSError):
            while line := self.rfile.readline(_LINE_MAX):
                self.server.handle(line, self.wfile)

    def finish(self) -> None:
        self.server.forget(self.connection)
        with contextlib.suppress(OSError):
            super().finish()
