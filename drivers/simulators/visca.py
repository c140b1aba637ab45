"""A block camera that speaks VISCA over a serial line: acknowledge, complete, inquire.

Two commands may be open at once, each in a socket. Focus is refused in auto focus,
iris in full-auto exposure; both are on when the power comes. Clones differ, and the
settings below make it one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from drivers.simulators.lens_machine import LensSimulator
from drivers.simulators.motor import Motor, RateSettings, Travel
from drivers.simulators.serial_simulator import LineSettings
from mvp.devices import AXES, Axis

if TYPE_CHECKING:
    from typing import Self

    from mvp.devices import DeviceContext

_PACKET_MAX = 16
_SOCKETS = 2
_MANUAL, _IRIS_PRIORITY = 0x03, 0x0B
_SYNTAX, _BUSY, _CANCELLED, _NO_SOCKET, _NOT_NOW = 0x02, 0x03, 0x04, 0x05, 0x41
_BOOT_S = 1.0
_TRAVEL_S: dict[Axis, float] = {"zoom": 3.0, "focus": 1.5, "iris": 0.4}
_DIRECT: dict[int, tuple[Axis, ...]] = {
    0x47: ("zoom",),
    0x48: ("focus",),
    0x4B: ("iris",),
}
_STOPS: dict[int, Axis] = {0x07: "zoom", 0x08: "focus"}


class ViscaConfig(LineSettings, RateSettings):
    """Keys of the simulator; places in the device's own counts.

    Attributes:
        address: of the device on the line, 1 to 7.
        ack_s: from a command to its acknowledgment; a field or two of video.
        no_ack: a clone that only completes.
        completes_at_once: a clone that completes when it has accepted.
        ignores_unknown: a clone that answers nothing to what it does not know.
        auto_focus_after_zoom: a unit that returns to auto focus at every zoom.
        model: what the version inquiry says.
    """

    zoom: Travel = Travel(low=0, high=0x4000, start=0x1000)
    focus: Travel = Travel(low=0x1000, high=0xF000, start=0x6000)
    iris: Travel = Travel(low=0, high=0x11, start=0x08)
    address: int = Field(default=1, ge=1, le=7)
    ack_s: float = Field(default=0.02, ge=0)
    no_ack: bool = False
    completes_at_once: bool = False
    ignores_unknown: bool = False
    auto_focus_after_zoom: bool = False
    model: int = Field(default=0x0466, ge=0, le=0xFFFF)


@dataclass
class _Open:
    """A command under way in a socket."""

    axes: tuple[Axis, ...]
    ack_at_s: float
    acknowledged: bool = False


class ViscaMachine:
    """What the camera does with bytes and time."""

    def __init__(self, config: ViscaConfig) -> None:
        self._config = config
        self.axes = {n: Motor(getattr(config, n), config.speed_scale) for n in AXES}
        self._packet = bytearray()
        self._output = bytearray()
        self._now_s = 0.0
        self._boot_until_s = 0.0
        self._sockets: dict[int, _Open] = {}
        self._auto_focus, self._exposure = True, 0x00

    def power_up(self, now_s: float) -> None:
        """The power comes on: automatic modes are back, and it says so on the line."""
        for motor in self.axes.values():
            motor.halt()
        self._packet.clear()
        self._output.clear()
        self._sockets.clear()
        self._auto_focus, self._exposure = True, 0x00
        self._boot_until_s = now_s + _BOOT_S

    def places(self) -> dict[str, float]:
        """True counts of zoom, focus and iris."""
        return {name: motor.place for name, motor in self.axes.items()}

    def state(self) -> dict[str, object]:
        """For the fault channel."""
        return {
            "places": self.places(),
            "auto_focus": self._auto_focus,
            "exposure_mode": self._exposure,
            "open_sockets": sorted(self._sockets),
        }

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the host; FF ends a packet."""
        self.tick(now_s)
        if now_s < self._boot_until_s:
            return
        for byte in data:
            self._packet.append(byte)
            if byte == 0xFF:
                packet = bytes(self._packet)
                self._packet.clear()
                self._do(packet)
            elif len(self._packet) > _PACKET_MAX:
                self._packet.clear()

    def tick(self, now_s: float) -> None:
        """Let time pass."""
        booting = self._now_s < self._boot_until_s
        self._now_s = max(now_s, self._now_s)
        if booting and self._now_s >= self._boot_until_s:
            self._say(0x38)
        for motor in self.axes.values():
            motor.tick(self._now_s)
        for number, command in sorted(self._sockets.items()):
            self._follow(number, command)

    def take_output(self) -> bytes:
        """What it said since it was last asked."""
        said, self._output = bytes(self._output), bytearray()
        return said

    def _say(self, *payload: int) -> None:
        header = 0x80 + 16 * self._config.address
        self._output += bytes([header, *payload, 0xFF])

    def _follow(self, number: int, command: _Open) -> None:
        """Acknowledge and complete a command when it is time."""
        if not command.acknowledged and self._now_s >= command.ack_at_s:
            command.acknowledged = True
            if not self._config.no_ack:
                self._say(0x40 + number)
        ended = not any(self.axes[axis].moving for axis in command.axes)
        if command.acknowledged and (ended or self._config.completes_at_once):
            del self._sockets[number]
            self._say(0x50 + number)

    def _do(self, packet: bytes) -> None:
        """One packet; what is for others is not answered."""
        if packet[0] == 0x88:
            self._broadcast(packet)
        elif packet[0] == 0x80 + self._config.address:
            body = packet[1:-1]
            if body[:1] == b"\x01":
                self._command(body[1:])
            elif body[:1] == b"\x09":
                self._inquire(body[1:])
            elif len(body) == 1 and body[0] & 0xF0 == 0x20:
                self._cancel(body[0] & 0x0F)
            else:
                self._refuse(_SYNTAX)

    def _broadcast(self, packet: bytes) -> None:
        if packet == bytes([0x88, 0x30, 0x01, 0xFF]):
            self._output += bytes([0x88, 0x30, self._config.address + 1, 0xFF])
        elif packet == bytes([0x88, 0x01, 0x00, 0x01, 0xFF]):
            self._clear_sockets()
            self._output += packet

    def _clear_sockets(self) -> None:
        """Forget what is open; motors run on."""
        self._sockets.clear()

    def _refuse(self, code: int, socket: int = 0) -> None:
        if code == _SYNTAX and self._config.ignores_unknown:
            return
        self._say(0x60 + socket, code)

    def _cancel(self, number: int) -> None:
        command = self._sockets.pop(number, None)
        if command is None:
            self._refuse(_NO_SOCKET, number)
            return
        for axis in command.axes:
            self.axes[axis].halt()
        self._refuse(_CANCELLED, number)

    def _command(self, body: bytes) -> None:
        if body == b"\x00\x01":
            self._clear_sockets()
            self._say(0x50)
            return
        if len(body) < 3 or body[0] != 0x04:
            self._refuse(_SYNTAX)
            return
        if len(self._sockets) >= _SOCKETS:
            self._refuse(_BUSY)
            return
        moves = self._moves(body[1], body[2:])
        if moves is None:
            self._refuse(_SYNTAX)
        elif any(self._locked(axis) for axis in moves):
            self._refuse(_NOT_NOW, 1)
        else:
            self._begin(moves)

    def _moves(self, what: int, data: bytes) -> dict[Axis, float] | None:
        """Targets by axis; empty for a setting, None for what it does not know."""
        if what == 0x47 and len(data) == 8:
            return {"zoom": _nibbles(data[:4]), "focus": _nibbles(data[4:])}
        if what in _DIRECT and len(data) == 4:
            return {_DIRECT[what][0]: _nibbles(data)}
        if what in _STOPS and len(data) == 1:
            return self._drive(_STOPS[what], data[0])
        if what == 0x38 and data in (b"\x02", b"\x03"):
            self._auto_focus = data == b"\x02"
            return {}
        if what == 0x39 and data in (b"\x00", b"\x03", b"\x0b"):
            self._exposure = data[0]
            return {}
        return {} if what in (0x00, 0x19) and len(data) == 1 else None

    def _drive(self, axis: Axis, way: int) -> dict[Axis, float] | None:
        """Stop, or run towards an end."""
        motor = self.axes[axis]
        if way == 0:
            motor.halt()
            return {}
        kind = way & 0xF0 or way << 4
        if kind not in (0x20, 0x30):
            return None
        up = (kind == 0x20) == (axis == "zoom")  # tele is up, far is down
        return {axis: motor.travel.high if up else motor.travel.low}

    def _locked(self, axis: Axis) -> bool:
        if axis == "focus":
            return self._auto_focus
        return axis == "iris" and self._exposure not in (_MANUAL, _IRIS_PRIORITY)

    def _begin(self, moves: dict[Axis, float]) -> None:
        for axis, target in moves.items():
            motor = self.axes[axis]
            rate = (motor.travel.high - motor.travel.low) / _TRAVEL_S[axis]
            motor.go(target - motor.place, rate, self._now_s)
        if "zoom" in moves and self._config.auto_focus_after_zoom:
            self._auto_focus = True
        free = next(n for n in range(1, _SOCKETS + 1) if n not in self._sockets)
        self._sockets[free] = _Open(tuple(moves), self._now_s + self._config.ack_s)

    def _inquire(self, body: bytes) -> None:
        if body == b"\x00\x02":
            model = self._config.model
            version = (0x00, 0x20, model >> 8, model & 0xFF, 0x01, 0x07, _SOCKETS)
            self._say(0x50, *version)
        elif body == b"\x7e\x7e\x00":
            self._say(0x50, *self._lens_block())
        elif len(body) == 2 and body[0] == 0x04:
            self._inquire_one(body[1])
        else:
            self._refuse(_SYNTAX)

    def _inquire_one(self, what: int) -> None:
        match what:
            case 0x00:
                self._say(0x50, 0x02)
            case 0x38:
                self._say(0x50, 0x02 if self._auto_focus else 0x03)
            case 0x39:
                self._say(0x50, self._exposure)
            case 0x47 | 0x48:
                self._say(0x50, *_split(self.axes[_DIRECT[what][0]].place, 4))
            case 0x4B:
                self._say(0x50, 0, 0, *_split(self.axes["iris"].place, 2))
            case _:
                self._refuse(_SYNTAX)

    def _lens_block(self) -> tuple[int, ...]:
        busy = int(self.axes["zoom"].moving) | int(self.axes["focus"].moving) << 1
        places = (*_split(self.axes["zoom"].place, 4), 1, 0)
        return (*places, *_split(self.axes["focus"].place, 4), 0, 0, busy)


def _nibbles(data: bytes) -> float:
    value = 0
    for nibble in data:
        value = value << 4 | nibble & 0x0F
    return float(value)


def _split(value: float, count: int) -> tuple[int, ...]:
    whole = round(value)
    return tuple(whole >> 4 * k & 0x0F for k in reversed(range(count)))


class ViscaSimulator(LensSimulator):
    """The camera behind its port."""

    key: ClassVar[str] = "visca"
    Config = ViscaConfig

    @classmethod
    def from_config(
        cls, config: ViscaConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the simulator; no I/O."""
        return cls(ViscaMachine(config), config, context, name=name)
