"""GRBL 1.1, grblHAL or FluidNC on a five-axis camera gantry, byte by byte.

Lines are read from a receive buffer that really overflows; real-time bytes act at
once. A command that takes its time (a full queue, ``G4``, homing, the silence after a
limit alarm) keeps the lines behind it waiting.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from drivers.simulators.gantry_machine import gantry_in_world, gantry_verbs
from drivers.simulators.gcode_axes import Axes, Block
from drivers.simulators.gcode_words import WordError, cleaned, words
from drivers.simulators.grbl_homing import Homing, HomingCycle
from drivers.simulators.grbl_profiles import PROFILES, GrblConfig
from drivers.simulators.grbl_status import StatusWriter, settings_of
from drivers.simulators.grbl_words import Modal, Motion, parsed
from drivers.simulators.serial_simulator import SerialSimulator

if TYPE_CHECKING:
    from typing import Self

    from mvp.devices import DeviceContext

_RESET, _QUERY, _HOLD, _RESUME, _JOG_CANCEL, _DOOR = 0x18, 0x3F, 0x21, 0x7E, 0x85, 0x84
_HAL_QUERY, _HAL_RESUME, _HAL_HOLD, _HAL_FULL = 0x80, 0x81, 0x82, 0x87
_LOCKED, _NOT_IDLE, _JOG_OUT, _TOO_LONG = 9, 8, 15, 11
_UNKNOWN, _NO_HOMING_AXIS, _CRITICAL = 3, 5, 79
_HARD, _SOFT, _RESET_MOVING, _HOME_RESET, _NOT_CLEARED, _NOT_FOUND = 1, 2, 3, 6, 8, 9


class _Waiting(Protocol):
    """Something that keeps the next line waiting; True when it is over."""

    def __call__(self) -> bool: ...


class GrblMachine:
    """What the controller does with bytes and time."""

    def __init__(self, config: GrblConfig) -> None:
        self._config = config
        self.profile = PROFILES[config.profile]
        count = 3 if config.profile == "grbl" else len(config.axes)
        self.axes = Axes(config.axes[:count], config.speed_scale)
        self._rest = config.axes[count:]
        self.settings = settings_of(config)
        self._status = StatusWriter(self.axes, self.profile)
        self._output = bytearray()
        self._now_s = 0.0
        self._boot_until_s = 0.0
        self._homed: set[int] = set()
        self._refused_next: int | None = None
        self._fresh(locked=True)

    # ------------------------------------------------------------ restarts

    def _fresh(self, *, locked: bool) -> None:
        """The state after a restart; counters are not touched."""
        self._rx = bytearray()
        self._line = bytearray()
        self._last_end = 0
        self._waiting: _Waiting | None = None
        self._queries = 0
        self._modal = Modal()
        self._sticky = 0
        self._alarm = _HARD if locked else 0
        self._dead = self._critical = False
        self._homing: HomingCycle | None = None
        self._status.restart()

    def opened(self, now_s: float) -> None:
        """A host has opened the port; many boards restart then."""
        if self._config.resets_on_open:
            self.power_up(now_s)

    def power_up(self, now_s: float) -> None:
        """The processor starts: counters are 0 wherever the axes stand."""
        truth = self.axes.truth
        self.axes.freeze()
        self.axes.counter = np.zeros(len(truth))
        self.axes.offset = truth
        self._homed.clear()
        self._output.clear()
        self._fresh(locked=True)
        self._now_s = max(now_s, self._now_s)
        self._boot_until_s = self._now_s + self._config.boot_s

    def _boot(self) -> None:
        self._boot_until_s = 0.0
        self._greet()

    def _greet(self) -> None:
        self._say("")
        self._say(self.profile.banner)
        if self._alarm:
            self._say(self.profile.unlock_hint)

    def _soft_reset(self) -> None:
        """Byte 18: everything queued is lost, the position only if it moved."""
        homing = self._homing is not None
        moving = self.axes.busy and not self.axes.held
        stale = self._dead
        if homing:
            self._raise_alarm(_HOME_RESET, dead=False)
        elif moving:
            self._raise_alarm(_RESET_MOVING, dead=False)
        if stale or homing:
            self._say("ok")
        locked = bool(self._alarm)
        if moving or homing:
            self._homed.clear()
        self.axes.freeze()
        self._fresh(locked=locked)
        self._greet()

    # ------------------------------------------------------------ bytes

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the host; real-time bytes never enter the line."""
        self.tick(now_s)
        if self._boot_until_s:
            return
        for byte in data:
            if self._real_time(byte):
                continue
            if byte < 0x80 and len(self._rx) < self.profile.rx_bytes:
                self._rx.append(byte)
        self._main_loop()

    def tick(self, now_s: float) -> None:
        """Let time pass."""
        self._now_s = max(now_s, self._now_s)
        if self._boot_until_s:
            if self._now_s < self._boot_until_s:
                return
            self._boot()
        if self._homing is not None:
            self._home_on(self._homing)
        else:
            self.axes.tick(self._now_s)
            self._watch_switches()
        self._main_loop()

    def take_output(self) -> bytes:
        """What it said since it was last asked."""
        said, self._output = bytes(self._output), bytearray()
        return said

    def _say(self, line: str) -> None:
        self._output += line.encode("ascii") + b"\r\n"

    def _real_time(self, byte: int) -> bool:
        """Act on a real-time byte; False when it belongs to the line."""
        hal = self.profile.answers_every_query
        if byte == _RESET:
            self._soft_reset()
        elif byte == _QUERY or (hal and byte in (_HAL_QUERY, _HAL_FULL)):
            self._queries = self._queries + 1 if hal else 1
        elif (byte == _HOLD and self._config.hold_byte) or (hal and byte == _HAL_HOLD):
            self._hold()
        elif (byte == _RESUME and self._config.hold_byte) or (
            hal and byte == _HAL_RESUME
        ):
            self.axes.resume(self._now_s)
        elif byte == _JOG_CANCEL:
            if self.axes.jogging:
                self._cancel_jog()
        elif byte == _DOOR:
            self._hold()
        else:
            return byte >= 0x80
        return True

    def _hold(self) -> None:
        if self.axes.busy and self._homing is None and not self._alarm:
            self.axes.hold(self._now_s)

    def _cancel_jog(self) -> None:
        """Brake and forget the queue, with no alarm."""
        self.axes.hold(self._now_s)

        def stopped() -> bool:
            if self.axes.braking:
                return False
            self.axes.freeze()
            return True

        self._waiting = stopped

    # ------------------------------------------------------------ lines

    def _main_loop(self) -> None:
        while True:
            self._answer_queries()
            if self._waiting is not None:
                if not self._waiting():
                    return
                self._waiting = None
            if not self._take_line():
                return

    def _answer_queries(self) -> None:
        if self._dead or self._homing is not None:
            return
        for _ in range(self._queries):
            self._say(self._report())
        self._queries = 0

    def _take_line(self) -> bool:
        """Move bytes from the buffer until a line is complete, and do it."""
        if self._dead:
            return False
        while self._rx:
            byte = self._rx.pop(0)
            if byte not in (0x0A, 0x0D):
                self._line.append(byte)
                continue
            second = byte == 0x0A and self._last_end == 0x0D and not self._line
            self._last_end = byte
            if second and not self.profile.counts_both_ends:
                continue
            line, self._line = bytes(self._line), bytearray()
            self._do(line)
            return True
        return False

    def _do(self, line: bytes) -> None:
        """One line; it is answered now or, where it takes its time, later."""
        text = cleaned(line)
        forced, self._refused_next = self._refused_next, None
        if len(line) > self.profile.line_max:
            self._error(_TOO_LONG)
        elif forced is not None:
            self._error(forced)
        elif not text:
            self._sticky = 0
            self._say("ok")
        elif text.startswith("$J="):
            self._jog(text[3:])
        elif text.startswith("$"):
            self._dollar(text)
        elif self._alarm or self.axes.jogging:
            self._error(_LOCKED)
        elif self._sticky:
            self._error(self._sticky)
        else:
            self._gcode(text)

    def _error(self, code: int) -> None:
        if self.profile.sticky_error:
            self._sticky = code
        self._say(f"error:{code}")

    def _dollar(self, text: str) -> None:
        """Commands of the machine, not of G-code."""
        busy = self.axes.busy or self._homing is not None
        if busy and text != "$G":
            self._error(_NOT_IDLE)
        elif text == "$I":
            self._say(self.profile.version)
            self._say(self.profile.options)
            if len(self.axes.settings) > 3:
                letters = "".join(a.letter for a in self.axes.settings)
                self._say(f"[AXS:{len(letters)}:{letters}]")
            self._ok()
        elif text == "$$":
            for number, value in self._shown_settings().items():
                self._say(f"${number}={value}")
            self._ok()
        elif text == "$G":
            self._say(f"[GC:{self._modal.text()}]")
            self._ok()
        elif text == "$#":
            self._say("[G54:" + ",".join(["0.000"] * len(self.axes.settings)) + "]")
            self._ok()
        elif text == "$X":
            self._unlock()
        elif text.startswith("$H"):
            self._home(text[2:])
        elif "=" in text:
            self._write_setting(text)
        else:
            self._error(_UNKNOWN)

    def _ok(self) -> None:
        self._sticky = 0
        self._say("ok")

    def _shown_settings(self) -> dict[str, str]:
        if self._config.profile != "fluidnc":
            return self.settings
        return {"10": self.settings["10"], "20": "1", "22": "1"}

    def _write_setting(self, text: str) -> None:
        number, _, value = text[1:].partition("=")
        if number not in self._shown_settings():
            self._error(_UNKNOWN)
            return
        self.settings[number] = value
        self._ok()

    def _unlock(self) -> None:
        if self._alarm in (_HARD, _SOFT) and self._critical:
            self._error(_CRITICAL)
            return
        if self._alarm:
            self._alarm = 0
            self._say("[MSG:Caution: Unlocked]")
        self._ok()

    # ------------------------------------------------------------ motion

    def _gcode(self, text: str) -> None:
        letters = "".join(axis.letter for axis in self.axes.settings)
        try:
            motion = parsed(words(text), self._modal, letters)
        except WordError as error:
            self._error(error.code)
            return
        if motion.dwell_s is not None:
            self._wait_for_stillness(motion.dwell_s)
        elif motion.target:
            self._move(motion, letters)
        else:
            self._ok()

    def _target(self, motion: Motion, letters: str) -> np.ndarray:
        target = np.full(len(letters), np.nan)
        base = self.axes.planned
        for letter, value in motion.target.items():
            k = letters.index(letter)
            target[k] = value + base[k] if motion.relative else value
        return target

    def _move(self, motion: Motion, letters: str) -> None:
        target = self._target(motion, letters)
        if self._beyond(target):
            self._brake_for_soft_limit()
            return
        rate = np.inf if motion.rate_min is None else motion.rate_min / 60
        block = Block(target, rate)

        def room() -> bool:
            if self.axes.waiting >= self.profile.blocks:
                return False
            self.axes.queue(block)
            self._ok()
            return True

        self._waiting = room

    def _jog(self, text: str) -> None:
        if self._alarm or (self.axes.busy and not self.axes.jogging):
            self._error(_NOT_IDLE if not self._alarm else _LOCKED)
            return
        letters = "".join(axis.letter for axis in self.axes.settings)
        try:
            motion = parsed(words(text), Modal(), letters, jog=True)
        except WordError as error:
            self._error(error.code)
            return
        target = self._target(motion, letters)
        if self._beyond(target):
            self._error(_JOG_OUT)
            return
        self.axes.queue(Block(target, (motion.rate_min or 0.0) / 60, jog=True))
        self._ok()

    def _beyond(self, target: np.ndarray) -> bool:
        """Whether a soft limit forbids it."""
        if self.settings["20"] != "1":
            return False
        for k, axis in enumerate(self.axes.settings):
            known = k in self._homed or self.profile.enforces_unhomed
            if axis.switch is None or not known or np.isnan(target[k]):
                continue
            if not -axis.travel - 1e-6 <= target[k] <= 1e-6:
                return True
        return False

    def _brake_for_soft_limit(self) -> None:
        """Slow down in order, then alarm and, on GRBL, silence."""
        self.axes.hold(self._now_s)

        def stopped() -> bool:
            if self.axes.braking:
                return False
            self.axes.freeze()
            self._raise_alarm(_SOFT, dead=True)
            return True

        self._waiting = stopped

    def _wait_for_stillness(self, dwell_s: float) -> None:
        """``G4``: answered when the queue is empty and the time is over."""
        until: list[float] = []

        def over() -> bool:
            if self.axes.busy:
                return False
            if not until:
                until.append(self._now_s + dwell_s)
            if self._now_s < until[0]:
                return False
            self._ok()
            return True

        self._waiting = over

    def _watch_switches(self) -> None:
        moving = self.axes.busy and not self.axes.held
        if self.settings["21"] == "1" and moving and self.axes.pressed():
            self.axes.freeze()
            self._homed.clear()
            self._raise_alarm(_HARD, dead=True)

    def _raise_alarm(self, code: int, *, dead: bool) -> None:
        self._alarm = code
        self._critical = dead
        self._say(f"ALARM:{code}")
        if dead:
            self._say("[MSG:Reset to continue]")
            self._dead = self.profile.dead_after_alarm
        self._waiting = None

    # ------------------------------------------------------------ homing

    def _home(self, letters: str) -> None:
        axes = self.axes.settings
        wanted = [k for k, a in enumerate(axes) if not letters or a.letter in letters]
        if letters and (not self.profile.homes_axes or not wanted):
            self._error(_NO_HOMING_AXIS if self.profile.homes_axes else _UNKNOWN)
            return
        if self._critical and self._alarm:
            self._error(_CRITICAL)
            return
        with_switch = [k for k in wanted if axes[k].switch]
        for k in set(wanted) - set(with_switch):
            if letters:  # an axis with no switch is where it is told to be
                self.axes.offset[k] += self.axes.counter[k]
                self.axes.counter[k] = 0.0
        high = tuple(k for k in with_switch if axes[k].letter == "Z")
        flat = tuple(k for k in with_switch if axes[k].letter != "Z")
        scale = self.axes.scale
        self._alarm = 0
        self._homing = HomingCycle(
            self.axes,
            [group for group in (high, flat) if group],
            self._config.homing_seek_min / 60,
            self._config.homing_feed_min / 60 / scale * min(scale, 4.0),
            self._config.pull_off,
        )
        self._homing.start()
        self._waiting = lambda: self._homing is None

    def _home_on(self, cycle: HomingCycle) -> None:
        groups = list(cycle.groups)
        how = cycle.tick(self._now_s)
        if how is Homing.RUNNING:
            self._homed |= {k for g in groups if g not in cycle.groups for k in g}
            return
        self._homing = None
        self.axes.freeze()
        if how is Homing.DONE:
            self._homed |= {k for group in groups for k in group}
            if self._queries and not self.profile.answers_every_query:
                self._say(self._report("Home"))
                self._queries = 0
            self._ok()
            return
        self._homed.clear()
        found = _NOT_FOUND if how is Homing.NOT_FOUND else _NOT_CLEARED
        self._raise_alarm(found, dead=False)
        self._say("ok")
        self._fresh(locked=True)
        self._greet()

    # ------------------------------------------------------------ reports

    def _state(self) -> str:
        if self._alarm:
            return "Alarm"
        if self.axes.braking:
            return "Hold:1"
        if self.axes.held and self.axes.busy:
            return "Hold:0"
        if self.axes.jogging:
            return "Jog"
        return "Run" if self.axes.busy else "Idle"

    def _report(self, state: str = "") -> str:
        homing = {k for k, axis in enumerate(self.axes.settings) if axis.switch}
        return self._status.report(
            state or self._state(),
            mask=int(self.settings["10"]),
            rx_free=self.profile.rx_bytes - len(self._rx),
            homed=homing <= self._homed,
            shown=self.axes.pressed(),
        )

    # ------------------------------------------------------------ truth

    def refuse_next(self, code: int) -> None:
        """Answer the next line with this error."""
        self._refused_next = code

    def places(self) -> tuple[float, ...]:
        """True joints of the arm, rad or mm; axes it does not drive stand at zero."""
        return (*self.axes.joints(), *(0.0 for _ in self._rest))

    def state(self) -> dict[str, object]:
        """For the fault channel."""
        return {
            "state": self._state(),
            "alarm": self._alarm,
            "dead": self._dead,
            "counter": [float(v) for v in self.axes.counter],
            "truth": [float(v) for v in self.axes.truth],
            "homed": sorted(self._homed),
        }


class GrblSimulator(SerialSimulator):
    """The controller behind its port."""

    key: ClassVar[str] = "grbl"
    own_process: ClassVar[bool] = False
    Config = GrblConfig

    @classmethod
    def from_config(
        cls, config: GrblConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the simulator; no I/O."""
        machine = GrblMachine(config)
        return cls(
            gantry_in_world(machine, context),
            config,
            rng=context.rng,
            name=name,
            verbs={
                **gantry_verbs(machine, context.clock),
                "refuse_next": lambda asked: machine.refuse_next(
                    int(str(asked["code"]))
                ),
            },
        )
