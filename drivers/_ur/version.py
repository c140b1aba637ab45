"""Ask a controller for its version, with a deadline that the client library lacks."""

from __future__ import annotations

import socket
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from mvp.errors import ConnectError, DeviceTimeout, LinkLost, WireError

if TYPE_CHECKING:
    from mvp.devices import Clock

Version: TypeAlias = tuple[int, int, int, int]

PORT = 30004
_HEADER = struct.Struct(">HB")
_PROTOCOL, _VERSION = 86, 118


def ask_version(
    host: str, *, name: str, clock: Clock, timeout_s: float = 2.0
) -> Version:
    """Major, minor, bugfix and build of the controller software.

    Raises:
        ConnectError: nobody there.
        DeviceTimeout: connected, but no answer.
        LinkLost: hung up.
        WireError: it answers something else.
    """
    try:
        with socket.create_connection((host, PORT), timeout_s) as link:
            question = Question(link, clock, clock.now_s() + timeout_s, name)
            question.ask(_PROTOCOL, struct.pack(">H", 2), answer_bytes=1)
            body = question.ask(_VERSION, b"", answer_bytes=16)
    except TimeoutError as error:
        raise DeviceTimeout(
            f"the robot at {host}:{PORT} does not answer",
            device=name,
            hint="is it still starting? Is RTDE enabled in its security settings?",
        ) from error
    except OSError as error:
        raise ConnectError(
            f"nobody answers at {host}:{PORT} ({error})",
            device=name,
            hint="is the controller on, and is host in [arm] right?",
        ) from error
    major, minor, bugfix, build = struct.unpack(">4I", body)
    return major, minor, bugfix, build


@dataclass(frozen=True, eq=False)
class Question:
    """Asks for one thing after the other on one RTDE connection, until a deadline."""

    link: socket.socket
    clock: Clock
    deadline_s: float
    name: str

    def send(self, kind: int, body: bytes) -> None:
        """One package, without waiting for anything."""
        self.link.sendall(_HEADER.pack(_HEADER.size + len(body), kind) + body)

    def ask(self, kind: int, body: bytes, *, answer_bytes: int) -> bytes:
        """The payload of the answer, which has the type of the question.

        Raises:
            WireError: another type or length.
            LinkLost: hung up.
        """
        self.send(kind, body)
        length, found = _HEADER.unpack(self._exactly(_HEADER.size))
        if found != kind or length != _HEADER.size + answer_bytes:
            raise WireError(
                f"the robot answers with type {found}, {length} bytes, to a request "
                f"of type {kind}",
                device=self.name,
                hint="is host in [arm] a Universal Robots controller?",
            )
        return self._exactly(answer_bytes)

    def _exactly(self, size: int) -> bytes:
        found = b""
        while len(found) < size:
            self.link.settimeout(max(1e-3, self.deadline_s - self.clock.now_s()))
            more = self.link.recv(size - len(found))
            if not more:
                raise LinkLost("the robot hung up while it was asked", device=self.name)
            found += more
        return found
