"""A Theia MCR lens controller: binary frames, one answer when a move has ended.

The board keeps no position and is deaf while it moves: what arrives meanwhile waits in
a buffer of 512 bytes, the rest is lost. Frames are cut by the length that belongs to
their first byte; 0D and 0A occur inside them. A move towards the light barrier stops
there where the set-up says so, and is answered like any other.
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

_MOTORS: dict[int, Axis] = {1: "focus", 2: "zoom", 3: "iris"}
_FILTER = 4
_SIZES = {
    0x76: 2,
    0x79: 2,
    0x67: 3,
    0x63: 12,
    0x66: 8,
    0x62: 8,
    0x73: 8,
    0x6B: 3,
}
_BUFFER = 512
_DONE = bytes([0x74, 0x00, 0x0D])
_REBOOT_S = 0.7
_USB = 1


@dataclass
class _SetUp:
    """What the board keeps of a motor, also without power."""

    kind: int
    left: int
    right: int
    steps: int
    slowest: int
    fastest: int

    def bytes(self) -> bytes:
        return bytes([self.kind, self.left, self.right]) + b"".join(
            n.to_bytes(2, "big") for n in (self.steps, self.slowest, self.fastest)
        )


class TheiaConfig(LineSettings, RateSettings):
    """Keys of the simulator; places in steps of the lens table.

    The iris counts from closed (0) to open: its ``66`` closes, its ``62`` opens.

    Attributes:
        firmware: five hexadecimal digits.
        serial: twelve hexadecimal digits, read as decimal.
    """

    zoom: Travel = Travel(low=0, high=3_227, start=800, reference=3_119)
    focus: Travel = Travel(low=0, high=8_390, start=2_000, reference=7_959)
    iris: Travel = Travel(low=0, high=75, start=30)
    firmware: str = Field(default="53000", pattern="^[0-9a-f]{5}$")
    serial: str = Field(default="055000001234", pattern="^[0-9]{12}$")


class TheiaMachine:
    """What the board does with bytes and time."""

    def __init__(self, config: TheiaConfig) -> None:
        self._config = config
        scale = config.speed_scale
        self._scale = scale
        self.axes = {name: Motor(getattr(config, name), scale) for name in AXES}
        self._set_up = {
            1: _SetUp(0, 1, 0, int(config.focus.high), 100, 1500),
            2: _SetUp(0, 1, 0, int(config.zoom.high), 100, 1500),
            3: _SetUp(0, 0, 0, int(config.iris.high), 10, 200),
            _FILTER: _SetUp(1, 0, 0, 50, 100, 1000),
        }
        self._buffer = bytearray()
        self._output = bytearray()
        self._now_s = 0.0
        self._moving: Motor | None = None
        self._then: tuple[float, float] | None = None
        self._deaf_until_s = 0.0
        self._pulse = False
        self._lost_path = False

    def power_up(self, now_s: float) -> None:
        """The power comes on; set-ups are kept, a motion is not."""
        for motor in self.axes.values():
            motor.halt()
        self._moving = self._then = None
        self._pulse = self._lost_path = False
        self._buffer.clear()
        self._output.clear()
        self._deaf_until_s = now_s + _REBOOT_S

    def places(self) -> dict[str, float]:
        """True steps of zoom, focus and iris."""
        return {name: motor.place for name, motor in self.axes.items()}

    def state(self) -> dict[str, object]:
        """For the fault channel."""
        moving = self._moving is not None
        return {"places": self.places(), "moving": moving, "waiting": len(self._buffer)}

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the host; a full buffer loses them."""
        self.tick(now_s)
        if self._lost_path:
            return
        self._buffer += data[: _BUFFER - len(self._buffer)]
        self.tick(now_s)

    def tick(self, now_s: float) -> None:
        """Let time pass, and read what waits as soon as nothing moves."""
        self._now_s = max(now_s, self._now_s)
        for motor in self.axes.values():
            motor.tick(self._now_s)
        self._end_of_move()
        while not self._busy and self._next_frame():
            pass

    @property
    def _busy(self) -> bool:
        return self._moving is not None or self._now_s < self._deaf_until_s

    def take_output(self) -> bytes:
        """What it said since it was last asked."""
        said, self._output = bytes(self._output), bytearray()
        return said

    def _end_of_move(self) -> None:
        if self._pulse and self._now_s >= self._deaf_until_s:
            self._pulse = False
            self._output += _DONE
        if self._moving is None or self._moving.moving:
            return
        motor, then = self._moving, self._then
        self._then = None
        if then is not None:
            motor.go(*then, self._now_s)
        if not motor.moving:
            self._moving = None
            self._output += _DONE

    def _next_frame(self) -> bool:
        """Cut and do one frame; False when none is complete."""
        while self._buffer and self._buffer[0] not in _SIZES:
            del self._buffer[0]
        if not self._buffer or len(self._buffer) < _SIZES[self._buffer[0]]:
            return False
        size = _SIZES[self._buffer[0]]
        frame = bytes(self._buffer[:size])
        if frame[-1] != 0x0D:
            del self._buffer[0]
            return True
        del self._buffer[:size]
        self._do(frame)
        return True

    def _do(self, frame: bytes) -> None:
        match frame[0]:
            case 0x76:
                digits = [int(d, 16) for d in self._config.firmware]
                self._output += bytes([0x76, *digits, 0x0D])
            case 0x79:
                self._output += b"\x79" + bytes.fromhex(self._config.serial) + b"\x0d"
            case 0x67:
                self._read_set_up(frame[1])
            case 0x63:
                self._write_set_up(frame)
            case 0x66 | 0x62 | 0x73:
                self._move(frame)
            case _:
                self._change_path(frame[1])

    def _read_set_up(self, motor: int) -> None:
        found = self._set_up.get(motor)
        said = bytes([motor]) + found.bytes() if found else b"\xff" * 10
        self._output += b"\x67" + said + b"\x0d"

    def _write_set_up(self, frame: bytes) -> None:
        known = frame[1] in self._set_up
        if known:
            steps, slowest, fastest = (
                int.from_bytes(frame[k : k + 2], "big") for k in (5, 7, 9)
            )
            kind, left, right = frame[2:5]
            self._set_up[frame[1]] = _SetUp(kind, left, right, steps, slowest, fastest)
        self._output += bytes([0x63, 0 if known else 1, 0x0D])

    def _move(self, frame: bytes) -> None:
        """Start a move; what makes no sense is met with silence."""
        number = frame[1]
        count = int.from_bytes(frame[2:4], "big")
        found = self._set_up.get(number)
        if found is None or frame[4] != 1:
            return
        if frame[0] == 0x73 and not (found.left and number in (1, 2)):
            return
        rate = int.from_bytes(frame[5:7], "big")
        if not found.slowest <= rate <= found.fastest:
            return
        if number == _FILTER:
            self._deaf_until_s = self._now_s + count / rate / self._scale
            self._pulse = True
            return
        motor = self.axes[_MOTORS[number]]
        self._moving = motor
        if motor is self.axes["iris"]:
            opens = frame[0] == 0x62
            motor.go(count if opens else -count, rate, self._now_s)
            return
        stops = bool(found.left) and motor.travel.reference is not None
        if frame[0] == 0x73:
            self._go_up(motor, found.steps * 2, rate, stops=True)
            self._then = (-float(count), float(rate))
        elif frame[0] == 0x66:
            self._go_up(motor, count, rate, stops=stops)
        else:
            motor.go(-count, rate, self._now_s)

    def _go_up(self, motor: Motor, count: int, rate: int, *, stops: bool) -> None:
        """Towards the barrier; a barrier that is covered already ends it at once."""
        way = 0 if stops and motor.barrier else count
        motor.go(way, rate, self._now_s, until_barrier=stops)

    def _change_path(self, path: int) -> None:
        """The board restarts and listens to another bus."""
        self.power_up(self._now_s)
        self._lost_path = path != _USB


class TheiaSimulator(LensSimulator):
    """The board behind its port."""

    key: ClassVar[str] = "theia"
    Config = TheiaConfig

    @classmethod
    def from_config(
        cls, config: TheiaConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the simulator; no I/O."""
        return cls(TheiaMachine(config), config, context, name=name)
