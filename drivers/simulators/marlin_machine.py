"""Marlin 2 as a byte machine: queued moves, checksums, resends.

Answers come in the order of the lines. Nothing can be asked while something moves but
what waits in the queue. Software end-stops clamp without a word. A failed homing or
``M112`` halts the board until it is switched off and on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.simulators.gcode_words import WordError, cleaned, words
from drivers.simulators.marlin_lines import Damaged, LineReader
from drivers.simulators.marlin_motion import QUEUE, MarlinMotion

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivers.simulators.marlin_config import MarlinConfig
    from drivers.simulators.marlin_motion import Waiting

_BUSY_S = 2.0


class MarlinMachine:
    """What the board does with bytes and time.

    Args:
        config: the machine, and how the firmware was built.
    """

    def __init__(self, config: MarlinConfig) -> None:
        self._config = config
        self.motion = MarlinMotion(config)
        self.axes = self.motion.axes
        self._output = bytearray()
        self._now_s = 0.0
        self._boot_until_s = 0.0
        self._commands = {**self._motion_commands(), **self._other_commands()}
        self._fresh()

    def _fresh(self) -> None:
        self._lines = LineReader()
        self._waiting: Waiting | None = None
        self._busy_from_s = 0.0
        self._report_every_s = self._report_at_s = 0.0
        self._halted = False

    def opened(self, now_s: float) -> None:
        """A host has opened the port; 8-bit boards restart then."""
        if self._config.resets_on_open:
            self.power_up(now_s)

    def power_up(self, now_s: float) -> None:
        """The processor starts: counters are 0 wherever the axes stand."""
        self.motion.power_up()
        self._output.clear()
        self._fresh()
        self._now_s = max(now_s, self._now_s)
        self._boot_until_s = self._now_s + self._config.boot_s

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the host."""
        self.tick(now_s)
        if self._boot_until_s or self._halted:
            return
        self._lines.put(data)
        if self._config.emergency_parser:
            for code in self._lines.take_urgent():
                self._commands[code]({})
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
        if self.motion.tick(self._now_s):
            self._say("Error:Homing Failed")
            self._kill()
        self._report_unasked()
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
            "last_line": self._lines.last_number,
        }

    # ------------------------------------------------------------ lines

    def _say(self, line: str) -> None:
        self._output += line.encode("ascii", "replace") + b"\n"

    def _ok(self) -> None:
        if self._config.advanced_ok:
            free = QUEUE - 1 - self.axes.waiting
            self._say(f"ok N{self._lines.last_number} P{max(free, 0)} B3")
        else:
            self._say("ok")

    def _main_loop(self) -> None:
        while not self._halted and not self._boot_until_s:
            if self._waiting is not None:
                if not self._waiting():
                    self._say_busy()
                    return
                self._waiting = None
                self._ok()
            line = self._lines.next_line()
            if line is None:
                return
            self._take(line)

    def _say_busy(self) -> None:
        if self._now_s - self._busy_from_s >= _BUSY_S:
            self._busy_from_s = self._now_s
            self._say("echo:busy: processing")

    def _take(self, line: bytes) -> None:
        """Check number and checksum where there are some."""
        if not line:
            return
        try:
            command = self._lines.checked(line)
        except Damaged as damage:
            last = self._lines.last_number
            self._say(f"Error:{damage.why}, Last Line: {last}")
            self._say(f"Resend: {last + 1}")
            self._say("ok")
            return
        self._do(cleaned(command))

    def _do(self, text: str) -> None:
        """One command; unknown ones are answered by ok all the same."""
        try:
            found = words(text, bare=True)
        except WordError:
            found = []
        head = f"{found[0][0]}{found[0][1]:g}" if found else ""
        action = self._commands.get(head)
        if action is None:
            self._say(f'echo:Unknown command: "{text}"')
            self._ok()
            return
        action(dict(found[1:]))

    # ------------------------------------------------------------ commands

    def _motion_commands(self) -> dict[str, Callable[[Mapping[str, float]], None]]:
        motion = self.motion
        return {
            "G0": lambda v: self._wait(motion.move(v)),
            "G1": lambda v: self._wait(motion.move(v)),
            "G4": lambda v: self._wait(motion.dwell(v)),
            "G28": lambda v: self._wait(motion.home(v)),
            "M400": lambda v: self._wait(motion.finish()),
            "M410": lambda v: self._quick_stop(),
            "M112": lambda v: self._kill(),
        }

    def _other_commands(self) -> dict[str, Callable[[Mapping[str, float]], None]]:
        return {
            "G20": lambda v: self._set("inches", True),
            "G21": lambda v: self._set("inches", False),
            "G90": lambda v: self._set("relative", False),
            "G91": lambda v: self._set("relative", True),
            "M17": lambda v: self._ok(),
            "M110": self._renumber,
            "M111": lambda v: self._ok(),
            "M114": lambda v: self._tell(self.motion.where()),
            "M115": lambda v: self._who(),
            "M154": self._auto_report,
            "M211": lambda v: self._set("end_stops", v.get("S", 1.0) != 0),
        }

    def _wait(self, over: Waiting) -> None:
        self._busy_from_s = self._now_s
        self._waiting = over

    def _tell(self, line: str) -> None:
        self._say(line)
        self._ok()

    def _set(self, mode: str, value: bool) -> None:
        setattr(self.motion, mode, value)
        self._ok()

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

    def _renumber(self, values: Mapping[str, float]) -> None:
        if "N" in values:
            self._lines.last_number = int(values["N"])
        self._ok()

    def _auto_report(self, values: Mapping[str, float]) -> None:
        self._report_every_s = values.get("S", 0.0)
        self._report_at_s = self._now_s + self._report_every_s
        self._ok()

    def _report_unasked(self) -> None:
        if self._report_every_s and self._now_s >= self._report_at_s:
            self._report_at_s = self._now_s + self._report_every_s
            if not self._halted:
                self._say(self.motion.where())

    def _who(self) -> None:
        self._say(
            "FIRMWARE_NAME:Marlin 2.1.2.1 (Jan  1 2023 00:00:00) "
            "SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0 "
            "MACHINE_TYPE:Camera Gantry EXTRUDER_COUNT:0 AXIS_COUNT:5 "
            f"UUID:{self._config.uuid}"
        )
        self._say(f"Cap:EMERGENCY_PARSER:{int(self._config.emergency_parser)}")
        self._tell("Cap:AUTOREPORT_POS:1")
