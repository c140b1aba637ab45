"""Moves of Marlin: clamped without a word, queued, waited for.

What takes its time is a ``Waiting`` function that is asked until it is over.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from drivers.simulators.gcode_axes import Axes, AxisSettings, Block
from drivers.simulators.grbl_homing import Homing, HomingCycle

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivers.simulators.marlin_config import MarlinConfig

QUEUE = 16
_FIRST_RATE_MIN = 1500.0
_MM_PER_INCH = 25.4

Waiting: TypeAlias = "Callable[[], bool]"


class MarlinMotion:
    """Axes and modes.

    Args:
        config: the machine.

    Attributes:
        end_stops: whether software end-stops clamp.
    """

    def __init__(self, config: MarlinConfig) -> None:
        self._config = config
        self._now_s = 0.0
        self.axes = Axes(config.axes, config.speed_scale)
        self.letters = "".join(axis.letter for axis in config.axes)
        self._forget_modes()

    def _forget_modes(self) -> None:
        self.relative = self.inches = False
        self.end_stops = True
        self._rate_min = _FIRST_RATE_MIN
        self._homing: HomingCycle | None = None

    def power_up(self) -> None:
        """Counters are 0 wherever the axes stand."""
        truth = self.axes.truth
        self.axes.freeze()
        self.axes.counter = np.zeros(len(truth))
        self.axes.offset = truth
        self._forget_modes()

    def tick(self, now_s: float) -> bool:
        """Let time pass; True when homing has failed."""
        self._now_s = max(now_s, self._now_s)
        if self._homing is None:
            self.axes.tick(self._now_s)
            return False
        how = self._homing.tick(self._now_s)
        if how is Homing.RUNNING:
            return False
        self._homing = None
        self.axes.freeze()
        return how is not Homing.DONE

    def move(self, values: Mapping[str, float]) -> Waiting:
        """Queue a move as soon as there is room."""
        scale = _MM_PER_INCH if self.inches else 1.0
        if values.get("F", 0) > 0:
            self._rate_min = values["F"] * scale
        target = self._target(values, scale)
        block = Block(target, self._rate_along(target) / 60)

        def room() -> bool:
            if self.axes.waiting >= QUEUE:
                return False
            if not np.isnan(target).all():
                self.axes.queue(block)
            return True

        return room

    def _rate_along(self, target: np.ndarray) -> float:
        """F counts along the sliding axes alone as soon as one of them moves."""
        way = np.nan_to_num(target - self.axes.planned)
        slides = np.array([letter in "XYZ" for letter in self.letters])
        sliding = float(np.linalg.norm(way[slides]))
        if sliding == 0.0:
            return self._rate_min
        return self._rate_min * float(np.linalg.norm(way)) / sliding

    def _target(self, values: Mapping[str, float], scale: float) -> np.ndarray:
        planned = self.axes.planned
        target = np.full(len(self.letters), np.nan)
        for k, axis in enumerate(self.axes.settings):
            if axis.letter in values:
                asked = values[axis.letter] * (scale if axis.letter in "XYZ" else 1.0)
                asked += planned[k] if self.relative else 0.0
                target[k] = _clamped(axis, asked) if self.end_stops else asked
        return target

    def dwell(self, values: Mapping[str, float]) -> Waiting:
        """``G4``: P in milliseconds, S in seconds, after the queue has emptied."""
        seconds = values.get("S", 0.0) + values.get("P", 0.0) / 1000
        until: list[float] = []

        def over() -> bool:
            if self.axes.busy:
                return False
            if not until:
                until.append(self._now_s + seconds)
            return self._now_s >= until[0]

        return over

    def finish(self) -> Waiting:
        """``M400``: until the queue is empty."""
        return lambda: not self.axes.busy

    def home(self, values: Mapping[str, float]) -> Waiting:
        """``G28``: Z first, then the others together."""
        wanted = [letter for letter in values if letter in self.letters]
        group = [
            k
            for k, axis in enumerate(self.axes.settings)
            if axis.switch and (not wanted or axis.letter in wanted)
        ]
        high = tuple(k for k in group if self.letters[k] == "Z")
        flat = tuple(k for k in group if self.letters[k] != "Z")
        begun: list[bool] = []

        def over() -> bool:
            if not begun and not self.axes.busy:
                begun.append(True)
                self._begin_homing([one for one in (high, flat) if one])
            return bool(begun) and self._homing is None

        return over

    def _begin_homing(self, groups: list[tuple[int, ...]]) -> None:
        scale = self.axes.scale
        self._homing = HomingCycle(
            self.axes,
            groups,
            self._config.homing_seek_min / 60,
            self._config.homing_feed_min / 60 / scale * min(scale, 4.0),
            self._config.pull_off,
            low_is_zero=True,
        )
        self._homing.start()

    def where(self) -> str:
        """``M114``: the planned end of the queue; the steps are those made so far."""
        planned, made = self.axes.planned, self.axes.counter
        shown = [f"{x}:{planned[k]:.2f}" for k, x in enumerate(self.letters)]
        steps = [
            f"{axis.letter}:{round(made[k] * axis.steps_per_unit)}"
            for k, axis in enumerate(self.axes.settings)
            if axis.letter in "XYZ"
        ]
        return " ".join([*shown[:3], "E:0.00", *shown[3:], "Count", *steps])


def _clamped(axis: AxisSettings, value: float) -> float:
    """Software end-stops, without a word."""
    if axis.switch is None:
        return value
    return min(max(value, 0.0), axis.travel)
