"""Marlin 2 on a five-axis camera gantry: queued moves, checksums, resends.

Answers come in the order of the lines. Nothing can be asked while something moves but
what waits in the queue. Software end-stops clamp without a word. A failed homing or
``M112`` halts the board until it is switched off and on.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from drivers.simulators.gantry_machine import gantry_in_world, gantry_verbs
from drivers.simulators.gcode_axes import Axes, AxisSettings, Block
from drivers.simulators.gcode_words import WordError, cleaned, words
from drivers.simulators.grbl_homing import Homing, HomingCycle
from drivers.simulators.motor import RateSettings
from drivers.simulators.serial_simulator import LineSettings, SerialSimulator

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Self

    from mvp.devices import DeviceContext

_QUEUE = 16
_LINE_MAX = 96
_RX_MAX = 128
_BUSY_S = 2.0
_NUMBERED = re.compile(rb"^N(-?\d+)(.*)\*(\d+)\s*$")


def marlin_gantry() -> tuple[AxisSettings, ...]:
    """X, Y, Z with switches at their low ends; A pans, B tilts, neither homed."""
    linear = {"X": (1200.0, -600.0), "Y": (1200.0, -600.0), "Z": (900.0, 0.0)}
    axes = [
        AxisSettings(
            letter=letter,
            travel=travel,
            rate_min=18_000 if letter != "Z" else 9000,
            acceleration=1000 if letter != "Z" else 500,
            steps_per_unit=80,
            switch="low",
            start=travel / 2,
            joint_zero=zero,
        )
        for letter, (travel, zero) in linear.items()
    ]
    turning = [
        AxisSettings(
            letter=letter,
            travel=travel,
            rate_min=5400,
            acceleration=300,
            steps_per_unit=160,
            switch=None,
        )
        for letter, travel in (("A", 180.0), ("B", 100.0))
    ]
    return (*axes, *turning)


class MarlinConfig(LineSettings, RateSettings):
    """Keys of the simulator.

    Attributes:
        axes: the machine.
        homing_seek_min: fast approach of the switch, mm per minute.
        homing_feed_min: slow approach.
        pull_off: bump before the slow approach, mm.
        resets_on_open: 8-bit boards restart when the port is opened.
        advanced_ok: ``ok`` carries line number and free places.
        emergency_parser: ``M410`` and ``M112`` act at once instead of in turn.
    """

    axes: tuple[AxisSettings, ...] = Field(default_factory=marlin_gantry)
    homing_seek_min: float = Field(default=3000.0, gt=0)
    homing_feed_min: float = Field(default=300.0, gt=0)
    pull_off: float = Field(default=5.0, gt=0)
    resets_on_open: bool = True
    advanced_ok: bool = False
    emergency_parser: bool = True
    boot_s: float = Field(default=0.5, ge=0)


class MarlinMachine:
    """What the board does with bytes and time."""

    def __init__(self, config: MarlinConfig) -> None:
        self._config = config
        self.axes = Axes(config.axes, config.speed_scale)
        self._letters = "".join(axis.letter for axis in config.axes)
        self._output = bytearray()
        self._now_s = 0.0
        self._boot_until_s = 0.0
        self._fresh()

    def _fresh(self) -> None:
        self._rx = bytearray()
        self._last_number = 0
        self._relative = False
        self._inches = False
        self._rate_min = 1500.0
        self._waiting: Callable[[], bool] | None = None
        self._busy_from_s = 0.0
        self._halted = False
        self._homing: HomingCycle | None = None

    def opened(self, now_s: float) -> None:
        """A host has opened the port; 8-bit boards restart then."""
        if self._config.resets_on_open:
            self.power_up(now_s)

    def power_up(self, now_s: float) -> None:
        """The processor starts: counters are 0 wherever the axes stand."""
        truth = self.axes.truth
        self.axes.freeze()
        self.axes.counter = np.zeros(len(truth))
        self.axes.offset = truth
        self._output.clear()
        self._fresh()
        self._now_s = max(now_s, self._now_s)
        self._boot_until_s = self._now_s + self._config.boot_s

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the host; what the buffer cannot hold is lost."""
        self.tick(now_s)
        if self._boot_until_s or self._halted:
            return
        self._rx += data[: max(_RX_MAX - len(self._rx), 0)]
        if self._config.emergency_parser:
            self._emergencies()
        self._main_loop()

    def tick(self, now_s: float) -> None:
        """Let time pass."""
        self._now_s = max(now_s, self._now_s)
        if self._boot_until_s:
            if self._now_s < self._boot_until_s:
                return
            self._boot_until_s = 0.0
            for line in ("start", "echo:Marlin 2.1.2.1", "echo: Last Updated: 2023"):
                self._say(line)
        if self._homing is not None:
            self._home_on(self._homing)
        else:
            self.axes.tick(self._now_s)
        self._main_loop()

    def take_output(self) -> bytes:
        """What it said since it was last asked."""
        said, self._output = bytes(self._output), bytearray()
        return said

    def places(self) -> tuple[float, ...]:
        """True joints of the arm, rad or mm."""
        return self.axes.joints()

    def state(self) -> dict[str, object]:
        """For the fault channel."""
        return {
            "halted": self._halted,
            "busy": self.axes.busy,
            "counter": [float(v) for v in self.axes.counter],
            "truth": [float(v) for v in self.axes.truth],
            "last_line": self._last_number,
        }

    # ------------------------------------------------------------ lines

    def _say(self, line: str) -> None:
        self._output += line.encode("ascii") + b"\n"

    def _ok(self) -> None:
        if self._config.advanced_ok:
            free = _QUEUE - self.axes.waiting
            self._say(f"ok N{self._last_number} P{free} B3")
        else:
            self._say("ok")

    def _emergencies(self) -> None:
        """Act on commands that do not wait for their turn."""
        for code, action in ((b"M410", self._quick_stop), (b"M112", self._kill)):
            if re.search(code + rb"(?!\d)[^\n]*\n", self._rx):
                self._rx = bytearray(
                    re.sub(rb"[^\n]*" + code + rb"(?!\d)[^\n]*\n", b"", self._rx)
                )
                action()

    def _quick_stop(self) -> None:
        """Stop at once; the position is doubtful from now on."""
        self.axes.freeze()
        self._waiting = None
        self._ok()

    def _kill(self) -> None:
        self.axes.freeze()
        self._halted = True
        self._waiting = None
        self._say("Error:Printer halted. kill() called!")

    def _main_loop(self) -> None:
        while not self._halted and not self._boot_until_s:
            if self._waiting is not None:
                if not self._waiting():
                    self._say_busy()
                    return
                self._waiting = None
            line, mark, rest = bytes(self._rx).partition(b"\n")
            if not mark:
                return
            self._rx = bytearray(rest)
            self._numbered(line[:_LINE_MAX].rstrip(b"\r"))

    def _say_busy(self) -> None:
        if self._now_s - self._busy_from_s >= _BUSY_S:
            self._busy_from_s = self._now_s
            self._say("echo:busy: processing")

    def _wait(self, over: Callable[[], bool]) -> None:
        self._busy_from_s = self._now_s
        self._waiting = over

    def _numbered(self, line: bytes) -> None:
        """Check number and checksum where there are some."""
        if not line.strip():
            return
        if not line.lstrip().startswith(b"N"):
            self._do(cleaned(line))
            return
        match = _NUMBERED.match(line.strip())
        if match is None:
            self._resend("No Checksum with line number")
            return
        number = int(match[1])
        check = 0
        for byte in line.strip()[: line.strip().rindex(b"*")]:
            check ^= byte
        text = cleaned(match[2])
        if check != int(match[3]):
            self._resend("checksum mismatch")
        elif number != self._last_number + 1 and not text.startswith("M110"):
            self._resend("Line Number is not Last Line Number+1")
        else:
            self._last_number = number
            self._do(text)

    def _resend(self, why: str) -> None:
        self._say(f"Error:{why}, Last Line: {self._last_number}")
        self._say(f"Resend: {self._last_number + 1}")
        self._say("ok")

    def _do(self, text: str) -> None:
        """One command; unknown ones are answered by ok all the same."""
        try:
            found = words(text, bare=True)
        except WordError:
            found = []
        head = f"{found[0][0]}{found[0][1]:g}" if found else ""
        values = dict(found[1:])
        action = self._actions().get(head)
        if action is None:
            self._say(f'echo:Unknown command: "{text}"')
            self._ok()
            return
        action(values)

    def _actions(self) -> dict[str, Callable[[dict[str, float]], None]]:
        return {
            "G0": self._move,
            "G1": self._move,
            "G4": self._dwell,
            "G20": lambda v: self._set(inches=True),
            "G21": lambda v: self._set(inches=False),
            "G28": self._home,
            "G90": lambda v: self._set(relative=False),
            "G91": lambda v: self._set(relative=True),
            "M17": lambda v: self._ok(),
            "M110": self._renumber,
            "M111": lambda v: self._ok(),
            "M112": lambda v: self._kill(),
            "M114": lambda v: self._where(),
            "M115": lambda v: self._who(),
            "M211": lambda v: self._ok(),
            "M400": lambda v: self._finish_moves(),
            "M410": lambda v: self._quick_stop(),
        }

    def _set(self, *, relative: bool | None = None, inches: bool | None = None) -> None:
        if relative is not None:
            self._relative = relative
        if inches is not None:
            self._inches = inches
        self._ok()

    def _renumber(self, values: dict[str, float]) -> None:
        if "N" in values:
            self._last_number = int(values["N"])
        self._ok()

    def _who(self) -> None:
        self._say(
            "FIRMWARE_NAME:Marlin 2.1.2.1 (Jan  1 2023 00:00:00) "
            "SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0 "
            "MACHINE_TYPE:Camera Gantry EXTRUDER_COUNT:0 AXIS_COUNT:5 "
            "UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff"
        )
        self._say(f"Cap:EMERGENCY_PARSER:{int(self._config.emergency_parser)}")
        self._say("Cap:AUTOREPORT_POS:1")
        self._ok()

    def _where(self) -> None:
        """The planned end of the queue, not the place."""
        planned = self.axes.planned
        shown = [f"{x}:{planned[k]:.2f}" for k, x in enumerate(self._letters)]
        steps = [
            f"{axis.letter}:{round(planned[k] * axis.steps_per_unit)}"
            for k, axis in enumerate(self.axes.settings)
            if axis.letter in "XYZ"
        ]
        self._say(" ".join([*shown[:3], "E:0.00", *shown[3:], "Count", *steps]))
        self._ok()

    # ------------------------------------------------------------ motion

    def _move(self, values: dict[str, float]) -> None:
        scale = 25.4 if self._inches else 1.0
        if values.get("F", 0) > 0:
            self._rate_min = values["F"] * scale
        planned = self.axes.planned
        target = np.full(len(self._letters), np.nan)
        for k, axis in enumerate(self.axes.settings):
            if axis.letter in values:
                size = scale if axis.letter in "XYZ" else 1.0
                asked = values[axis.letter] * size
                asked += planned[k] if self._relative else 0.0
                target[k] = _clamped(axis, asked)
        block = Block(target, self._rate_min / 60)

        def room() -> bool:
            if self.axes.waiting >= _QUEUE:
                return False
            if not np.isnan(target).all():
                self.axes.queue(block)
            self._ok()
            return True

        self._wait(room)

    def _finish_moves(self) -> None:
        def over() -> bool:
            if self.axes.busy:
                return False
            self._ok()
            return True

        self._wait(over)

    def _dwell(self, values: dict[str, float]) -> None:
        seconds = values.get("S", 0.0) + values.get("P", 0.0) / 1000
        until: list[float] = []

        def over() -> bool:
            if self.axes.busy:
                return False
            until.append(self._now_s + seconds)
            if self._now_s < until[0]:
                return False
            self._ok()
            return True

        self._wait(over)

    def _home(self, values: dict[str, float]) -> None:
        wanted = [letter for letter in values if letter in self._letters]
        group = [
            k
            for k, axis in enumerate(self.axes.settings)
            if axis.switch and (not wanted or axis.letter in wanted)
        ]
        high = tuple(k for k in group if self._letters[k] == "Z")
        flat = tuple(k for k in group if self._letters[k] != "Z")
        scale = self.axes.scale

        def begin() -> bool:
            if self.axes.busy:
                return False
            self._homing = HomingCycle(
                self.axes,
                [one for one in (high, flat) if one],
                self._config.homing_seek_min / 60,
                self._config.homing_feed_min / 60 / scale * min(scale, 4.0),
                self._config.pull_off,
                low_is_zero=True,
            )
            self._homing.start()
            self._wait(lambda: self._homing is None)
            return False

        self._wait(begin)

    def _home_on(self, cycle: HomingCycle) -> None:
        how = cycle.tick(self._now_s)
        if how is Homing.RUNNING:
            return
        self._homing = None
        self.axes.freeze()
        if how is Homing.DONE:
            self._waiting = None
            self._ok()
            return
        self._say("Error:Homing Failed")
        self._kill()


def _clamped(axis: AxisSettings, value: float) -> float:
    """Software end-stops, without a word."""
    if axis.switch is None:
        return value
    return min(max(value, 0.0), axis.travel)


class MarlinSimulator(SerialSimulator):
    """The board behind its port."""

    key: ClassVar[str] = "marlin"
    own_process: ClassVar[bool] = False
    Config = MarlinConfig

    @classmethod
    def from_config(
        cls, config: MarlinConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the simulator; no I/O."""
        machine = MarlinMachine(config)
        return cls(
            gantry_in_world(machine, context),
            config,
            rng=context.rng,
            name=name,
            verbs=gantry_verbs(machine, context.clock),
        )
