"""Bytes over a serial port and over TCP."""

from __future__ import annotations

import errno
import logging
import os
import select
import socket
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

from mvp.devices.ports import holders_of, resolve_port
from mvp.errors import ConnectError, DeviceTimeout, LinkLost

if TYPE_CHECKING:
    from serial import Serial

_LOG = logging.getLogger(__name__)
_CHUNK = 4096
_WRITE_TIMEOUT_S = 1.0
_IN_USE = (errno.EAGAIN, errno.EACCES, errno.EBUSY)


class SerialTransport:
    """A serial port, opened for this program alone.

    Args:
        name: of the device, for messages.
        port: path, name in /dev/serial/by-id or ``vid:pid[:serial]``.
        baud: bits per second; 8 data bits, no parity, 1 stop bit, no flow control.
        dtr: level of the line while open.
        rts: level of the line while open.
        low_latency: ask the adapter not to collect short answers.
    """

    def __init__(
        self,
        name: str,
        port: str,
        *,
        baud: int = 115200,
        dtr: bool = True,
        rts: bool = True,
        low_latency: bool = True,
    ) -> None:
        self.name = name
        self._port = port
        self._baud = baud
        self._dtr = dtr
        self._rts = rts
        self._low_latency = low_latency
        self._serial: Serial | None = None
        self._sending = threading.Lock()

    @property
    def address(self) -> str:
        """The port as configured."""
        return self._port

    def open(self) -> None:
        """Take the port; safe to repeat.

        Raises:
            ConnectError: no such port, no right to use it, or another program has it.
        """
        if self._serial is not None:
            return
        from serial import SerialException

        path = resolve_port(self._port, device=self.name)
        try:
            self._serial = self._opened(path)
        except (SerialException, OSError, ValueError) as error:
            raise self._refused(path, error) from error
        _LOG.info("%s: opened %s", self.name, path)

    def close(self) -> None:
        """Give the port back; safe to repeat."""
        line, self._serial = self._serial, None
        if line is None:
            return
        # An unplugged port raises while it is closed; it is gone all the same.
        with suppress(Exception):
            line.close()
        _LOG.info("%s: closed %s", self.name, self._port)

    def write(self, data: bytes) -> None:
        """Send in one piece.

        Raises:
            DeviceTimeout: the far end takes no bytes.
            LinkLost: unplugged, or not open.
        """
        import termios

        from serial import SerialException, SerialTimeoutException

        line = self._line()
        try:
            with self._sending:
                line.write(data)
        except SerialTimeoutException as error:
            raise _takes_nothing(self.name, self._port) from error
        except (SerialException, OSError, termios.error, TypeError) as error:
            raise _gone(self.name, self._port, error) from error

    def read(self, *, timeout_s: float) -> bytes:
        """Whatever has come, at least one byte; empty when nothing came in time.

        Raises:
            LinkLost: unplugged, or not open.
        """
        try:
            handle = self._line().fileno()
            if not _is_readable(handle, timeout_s):
                return b""
            data = os.read(handle, _CHUNK)
        except BlockingIOError:
            return b""
        except (OSError, ValueError, TypeError) as error:
            raise _gone(self.name, self._port, error) from error
        if not data:
            raise _gone(self.name, self._port, "it reads as ended")
        return data

    def _line(self) -> Serial:
        line = self._serial
        if line is None:
            raise _gone(self.name, self._port, "it is not open")
        return line

    def _opened(self, path: str) -> Serial:
        """The port, set up; line levels are set before it opens."""
        from serial import Serial

        line = Serial()
        line.port = path
        line.baudrate = self._baud
        line.timeout = 0
        line.write_timeout = _WRITE_TIMEOUT_S
        line.exclusive = True
        line.dtr = self._dtr
        line.rts = self._rts
        line.open()
        if self._low_latency:
            # Not every adapter can, and none needs it to work.
            with suppress(OSError, ValueError, AttributeError, NotImplementedError):
                line.set_low_latency_mode(True)
        return line

    def _refused(self, path: str, error: Exception) -> ConnectError:
        """Why a port that exists cannot be opened, and what to do."""
        code = getattr(error, "errno", None)
        if code in (errno.EACCES, errno.EPERM) and not os.access(
            path, os.R_OK | os.W_OK
        ):
            return ConnectError(
                f"no permission to use {path}",
                device=self.name,
                hint="`sudo usermod -aG dialout $USER`, then log out and in again",
            )
        if code in _IN_USE or "lock" in str(error):
            holders = ", ".join(holders_of(path)) or "unknown"
            return ConnectError(
                f"another program holds {path}: {holders}",
                device=self.name,
                hint="end that program, or the other run on this cell",
            )
        return ConnectError(
            f"{path} cannot be opened: {error}",
            device=self.name,
            hint="is it a serial port, and is the device switched on?",
        )


class TcpTransport:
    """Raw bytes over TCP: a serial server, or firmware with a network port.

    Args:
        name: of the device, for messages.
        endpoint: ``host:port``.
        connect_timeout_s: how long to wait for the far end to accept.
    """

    def __init__(
        self, name: str, endpoint: str, *, connect_timeout_s: float = 5.0
    ) -> None:
        self.name = name
        self._endpoint = endpoint
        self._connect_timeout_s = connect_timeout_s
        self._socket: socket.socket | None = None
        self._sending = threading.Lock()

    @property
    def address(self) -> str:
        """``socket://host:port``."""
        return f"socket://{self._endpoint}"

    def open(self) -> None:
        """Connect; safe to repeat.

        Raises:
            ConnectError: no such address, or nobody listens.
        """
        if self._socket is not None:
            return
        host, _, port = self._endpoint.rpartition(":")
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise ConnectError(
                f"{self.address} is no network address",
                device=self.name,
                hint='write it as port = "socket://host:port"',
            )
        try:
            line = socket.create_connection(
                (host.strip("[]"), int(port)), timeout=self._connect_timeout_s
            )
        except OSError as error:
            raise ConnectError(
                f"nobody answers at {self.address}: {error}",
                device=self.name,
                hint="is the device switched on, on this network, and the port right?",
            ) from error
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        line.settimeout(_WRITE_TIMEOUT_S)
        self._socket = line
        _LOG.info("%s: connected to %s", self.name, self.address)

    def close(self) -> None:
        """Disconnect; safe to repeat."""
        line, self._socket = self._socket, None
        if line is None:
            return
        with suppress(OSError):
            line.shutdown(socket.SHUT_RDWR)
        line.close()
        _LOG.info("%s: disconnected from %s", self.name, self.address)

    def write(self, data: bytes) -> None:
        """Send in one piece.

        Raises:
            DeviceTimeout: the far end takes no bytes.
            LinkLost: the far end is gone, or not open.
        """
        line = self._line()
        try:
            with self._sending:
                line.sendall(data)
        except TimeoutError as error:
            raise _takes_nothing(self.name, self.address) from error
        except OSError as error:
            raise _gone(self.name, self.address, error) from error

    def read(self, *, timeout_s: float) -> bytes:
        """Whatever has come, at least one byte; empty when nothing came in time.

        Raises:
            LinkLost: the far end is gone, or not open.
        """
        line = self._line()
        try:
            if not _is_readable(line.fileno(), timeout_s):
                return b""
            data = line.recv(_CHUNK)
        except TimeoutError:
            return b""
        except (OSError, ValueError) as error:
            raise _gone(self.name, self.address, error) from error
        if not data:
            raise _gone(self.name, self.address, "closed by the far end")
        return data

    def _line(self) -> socket.socket:
        line = self._socket
        if line is None:
            raise _gone(self.name, self.address, "it is not open")
        return line


def _is_readable(handle: int, timeout_s: float) -> bool:
    """Wait for bytes, or for an error that reading will show."""
    poll = select.poll()
    poll.register(handle, select.POLLIN)
    events = poll.poll(max(0.0, timeout_s) * 1000)
    if any(event & select.POLLNVAL for _, event in events):
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))
    return bool(events)


def _gone(name: str, address: str, why: object) -> LinkLost:
    return LinkLost(
        f"the link {address} is gone: {why}",
        device=name,
        hint="check cable and supply; its position is unknown now, home it again",
    )


def _takes_nothing(name: str, address: str) -> DeviceTimeout:
    return DeviceTimeout(
        f"the link {address} takes no bytes",
        device=name,
        hint="switch the device off and on",
    )
