"""A Kurokesu SCF4 lens controller: ASCII lines, answers at once, no limits.

Axes A (zoom), B (focus) and C (iris) have 16-bit counters that wrap silently. A move
is answered when it has been read, not when it has ended. Motors that meet their end go
on counting. Restarting the processor (``$B3``) is simulated without the USB link
vanishing; the fault channel's ``reboot`` and ``unplug`` do that.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, ClassVar, TypeAlias

from pydantic import Field

from drivers.simulators.lens_machine import LensSimulator
from drivers.simulators.motor import Motor, RateSettings, Travel
from drivers.simulators.serial_simulator import LineSettings
from mvp.devices import AXES, Axis

if TYPE_CHECKING:
    from typing import Self

    from mvp.devices import DeviceContext

_AXES: dict[str, Axis] = {"A": "zoom", "B": "focus", "C": "iris"}
_WRAP = 1 << 16
_LINE_MAX = 256
_BOOT_S = 1.0
_RATE_AT_PERIOD = 1_200_000.0  # pulses per second times the period of M240
_WORD = re.compile(r"([A-Z])\s*([+-]?\d+)")

Words: TypeAlias = dict[str, int]


class Scf4Config(LineSettings, RateSettings):
    """Keys of the simulator; places in steps of the lens table.

    Attributes:
        unknown: what an unknown command is answered with.
    """

    zoom: Travel = Travel(low=17_000, high=39_500, start=24_000, reference=32_000)
    focus: Travel = Travel(low=27_500, high=39_000, start=30_000, reference=36_000)
    iris: Travel = Travel(low=0, high=2_400, start=900)
    identity: str = "EVB.1.0.2, SCF4-M RevB, Kurokesu, 5DDFF39-3739584E-00000001"
    unknown: str = Field(default="ERROR", pattern="^(ERROR|silence)$")


class Scf4Machine:
    """What the controller does with bytes and time."""

    def __init__(self, config: Scf4Config) -> None:
        self._config = config
        scale = config.speed_scale
        self.axes = {name: Motor(getattr(config, name), scale) for name in AXES}
        self._motors = {letter: self.axes[name] for letter, name in _AXES.items()}
        self._line = bytearray()
        self._output = bytearray()
        self._now_s = 0.0
        self._deaf_until_s = 0.0
        self._late: bytes = b""
        self._waiting = bytearray()
        self._power_on()

    def _power_on(self) -> None:
        self._counter = dict.fromkeys(_AXES, 0.0)
        self._period = dict.fromkeys(_AXES, 600)
        self._forced: set[str] = set()
        self._thresholds: Words = {}
        self._relative = False
        self._lamp = False
        for motor in self._motors.values():
            motor.halt()

    def power_up(self, now_s: float) -> None:
        """The power comes on: counters and settings are gone."""
        self._power_on()
        self._line.clear()
        self._output.clear()
        self._deaf_until_s = now_s + _BOOT_S
        self._waiting.clear()
        self._late = b""

    def places(self) -> dict[str, float]:
        """True steps of zoom, focus and iris."""
        return {name: motor.place for name, motor in self.axes.items()}

    def state(self) -> dict[str, object]:
        """For the fault channel."""
        counters = {name: self._shown(axis) for axis, name in _AXES.items()}
        return {"places": self.places(), "counters": counters, "lamp": self._lamp}

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the host."""
        self.tick(now_s)
        if now_s < self._deaf_until_s:
            self._waiting += data
            return
        for byte in data:
            if byte == 0x0A:
                self._do(bytes(self._line).decode("ascii", "replace"))
                self._line.clear()
            elif len(self._line) < _LINE_MAX:
                self._line.append(byte)

    def tick(self, now_s: float) -> None:
        """Let time pass."""
        self._now_s = max(now_s, self._now_s)
        for axis, motor in self._motors.items():
            self._counter[axis] += motor.tick(self._now_s)
        if self._now_s >= self._deaf_until_s and (self._late or self._waiting):
            late, self._late = self._late, b""
            waiting, self._waiting = bytes(self._waiting), bytearray()
            self._output += late
            self.receive(waiting, self._now_s)

    def take_output(self) -> bytes:
        """What it said since it was last asked."""
        said, self._output = bytes(self._output), bytearray()
        return said

    def _say(self, line: str) -> None:
        self._output += line.encode("ascii") + b"\r\n"

    def _do(self, line: str) -> None:
        """One command line."""
        text = line.strip().upper()
        if not text:
            return
        head, _, rest = text.partition(" ")
        words: Words = {w: int(n) for w, n in _WORD.findall(rest)}
        if head == "$S":
            self._say(self._config.identity)
        elif head == "!1":
            self._say(self._status())
        elif head == "M247":
            self._say("ADC=2234")
        elif head == "G4":
            self._deaf_until_s = self._now_s + words.get("P", 0) / 1000
            self._late = b"OK\r\n"
        elif self._obeys(head, words, rest):
            self._say("OK")
        elif self._config.unknown == "ERROR":
            self._say("ERROR")

    def _obeys(self, head: str, words: Words, rest: str) -> bool:
        """Do what is answered by OK; False for what it does not know."""
        axes = [a for a in _AXES if a in rest] or list(_AXES)
        match head:
            case "G90" | "G91":
                self._relative = head == "G91"
            case "G0":
                self._move(words)
            case "G92":
                self._counter |= {a: float(words[a]) for a in _AXES if a in words}
            case "M0":
                for axis in axes:
                    self._motors[axis].halt()
            case "M230":
                self._forced -= set(axes)
            case "M231":
                self._forced |= set(axes)
            case "M232":
                self._thresholds |= words
            case "M238" | "M239":
                self._lamp = head == "M238"
            case "M240":
                self._period |= {a: max(words[a], 1) for a in _AXES if a in words}
            case "$B1" | "M234" | "M235" | "M241" | "M242" | "M243" | "M244":
                pass
            case "M7" | "M8" | "M245" | "M246":
                pass
            case "$B2":
                self._power_on_drivers()
            case "$B3":
                self._power_on()
                self._deaf_until_s = self._now_s + _BOOT_S
            case _:
                return False
        return True

    def _power_on_drivers(self) -> None:
        """Drivers are initialised: settings are gone, counters stay."""
        counter = self._counter
        self._power_on()
        self._counter = counter

    def _move(self, words: Words) -> None:
        for axis, asked in words.items():
            if axis not in self._motors:
                continue
            here = round(self._counter[axis])
            way = asked if self._relative else asked % _WRAP - here % _WRAP
            rate = _RATE_AT_PERIOD / self._period[axis]
            if axis in self._forced:
                way = _WRAP if way > 0 else -_WRAP
            until = axis in self._forced and self._sees(axis)
            self._motors[axis].go(way, rate, self._now_s, until_barrier=until)

    def _sees(self, axis: str) -> bool:
        """Whether the light barrier of an axis can be read at all."""
        return self._lamp and axis in self._thresholds

    def _shown(self, axis: str) -> int:
        return round(self._counter[axis]) % _WRAP

    def _status(self) -> str:
        values = [self._shown(axis) for axis in _AXES]
        values += [int(self._sees(a) and self._motors[a].barrier) for a in _AXES]
        values += [int(self._motors[axis].moving) for axis in _AXES]
        return ", ".join(str(value) for value in values)


class Scf4Simulator(LensSimulator):
    """The controller behind its port."""

    key: ClassVar[str] = "scf4"
    Config = Scf4Config

    @classmethod
    def from_config(
        cls, config: Scf4Config, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the simulator; no I/O."""
        return cls(Scf4Machine(config), config, context, name=name)
