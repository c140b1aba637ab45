"""One connection each: RTDE, script upload, dashboard."""

from __future__ import annotations

import asyncio
import logging
import socket
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

from drivers.simulators.ur import wire
from drivers.simulators.ur.dashboard import GREETING, Dashboard
from drivers.simulators.ur.script import ScriptReader
from drivers.simulators.ur.variables import (
    FORMATS,
    IN_USE,
    INPUTS,
    NOT_FOUND,
    OUTPUTS,
    type_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.simulators.ur.robot import Robot
    from drivers.simulators.ur.telemetry import Reader, Telemetry

_LOG = logging.getLogger(__name__)
_BACKLOG_BYTES = 65536
_SELDOM = 1e9  # cycles; a frequency next to nothing
_RESET = struct.pack("ii", 1, 0)


@dataclass
class Disturbance:
    """What is wrong with the wires at the moment.

    Attributes:
        silent: nothing is sent any more, on any port.
        muted: RTDE package types that are not sent: answers, or the data itself.
        dashboard_muted: the dashboard does not answer.
        delay_s: everything is sent so much later.
    """

    silent: bool = False
    muted: frozenset[int] = frozenset()
    dashboard_muted: bool = False
    delay_s: float = 0.0


@dataclass
class Line:
    """A connection as the rest sees it."""

    port: int
    disturbance: Disturbance
    transport: asyncio.Transport | None = None
    _free_at_s: float = 0.0
    _under_way: int = 0

    def send(self, data: bytes) -> None:
        """Send, late or never if so disturbed."""
        if self.transport is None or self.disturbance.silent:
            return
        if self.disturbance.delay_s <= 0 and not self._under_way:
            self.transport.write(data)
            return
        loop = asyncio.get_running_loop()
        self._free_at_s = max(loop.time() + self.disturbance.delay_s, self._free_at_s)
        self._under_way += 1
        loop.call_at(self._free_at_s, self._late, data)

    def drop(self, *, reset: bool) -> None:
        """Close the connection, with FIN or with RST."""
        if self.transport is None:
            return
        if reset:
            raw = cast("socket.socket", self.transport.get_extra_info("socket"))
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            self.transport.abort()
        else:
            self.transport.close()

    @property
    def clogged(self) -> bool:
        """Whether the client reads too slowly."""
        transport = self.transport
        return (
            transport is not None and transport.get_write_buffer_size() > _BACKLOG_BYTES
        )

    def _late(self, data: bytes) -> None:
        self._under_way -= 1
        if self.transport is not None and not self.transport.is_closing():
            self.transport.write(data)


class Session(asyncio.Protocol):
    """What all three kinds share.

    Args:
        robot: the controller.
        line: the connection to send on.
        sessions: where it enters itself while it lives.
    """

    def __init__(self, robot: Robot, line: Line, sessions: set[Session]) -> None:
        self.robot = robot
        self.line = line
        self._sessions = sessions

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client connected."""
        self.line.transport = cast("asyncio.Transport", transport)
        raw = cast("socket.socket", transport.get_extra_info("socket"))
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sessions.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """It is gone."""
        self.line.transport = None
        self._sessions.discard(self)

    def each_cycle(self) -> None:
        """Called after every control cycle."""


class ScriptSession(Session):
    """Ports 30001 to 30003: takes programs, sends nothing."""

    def __init__(self, robot: Robot, line: Line, sessions: set[Session]) -> None:
        super().__init__(robot, line, sessions)
        self._reader = ScriptReader()

    def data_received(self, data: bytes) -> None:
        """Part of a program."""
        for program in self._reader.feed(data):
            self.robot.upload(program)


class DashboardSession(Session):
    """Port 29999."""

    def __init__(self, robot: Robot, line: Line, sessions: set[Session]) -> None:
        super().__init__(robot, line, sessions)
        self._dashboard = Dashboard(robot)
        self._rest = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet."""
        super().connection_made(transport)
        self._say(GREETING)

    def data_received(self, data: bytes) -> None:
        """Part of a line."""
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[-4096:]
        for line in lines:
            text = line.decode("utf-8", "replace")
            self._say(self._dashboard.reply(text))
            if text.strip() == "quit":
                self.line.drop(reset=False)

    def _say(self, text: str) -> None:
        if not self.line.disturbance.dashboard_muted:
            self.line.send(text.encode() + b"\n")


@dataclass
class _Output:
    """A recipe that is sent, every so many cycles."""

    recipe: wire.Recipe
    readers: list[Reader]
    every: int


@dataclass
class _Setup:
    """What a client has set up."""

    protocol: int = 1
    outputs: list[_Output] = field(default_factory=list)
    inputs: dict[int, wire.Recipe] = field(default_factory=dict)
    started: bool = False


class RtdeSession(Session):
    """Port 30004."""

    def __init__(
        self,
        robot: Robot,
        line: Line,
        sessions: set[Session],
        telemetry: Telemetry,
    ) -> None:
        super().__init__(robot, line, sessions)
        self._telemetry = telemetry
        self._framer = wire.Framer()
        self._setup = _Setup()
        self._answers: dict[int, Callable[[bytes], bytes]] = {
            wire.REQUEST_PROTOCOL: self._protocol,
            wire.GET_VERSION: lambda _: wire.version_package(robot.profile.version),
            wire.SETUP_OUTPUTS: self._outputs,
            wire.SETUP_INPUTS: self._inputs,
            wire.START: lambda _: self._run(wire.START, started=True),
            wire.PAUSE: lambda _: self._run(wire.PAUSE, started=False),
        }

    @property
    def started(self) -> bool:
        """Whether it asked for data."""
        return self._setup.started

    def connection_lost(self, exc: Exception | None) -> None:
        """Its inputs are free again."""
        super().connection_lost(exc)
        self.robot.owners.release(self)

    def data_received(self, data: bytes) -> None:
        """Answer what is complete; a client that sends nonsense is dropped."""
        try:
            for kind, payload in self._framer.feed(data):
                self._package(kind, payload)
        except ValueError as error:
            _LOG.info("RTDE client dropped: %s", error)
            self.line.drop(reset=False)

    def each_cycle(self) -> None:
        """Send what is due in this cycle."""
        quiet = wire.DATA in self.line.disturbance.muted
        if not self._setup.started or quiet or self.line.clogged:
            return
        for output in self._setup.outputs:
            if self.robot.cycle % output.every == 0:
                values = [read() for read in output.readers]
                packed = output.recipe.pack(values, protocol=self._setup.protocol)
                self.line.send(packed)

    def _package(self, kind: int, payload: bytes) -> None:
        if kind == wire.DATA:
            self._data(payload)
        elif kind in self._answers:
            answer = self._answers[kind](payload)
            if kind not in self.line.disturbance.muted:
                self.line.send(answer)

    def _protocol(self, payload: bytes) -> bytes:
        asked = int.from_bytes(payload, "big")
        accepted = asked in (1, 2)
        if accepted:
            self._setup.protocol = asked
        return wire.package(wire.REQUEST_PROTOCOL, bytes([accepted]))

    def _outputs(self, payload: bytes) -> bytes:
        protocol = self._setup.protocol
        frequency, names = wire.output_setup(payload, protocol=protocol)
        types = [type_of(OUTPUTS, name, self.robot.profile) for name in names]
        number = len(self._setup.outputs) + 1
        if NOT_FOUND in types:
            number = 0
        else:
            if protocol == 1:
                self._setup.outputs.clear()
            self._setup.outputs.append(
                _Output(
                    wire.Recipe(number, names, types),
                    [self._telemetry.reader(name) for name in names],
                    self._every(frequency),
                )
            )
        body = ",".join(types).encode()
        return wire.package(
            wire.SETUP_OUTPUTS, body if protocol == 1 else bytes([number]) + body
        )

    def _every(self, frequency: float | None) -> int:
        base = self.robot.profile.base_hz
        if frequency is None or not frequency > 0:
            return 1
        return max(1, round(min(base / frequency, _SELDOM)))

    def _inputs(self, payload: bytes) -> bytes:
        names = wire.names_of(payload)
        types = [self._input_type(name) for name in names]
        number = 0
        if all(type_name in FORMATS for type_name in types):
            number = len(self._setup.inputs) + 1
            self._setup.inputs[number] = wire.Recipe(number, names, types)
            self.robot.owners.take(names, self)
        body = ",".join(types).encode()
        return wire.package(wire.SETUP_INPUTS, bytes([number]) + body)

    def _input_type(self, name: str) -> str:
        type_name = type_of(INPUTS, name, self.robot.profile)
        if type_name != NOT_FOUND and self.robot.owners.taken(name, self):
            return IN_USE
        return type_name

    def _run(self, kind: int, *, started: bool) -> bytes:
        self._setup.started = started
        return wire.package(kind, b"\x01")

    def _data(self, payload: bytes) -> None:
        """Inputs; a package of the wrong length is ignored, as on the controller."""
        recipe = self._setup.inputs.get(payload[0]) if payload else None
        values = recipe.unpack(payload[1:]) if recipe else None
        if values is not None:
            self.robot.registers.apply(values)
