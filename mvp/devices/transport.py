"""A link that carries bytes: what every driver on a wire talks through.

A link is addressed by a path (``/dev/ttyUSB0``, ``/dev/serial/by-id/...``), by the name
of an entry of ``/dev/serial/by-id``, by USB identity (``vid:pid`` or
``vid:pid:serial``), or as ``socket://host:port``. The address is looked up anew at
every ``open``: the kernel renumbers ports that are unplugged and plugged in again.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from pydantic import Field

from mvp.devices.recording import RecordingTransport
from mvp.devices.serial_line import SerialTransport, TcpTransport
from mvp.fileedge import FileModel

SOCKET = "socket://"


@runtime_checkable
class Transport(Protocol):
    """Bytes to and from one device; frames are the business of ``framing``."""

    name: str

    @property
    def address(self) -> str:
        """Where it leads: a port or an address, for messages and records."""
        ...

    def open(self) -> None:
        """Connect; safe to repeat.

        Raises:
            ConnectError: no such port, no right to use it, in use, or nobody answers.
        """
        ...

    def close(self) -> None:
        """Disconnect; safe to repeat, also while another thread reads."""
        ...

    def write(self, data: bytes) -> None:
        """Send in one piece; frames of two threads never mix.

        Raises:
            DeviceTimeout: the far end takes no bytes.
            LinkLost: unplugged, or not open.
        """
        ...

    def read(self, *, timeout_s: float) -> bytes:
        """Whatever has come, at least one byte; empty when nothing came in time.

        Raises:
            LinkLost: unplugged, closed by the far end, or not open.
        """
        ...


class TransportConfig(FileModel):
    """Keys that every driver on a wire has; a driver's ``Config`` inherits them.

    Attributes:
        port: path, name in /dev/serial/by-id, ``vid:pid[:serial]`` or
            ``socket://host:port``.
        baud: bits per second; meaningless on USB-native devices and sockets.
        dtr: level of that line while connected. Boards with an AVR reboot when it
            rises; many USB-native boards stay silent while it is low.
        rts: level of that line while connected.
        low_latency: ask the adapter to hand on short answers at once.
        strip_echo: the adapter returns the bytes that are sent (two-wire buses).
        connect_timeout_s: for network addresses.
    """

    port: str = Field(min_length=1)
    baud: int = Field(default=115200, gt=0)
    dtr: bool = True
    rts: bool = True
    low_latency: bool = True
    strip_echo: bool = False
    connect_timeout_s: float = Field(default=5.0, gt=0)


def recorded_link(config: TransportConfig, name: str) -> Transport:
    """The link that ``config`` describes, with its traffic kept for a fault report.

    Args:
        config: port, speed and line levels.
        name: of the device, for messages.
    """
    return RecordingTransport(_plain_link(config, name))


def _plain_link(config: TransportConfig, name: str) -> Transport:
    if config.port.startswith(SOCKET):
        return TcpTransport(
            name,
            config.port.removeprefix(SOCKET),
            connect_timeout_s=config.connect_timeout_s,
        )
    return SerialTransport(
        name,
        config.port,
        baud=config.baud,
        dtr=config.dtr,
        rts=config.rts,
        low_latency=config.low_latency,
    )
