"""The dashboard: one line out, one line back. A second way to a robot, also to stop it."""

from __future__ import annotations

import contextlib
import socket
from typing import TYPE_CHECKING, Self

from mvp.errors import ConnectError, DeviceTimeout, LinkLost, WireError

if TYPE_CHECKING:
    from mvp.devices import Clock

PORT = 29999
_LINE_MAX = 1024


class Dashboard:
    """One connection; not for several threads.

    Args:
        host: of the controller.
        name: of the device, for errors.
        clock: real time; sockets know no other.
        timeout_s: for connecting, and for every answer.
    """

    def __init__(
        self, host: str, *, name: str, clock: Clock, timeout_s: float = 1.0
    ) -> None:
        self._host = host
        self._clock = clock
        self._name = name
        self._timeout_s = timeout_s
        self._socket: socket.socket | None = None
        self._buffer = b""

    def __enter__(self) -> Self:
        """Connect and read the greeting.

        Raises:
            ConnectError: nobody there.
            DeviceTimeout, LinkLost, WireError: no greeting.
        """
        self._connect()
        try:
            self._line()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *exc: object) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.close()
            self._socket = None

    def ask(self, command: str) -> str:
        """The one line that answers a command.

        Raises:
            LinkLost, DeviceTimeout, WireError: no line came back.
        """
        self._send(command)
        return self._line()

    def value(self, command: str) -> str:
        """The part of the answer after its colon."""
        answer = self.ask(command)
        return answer.partition(":")[2].strip() if ":" in answer else answer

    def end_program(self) -> bool:
        """End whatever program runs; whether the robot says that it has.

        Asks before it listens: a robot that cannot answer any more may still obey. Not
        to be used inside a with statement.

        Raises:
            ConnectError, LinkLost, DeviceTimeout, WireError: it may not have heard.
        """
        self._connect()
        try:
            self._send("stop")
            self._line()
            return self._line() == "Stopped"
        finally:
            self.__exit__()

    @property
    def _connected(self) -> socket.socket:
        if self._socket is None:
            raise ValueError("a dashboard is used in a with statement")
        return self._socket

    def _connect(self) -> None:
        address = (self._host, PORT)
        try:
            self._socket = socket.create_connection(address, self._timeout_s)
        except OSError as error:
            raise ConnectError(
                f"the robot's dashboard at {self._host}:{PORT} does not answer "
                f"({error})",
                device=self._name,
                hint="is the controller on, is host in [arm] right, and is the "
                "dashboard server enabled in its security settings?",
            ) from error
        self._buffer = b""

    def _send(self, command: str) -> None:
        try:
            self._connected.sendall(command.encode() + b"\n")
        except OSError as error:
            raise LinkLost(
                f"the dashboard is gone: {error}", device=self._name
            ) from error

    def _line(self) -> str:
        deadline = self._clock.now_s() + self._timeout_s
        while b"\n" not in self._buffer:
            self._buffer += self._some(deadline)
            if len(self._buffer) > _LINE_MAX:
                raise WireError("the dashboard sends no line end", device=self._name)
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.decode(errors="replace").strip()

    def _some(self, deadline: float) -> bytes:
        try:
            self._connected.settimeout(max(1e-3, deadline - self._clock.now_s()))
            found = self._connected.recv(_LINE_MAX)
        except TimeoutError as error:
            raise DeviceTimeout(
                f"the robot's dashboard does not answer within {self._timeout_s:g} s",
                device=self._name,
                hint="restart the controller if this stays",
            ) from error
        except OSError as error:
            raise LinkLost(
                f"the dashboard is gone: {error}", device=self._name
            ) from error
        if not found:
            raise LinkLost("the dashboard hung up", device=self._name)
        return found
