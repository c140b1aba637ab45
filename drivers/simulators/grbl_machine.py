"""GRBL 1.1, grblHAL or FluidNC as a byte machine: real-time bytes, lines, ``$``.

Lines are read from a receive buffer that really overflows; real-time bytes act at
once. A command that takes its time keeps the lines behind it waiting.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from drivers.simulators.gcode_words import WordError, cleaned, words
from drivers.simulators.grbl_lines import Receiver, Speaker
from drivers.simulators.grbl_motion import MotionControl
from drivers.simulators.grbl_profiles import GrblConfig, profile_of
from drivers.simulators.grbl_status import StatusWriter, settings_of
from drivers.simulators.grbl_words import Modal, parsed

if TYPE_CHECKING:
    from collections.abc import Callable

_RESET, _QUERY, _HOLD, _RESUME, _JOG_CANCEL, _DOOR = 0x18, 0x3F, 0x21, 0x7E, 0x85, 0x84
_HAL_QUERY, _HAL_RESUME, _HAL_HOLD, _HAL_MODES, _HAL_FULL = 0x80, 0x81, 0x82, 0x83, 0x87
_LOCKED, _NOT_IDLE, _TOO_LONG = 9, 8, 11
_UNKNOWN, _NO_HOMING, _CRITICAL = 3, 5, 79
_BAD_NUMBER, _NEGATIVE = 2, 4
_VALUE = re.compile(r"\d{1,9}(\.\d{0,9})?", re.ASCII)
_QUERY_BYTES = 20  # that arrive until the main loop comes round to answer
_HOMING_REPORT_S = 0.5


class GrblMachine:
    """What the controller does with bytes and time.

    Args:
        config: firmware and machine.
    """

    def __init__(self, config: GrblConfig) -> None:
        self._config = config
        self.profile = profile_of(config)
        self.settings = settings_of(config) | config.settings
        self._speaker = Speaker(sticky=self.profile.sticky_error)
        self._receiver = Receiver(self.profile)
        self.motion = MotionControl(config, self.profile, self.settings, self._speaker)
        self.axes = self.motion.axes
        self._status = StatusWriter(self.axes, self.profile)
        self._now_s = 0.0
        self._boot_until_s = 0.0
        self._heard = 0
        self._refused_next: int | None = None
        self._commands = self._dollar_commands()
        self._bytes_at_once = self._real_time_bytes()
        self._fresh()

    # ------------------------------------------------------------ restarts

    def _fresh(self) -> None:
        self._receiver.clear()
        self._speaker.refusing = 0
        self._queries = 0
        self._next_report_s = 0.0
        self._modal = Modal()
        self._status.restart()

    def opened(self, now_s: float) -> None:
        """A host has opened the port; many boards restart then."""
        if self._config.resets_on_open:
            self.power_up(now_s)

    def power_up(self, now_s: float) -> None:
        """The processor starts: counters are 0 wherever the axes stand."""
        self._now_s = max(now_s, self._now_s)
        self.motion.power_up()
        self._speaker.clear()
        self._fresh()
        self._boot_until_s = self._now_s + self._config.boot_s

    def _greet(self) -> None:
        self._speaker.say("")
        self._speaker.say(self.profile.banner)
        if self.motion.alarm:
            self._speaker.say(self.profile.unlock_hint)

    def _soft_reset(self) -> None:
        self.motion.reset()
        self._fresh()
        self._greet()

    # ------------------------------------------------------------ bytes

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the host; real-time bytes never enter the line."""
        self.tick(now_s)
        if self._boot_until_s:
            return
        for byte in data:
            self._heard += 1
            act = self._bytes_at_once.get(byte)
            if act is not None:
                act()
            else:
                self._receiver.put(byte)
            if self._heard % _QUERY_BYTES == 0:
                self._answer_queries()
            slow = self.profile.bytes_per_line
            if slow and self._heard >= slow:
                self._heard = 0
                self._main_loop(most=1)
        self._heard = 0
        self._main_loop()

    def tick(self, now_s: float) -> None:
        """Let time pass."""
        self._now_s = max(now_s, self._now_s)
        if self._boot_until_s:
            if self._now_s < self._boot_until_s:
                return
            self._boot_until_s = 0.0
            self._greet()
        homing = self.motion.homing is not None
        if self.motion.tick(self._now_s):
            self.motion.restart(locked=True)
            self._fresh()
            self._greet()
        elif homing and self.motion.homing is None:
            self._homed()
        self._report_unasked()
        self._main_loop()

    def take_output(self) -> bytes:
        """What it said since it was last asked."""
        return self._speaker.take()

    def _real_time_bytes(self) -> dict[int, Callable[[], None]]:
        """What acts at once, by byte; a board may have ``!`` and ``~`` switched off."""
        motion = self.motion
        acts: dict[int, Callable[[], None]] = {
            _RESET: self._soft_reset,
            _QUERY: self._queried,
            _JOG_CANCEL: motion.cancel_jog,
            _DOOR: lambda: motion.hold(door=True),
        }
        if self._config.hold_byte:
            acts |= {_HOLD: motion.hold, _RESUME: motion.resume}
        if self.profile.binary_commands:
            acts |= {
                _HAL_QUERY: self._queried,
                _HAL_FULL: self._queried,
                _HAL_HOLD: motion.hold,
                _HAL_RESUME: motion.resume,
                _HAL_MODES: lambda: self._speaker.say(f"[GC:{self._modal.text()}]"),
            }
        return acts

    def _queried(self) -> None:
        many = self.profile.answers_every_query
        self._queries = self._queries + 1 if many else 1

    # ------------------------------------------------------------ lines

    def _main_loop(self, most: int | None = None) -> None:
        motion = self.motion
        done = 0
        while True:
            self._answer_queries()
            if motion.on_hold:
                return
            if motion.waiting is not None:
                waiting = motion.waiting
                if not waiting():
                    return
                if motion.waiting is waiting:
                    motion.waiting = None
            if motion.dead or motion.sleeping or done == most:
                return
            line = self._receiver.next_line()
            if line is None:
                return
            self._do(line)
            done += 1

    def _answer_queries(self) -> None:
        if self.motion.dead:
            return
        if self.motion.homing is not None:
            if self.profile.answers_every_query and self._queries:
                self._report_while_homing()
            return
        for _ in range(self._queries):
            self._speaker.say(self._report())
        self._queries = 0

    def _report_while_homing(self) -> None:
        """Now and then, and one for all that were asked."""
        if self._now_s >= self._next_report_s:
            self._next_report_s = self._now_s + _HOMING_REPORT_S
            self._queries = 0
            self._speaker.say(self._report())

    def _report_unasked(self) -> None:
        every_s = self._config.auto_report_s
        if every_s and self._now_s >= self._next_report_s and not self.motion.dead:
            self._next_report_s = self._now_s + every_s
            self._speaker.say(self._report())

    def _homed(self) -> None:
        if self._queries and not self.profile.answers_every_query:
            self._speaker.say(self._report("Home"))
            self._queries = 0
        self._speaker.ok()

    def _do(self, line: bytes) -> None:
        """One line; it is answered now or, where it takes its time, later."""
        speaker, motion = self._speaker, self.motion
        text = cleaned(line)
        forced, self._refused_next = self._refused_next, None
        if len(text) > self.profile.line_max:
            speaker.error(_TOO_LONG)
        elif forced is not None:
            speaker.error(forced)
        elif not text:
            speaker.ok()
        elif text.startswith("$"):
            self._dollar(text)
        elif motion.alarm or motion.axes.jogging:
            speaker.error(_LOCKED)
        elif speaker.refusing:
            speaker.error(speaker.refusing)
        else:
            self._gcode(text)

    def _gcode(self, text: str) -> None:
        try:
            motion = parsed(words(text), self._modal, self.motion.letters)
        except WordError as error:
            self._speaker.error(error.code)
            return
        if motion.dwell_s is not None:
            self.motion.dwell(motion.dwell_s)
        elif motion.target:
            self.motion.move(motion)
        else:
            self._speaker.ok()

    # ------------------------------------------------------------ $

    def _dollar_commands(self) -> dict[str, Callable[[], None]]:
        return {
            "$I": self._identify,
            "$$": self._list_settings,
            "$G": lambda: self._tell(f"[GC:{self._modal.text()}]"),
            "$#": lambda: self._tell(
                "[G54:" + ",".join(["0.000"] * len(self.axes.settings)) + "]"
            ),
            "$X": self._unlock,
            "$C": self._check_mode,
            "$SLP": self._sleep,
        }

    def _dollar(self, text: str) -> None:
        """Commands of the machine, not of G-code."""
        busy = self.axes.busy or self.motion.homing is not None
        if text.startswith("$J="):
            self._jog(text[3:])
        elif busy and text != "$G":
            self._speaker.error(_NOT_IDLE)
        elif text in self._commands:
            self._commands[text]()
        elif text.startswith("$H"):
            self._home(text[2:])
        elif "=" in text:
            self._write_setting(text)
        else:
            self._speaker.error(_UNKNOWN)

    def _tell(self, line: str) -> None:
        self._speaker.say(line)
        self._speaker.ok()

    def _identify(self) -> None:
        profile, count = self.profile, len(self.axes.settings)
        self._speaker.say(f"[VER:{profile.version}:{self._config.user_text}]")
        self._speaker.say(profile.options)
        if count > 3:
            self._speaker.say(f"[AXS:{count}:{self.motion.letters}]")
        self._speaker.ok()

    def _list_settings(self) -> None:
        for number, value in self._shown_settings().items():
            self._speaker.say(f"${number}={value}")
        self._speaker.ok()

    def _shown_settings(self) -> dict[str, str]:
        """FluidNC keeps its machine in a file and shows few numbers."""
        if self._config.profile != "fluidnc":
            return self.settings
        return {number: self.settings[number] for number in ("10", "13", "20", "22")}

    def _write_setting(self, text: str) -> None:
        number, _, value = text[1:].partition("=")
        if number not in self._shown_settings():
            self._speaker.error(_UNKNOWN)
            return
        if not _VALUE.fullmatch(value):
            self._speaker.error(_NEGATIVE if value.startswith("-") else _BAD_NUMBER)
            return
        is_whole = "." not in self.settings[number]
        self.settings[number] = str(int(float(value))) if is_whole else value
        self._speaker.ok()

    def _unlock(self) -> None:
        if self.motion.alarm and self.motion.critical:
            self._speaker.error(_CRITICAL)
            return
        if self.motion.alarm:
            self.motion.alarm = 0
            self._speaker.say("[MSG:Caution: Unlocked]")
        self._speaker.ok()

    def _check_mode(self) -> None:
        """Read lines without doing them; leaving it resets."""
        if self.motion.checking:
            self._tell("[MSG:Disabled]")
            self._soft_reset()
        elif self.motion.alarm:
            self._speaker.error(_NOT_IDLE)
        else:
            self.motion.checking = True
            self._tell("[MSG:Enabled]")

    def _sleep(self) -> None:
        self.motion.sleeping = True
        self._speaker.ok()

    def _jog(self, text: str) -> None:
        if self.motion.alarm or (self.axes.busy and not self.axes.jogging):
            self._speaker.error(_NOT_IDLE)
            return
        try:
            motion = parsed(words(text), Modal(), self.motion.letters, jog=True)
        except WordError as error:
            self._speaker.error(error.code)
            return
        self.motion.jog(motion)

    def _home(self, letters: str) -> None:
        axes = self.axes.settings
        wanted = [k for k, a in enumerate(axes) if a.letter in letters]
        enabled = int(self.settings["22"])
        if letters and not (self.profile.homes_axes and wanted):
            self._speaker.error(_UNKNOWN)
        elif not enabled & 1 or (letters and not self.motion.homes_alone):
            self._speaker.error(_NO_HOMING)
        elif self.motion.alarm and self.motion.critical:
            self._speaker.error(_CRITICAL)
        else:
            self.motion.home(wanted or self.motion.cycle)

    # ------------------------------------------------------------ reports

    def _report(self, state: str = "") -> str:
        return self._status.report(
            state or self.motion.state,
            mask=int(self.settings["10"]),
            inches=self.settings["13"] == "1",
            rx_free=self._receiver.free,
            homed=self.motion.homed_text,
            shown=self.axes.pressed(),
        )

    # ------------------------------------------------------------ truth

    def refuse_next(self, code: int) -> None:
        """Answer the next line with this error."""
        self._refused_next = code

    def places(self) -> tuple[float, ...]:
        """True joints of the arm, rad or mm; axes it does not drive stand at zero."""
        rest = len(self._config.axes) - len(self.axes.settings)
        return (*self.axes.joints(), *(0.0 for _ in range(rest)))

    def state(self) -> dict[str, object]:
        """For the fault channel."""
        return {
            "state": self.motion.state,
            "alarm": self.motion.alarm,
            "dead": self.motion.dead,
            "counter": [float(v) for v in self.axes.counter],
            "truth": [float(v) for v in self.axes.truth],
            "homed": sorted(self.motion.homed),
        }
