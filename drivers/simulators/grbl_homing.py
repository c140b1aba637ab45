"""The homing cycle: Z first, then the others together; fast, off, slow, off."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from drivers.simulators.gcode_axes import Axes, Block

if TYPE_CHECKING:
    from mvp.geometry import FloatArray


class Homing(Enum):
    """How a cycle stands."""

    RUNNING = "running"
    DONE = "done"
    NOT_FOUND = "switch not found"
    NOT_CLEARED = "switch not cleared"


@dataclass(eq=False)
class HomingCycle:
    """One homing of a set of axes.

    Attributes:
        groups: axis indices that go together, in order.
        seek: fast rate, units per s.
        feed: slow rate, units per s.
        pull_off: way back from the switch.
        low_is_zero: an axis homed at its low end counts upwards from there.
    """

    axes: Axes
    groups: list[tuple[int, ...]]
    seek: float
    feed: float
    pull_off: float
    low_is_zero: bool = False
    _stage: int = 0
    _missing: set[int] = field(default_factory=set)

    def start(self) -> None:
        """Begin with the first group; without any there is nothing to find."""
        self.axes.freeze()
        if self.groups:
            self._approach()

    def tick(self, now_s: float) -> Homing:
        """Go on; says how it stands."""
        met = self.axes.tick(now_s)
        if not self.groups:
            return Homing.DONE
        if self._stage in (0, 2):
            return self._approaching(met)
        if self.axes.busy:
            return Homing.RUNNING
        if set(self.axes.pressed()) & set(self.groups[0]):
            return Homing.NOT_CLEARED
        return self._next_stage()

    def _approaching(self, met: tuple[int, ...]) -> Homing:
        self._missing -= set(met)
        for k in met:
            self.axes.back_to_switch(k)
        if met:
            self.axes.freeze()
            if self._missing:
                self._drive_to_switches()
                return Homing.RUNNING
            return self._next_stage()
        return Homing.RUNNING if self.axes.busy else Homing.NOT_FOUND

    def _next_stage(self) -> Homing:
        self._stage += 1
        if self._stage == 4:
            self._take_zero()
            self.groups.pop(0)
            self._stage = 0
            if not self.groups:
                return Homing.DONE
        if self._stage in (0, 2):
            self._approach()
        else:
            self._retreat()
        return Homing.RUNNING

    def _approach(self) -> None:
        self._missing = set(self.groups[0])
        self._drive_to_switches()

    def _drive_to_switches(self) -> None:
        fast = self._stage == 0
        target = self._still()
        for k in self._missing:
            axis = self.axes.settings[k]
            reach = 1.5 * axis.travel if fast else 5 * self.pull_off
            target[k] = self.axes.counter[k] + _towards(axis.switch) * reach
        rate = self.seek if fast else self.feed
        self.axes.queue(Block(target, rate, seek=tuple(self._missing)))

    def _retreat(self) -> None:
        target = self._still()
        for k in self.groups[0]:
            axis = self.axes.settings[k]
            way = _towards(axis.switch) * self.pull_off
            target[k] = self.axes.counter[k] - way
        self.axes.queue(Block(target, self.seek))

    def _take_zero(self) -> None:
        """The counters of this group count from the switch, or from the far end."""
        for k in self.groups[0]:
            axis = self.axes.settings[k]
            shift = axis.travel if axis.switch == "low" and not self.low_is_zero else 0
            self.axes.counter[k] += self.axes.offset[k] - shift
            self.axes.offset[k] = shift

    def _still(self) -> FloatArray:
        return np.full(len(self.axes.settings), np.nan)


def _towards(switch: str | None) -> float:
    return -1.0 if switch == "low" else 1.0
