"""Moves, holds and alarms of the GRBL family.

What takes its time (a full queue, ``G4``, homing, braking) is a ``waiting`` function: it
is asked again and again until it says that it is over, and no line is read before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from drivers.simulators.gcode_axes import Axes, Block
from drivers.simulators.grbl_homing import Homing, HomingCycle

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.simulators.grbl_lines import Speaker
    from drivers.simulators.grbl_profiles import GrblConfig, Profile
    from drivers.simulators.grbl_words import Motion
    from mvp.geometry import FloatArray

HARD, SOFT, RESET_MOVING, HOME_RESET, NOT_CLEARED, NOT_FOUND = 1, 2, 3, 6, 8, 9
_JOG_OUT = 15

Waiting: TypeAlias = "Callable[[], bool]"


class MotionControl:
    """Axes, what they are homed to, and what keeps them from moving.

    Args:
        config: the machine.
        profile: the firmware.
        settings: ``$`` settings by number, which may change.
        speaker: says answers and alarms.

    Attributes:
        alarm: number of the alarm that stands; 0 for none.
        critical: it needs a reset.
        dead: nothing at all is answered until that.
        homed: axes whose switch was found.
        waiting: what the next line waits for.
        checking: lines are read but not done.
        sleeping: until a reset.
    """

    def __init__(
        self,
        config: GrblConfig,
        profile: Profile,
        settings: dict[str, str],
        speaker: Speaker,
    ) -> None:
        self._config = config
        self._profile = profile
        self._settings = settings
        self._speaker = speaker
        self._now_s = 0.0
        self._pressed: frozenset[int] = frozenset()
        self.axes = Axes(config.driven, config.speed_scale)
        self.letters = "".join(axis.letter for axis in config.driven)
        self.homed: set[int] = set()
        self.restart(locked=config.locked)

    def restart(self, *, locked: bool) -> None:
        """The state after a restart; counters are not touched."""
        self.axes.freeze()
        self.alarm = HARD if locked else 0
        self.critical = self.dead = False
        self.checking = self.sleeping = self.door = False
        self._brakes_to_end = False
        self.waiting: Waiting | None = None
        self.homing: HomingCycle | None = None

    def power_up(self) -> None:
        """Counters are 0 wherever the axes stand."""
        truth = self.axes.truth
        self.restart(locked=True)
        self.axes.counter = np.zeros(len(truth))
        self.axes.offset = truth
        self.homed.clear()

    def reset(self) -> None:
        """Byte 18: everything queued is lost, the position only if it moved."""
        homing = self.homing is not None
        moving = self.axes.busy and not self.axes.held
        swallowed = self.dead or homing
        if homing:
            self.raise_alarm(HOME_RESET)
        elif moving:
            self.raise_alarm(RESET_MOVING)
        if swallowed:
            self._speaker.say("ok")
        if moving or homing:
            self.homed.clear()
        self.restart(locked=bool(self.alarm) or self.sleeping)

    def tick(self, now_s: float) -> bool:
        """Let time pass; True when a failed homing restarts the controller."""
        self._now_s = max(now_s, self._now_s)
        if self.homing is not None:
            return self._home_on(self.homing)
        self.axes.tick(self._now_s)
        self._watch_switches()
        return False

    @property
    def state(self) -> str:
        """As a report names it."""
        if self.sleeping:
            return "Sleep"
        if self.alarm:
            return "Alarm"
        if self.homing is not None:
            return "Home"
        if self.axes.jogging:
            return "Jog"
        if self.axes.braking:
            return "Door:2" if self.door else "Hold:1"
        if self.axes.held:
            return "Door:0" if self.door else "Hold:0"
        if self.checking:
            return "Check"
        return "Run" if self.axes.busy else "Idle"

    @property
    def on_hold(self) -> bool:
        """Whether it stands and waits to be resumed or reset."""
        return self.axes.held and not self._brakes_to_end

    @property
    def cycle(self) -> list[int]:
        """Axes with a switch that ``$H`` homes."""
        head = self._profile.homes_head
        return [
            k
            for k, axis in enumerate(self.axes.settings)
            if axis.switch and (head or axis.letter in "XYZ")
        ]

    @property
    def homes_alone(self) -> bool:
        """Whether one axis may be homed by its letter."""
        return not self._profile.shows_homed or bool(int(self._settings["22"]) & 2)

    @property
    def homed_text(self) -> str:
        """The field ``H:``: whether every switch of ``$H`` was found, and which were."""
        if not self._profile.shows_homed:
            return ""
        said = str(int(set(self.cycle) <= self.homed))
        bits = sum(1 << k for k in self.homed)
        return f"{said},{bits}" if self.homes_alone else said

    # ------------------------------------------------------------ at once

    def hold(self, *, door: bool = False) -> None:
        """Brake and wait; a jog is ended by it."""
        if self.homing is not None or self.alarm or self.sleeping:
            return
        if self.axes.jogging and not door:
            self.cancel_jog()
            return
        self.door = door
        self.axes.hold(self._now_s)

    def resume(self) -> None:
        """Go on after a hold."""
        self.door = False
        self.axes.resume(self._now_s)

    def cancel_jog(self) -> None:
        """Brake and forget the queue, with no alarm; of no effect on other moves."""
        if not self.axes.jogging:
            return
        self._brake_and_then(lambda: None)

    def raise_alarm(self, code: int, *, critical: bool = False) -> None:
        """Lock; a critical alarm needs a reset, and silences GRBL itself."""
        self.alarm = code
        self.critical = critical
        self._speaker.say(f"ALARM:{code}")
        if critical:
            self._speaker.say("[MSG:Reset to continue]")
            self.dead = self._profile.dead_after_alarm
        self.waiting = None

    # ------------------------------------------------------------ lines

    def move(self, motion: Motion) -> None:
        """Queue a move when there is room, and answer then."""
        target = self._target(motion)
        if self._beyond(target):
            self._brake_for_soft_limit()
            return
        if self.checking:
            self._speaker.ok()
            return
        rate = np.inf if motion.rate_min is None else motion.rate_min / 60

        def room() -> bool:
            if self.axes.waiting >= self._profile.blocks:
                return False
            self.axes.queue(Block(target, rate))
            self._speaker.ok()
            return True

        self.waiting = room

    def jog(self, motion: Motion) -> None:
        """Queue a move that can be cancelled; refused beyond the travel."""
        target = self._target(motion)
        if self._beyond(target):
            self._speaker.error(_JOG_OUT)
            return
        rate = (motion.rate_min or 0.0) / 60
        self.axes.queue(Block(target, rate, jog=True))
        self._speaker.ok()

    def dwell(self, seconds: float) -> None:
        """``G4``: answered when the queue is empty and the time is over."""
        until: list[float] = []

        def over() -> bool:
            if self.axes.busy:
                return False
            if not until:
                until.append(self._now_s + seconds)
            if self._now_s < until[0]:
                return False
            self._speaker.ok()
            return True

        self.waiting = over

    def home(self, wanted: list[int]) -> None:
        """Find the switches of these axes, Z first; one without is never found."""
        axes = self.axes.settings
        high = tuple(k for k in wanted if axes[k].letter == "Z")
        flat = tuple(k for k in wanted if axes[k].letter != "Z")
        scale = self.axes.scale
        self.alarm = 0
        self.homing = HomingCycle(
            self.axes,
            [group for group in (high, flat) if group],
            self._config.homing_seek_min / 60,
            self._config.homing_feed_min / 60 / scale * min(scale, 4.0),
            self._config.pull_off,
        )
        self.homing.start()
        self.waiting = lambda: self.homing is None

    # ------------------------------------------------------------ inside

    def _target(self, motion: Motion) -> FloatArray:
        target = np.full(len(self.letters), np.nan)
        base = self.axes.planned
        for letter, value in motion.target.items():
            k = self.letters.index(letter)
            target[k] = value + base[k] if motion.relative else value
        return target

    def _beyond(self, target: FloatArray) -> bool:
        """Whether a soft limit forbids it; only some firmwares ask if it is homed."""
        if self._settings["20"] != "1":
            return False
        for k, axis in enumerate(self.axes.settings):
            known = k in self.homed or self._profile.enforces_unhomed
            if axis.switch is None or not known or np.isnan(target[k]):
                continue
            if not -axis.travel - 1e-6 <= target[k] <= 1e-6:
                return True
        return False

    def _brake_for_soft_limit(self) -> None:
        """Slow down in order, then alarm."""
        self._brake_and_then(lambda: self.raise_alarm(SOFT, critical=True))

    def _brake_and_then(self, act: Callable[[], None]) -> None:
        """Come to rest, forget the queue, and only then do something."""
        self.axes.hold(self._now_s)
        self._brakes_to_end = True

        def stopped() -> bool:
            if self.axes.braking:
                return False
            self._brakes_to_end = False
            self.axes.freeze()
            act()
            return True

        self.waiting = stopped

    def _watch_switches(self) -> None:
        """A switch that is met in a move is an alarm, and so is one that closes at rest."""
        moving = self.axes.busy and not self.axes.held
        pressed = frozenset(self.axes.pressed())
        closed, self._pressed = pressed - self._pressed, pressed
        if self.alarm or self.sleeping or self._settings["21"] != "1":
            return
        if (moving and pressed) or closed:
            self.axes.freeze()
            self.homed.clear()
            self.raise_alarm(HARD, critical=True)

    def _home_on(self, cycle: HomingCycle) -> bool:
        """One step of homing; True when it failed."""
        groups = list(cycle.groups)
        how = cycle.tick(self._now_s)
        self.homed |= {k for g in groups if g not in cycle.groups for k in g}
        if how is Homing.RUNNING:
            return False
        self.homing = None
        self.axes.freeze()
        if how is Homing.DONE:
            return False
        self.homed.clear()
        self.raise_alarm(NOT_FOUND if how is Homing.NOT_FOUND else NOT_CLEARED)
        self._speaker.say("ok")
        return True
