"""The mechanics behind a G-code controller: axes, switches, and a queue of moves.

A controller counts steps; where an axis truly is, is another matter. Lengths in mm,
angles in deg, as G-code has them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from drivers.virtual_motion import StraightMove
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from mvp.geometry import FloatArray


class AxisSettings(FileModel):
    """One axis; its truth is 0 at the switch and runs towards the other end.

    Attributes:
        letter: in G-code.
        travel: from the switch to the other end, mm or deg.
        rate_min: fastest, mm or deg per minute.
        acceleration: mm or deg per s^2.
        steps_per_unit: resolution of the counter.
        switch: which end has the homing switch; None: the axis is not homed.
        start: where it stands when the power comes on, from the switch, mm or deg.
        joint_zero: joint value where the truth is 0, mm or deg.
        joint_sign: direction of the joint.
    """

    letter: str = Field(pattern="^[XYZABC]$")
    travel: float = Field(gt=0)
    rate_min: float = Field(gt=0)
    acceleration: float = Field(gt=0)
    steps_per_unit: float = Field(default=250.0, gt=0)
    switch: str | None = Field(default="high", pattern="^(high|low)$")
    start: float = 0.0
    joint_zero: float = 0.0
    joint_sign: int = 1


def slide(
    letter: str,
    travel: float,
    *,
    start: float,
    joint_zero: float,
    switch: str,
    steps_per_unit: float,
) -> AxisSettings:
    """X, Y or Z of a camera gantry, in mm; Z is slower."""
    upright = letter == "Z"
    return AxisSettings(
        letter=letter,
        travel=travel,
        rate_min=9000 if upright else 18_000,
        acceleration=500 if upright else 1000,
        steps_per_unit=steps_per_unit,
        switch=switch,
        start=start,
        joint_zero=joint_zero,
    )


def camera_head() -> tuple[AxisSettings, ...]:
    """A pans, B tilts; neither is homed."""
    return tuple(
        AxisSettings(
            letter=letter,
            travel=travel,
            rate_min=5400,
            acceleration=300,
            steps_per_unit=160,
            switch=None,
        )
        for letter, travel in (("A", 180.0), ("B", 100.0))
    )


@dataclass(frozen=True, eq=False)
class Block:
    """A straight move that waits for its turn.

    Attributes:
        target: (n,) counter values, nan where an axis stays.
        rate: along the path, units per s; inf for as fast as it goes.
        jog: whether it belongs to a jog.
        seek: switches that end it: axis indices.
    """

    target: FloatArray
    rate: float
    jog: bool = False
    seek: tuple[int, ...] = ()


@dataclass(eq=False)
class Axes:
    """Counters, truth, and the queue; driven by ``tick``.

    Attributes:
        counter: (n,) what the controller believes, mm or deg.
        offset: (n,) truth minus counter.
        press: axes whose switch is held down by hand.
        broken: axes whose switch never closes any more.
        begun: motions that were ever queued.
    """

    settings: tuple[AxisSettings, ...]
    scale: float = 1.0
    counter: FloatArray = field(init=False)
    offset: FloatArray = field(init=False)
    press: set[int] = field(default_factory=set)
    broken: set[int] = field(default_factory=set)
    override: float = 1.0
    begun: int = 0
    _queue: deque[Block] = field(default_factory=deque)
    _move: StraightMove | None = None
    _block: Block | None = None
    _began_s: float = 0.0
    _now_s: float = 0.0
    _held: bool = False

    def __post_init__(self) -> None:
        self.counter = np.zeros(len(self.settings))
        self.offset = np.array([axis.start for axis in self.settings])

    @property
    def truth(self) -> FloatArray:
        """(n,) where the axes are, from their switches, mm or deg."""
        return self.counter + self.offset

    @property
    def quantised(self) -> FloatArray:
        """(n,) the counter in whole steps."""
        steps = np.array([axis.steps_per_unit for axis in self.settings])
        return np.asarray(np.round(self.counter * steps) / steps)

    @property
    def waiting(self) -> int:
        """Moves in the queue, the one under way among them."""
        return len(self._queue) + (self._block is not None)

    @property
    def busy(self) -> bool:
        """Whether anything is queued or moves."""
        return self.waiting > 0

    @property
    def jogging(self) -> bool:
        """Whether the move under way is a jog."""
        return self._block is not None and self._block.jog

    @property
    def braking(self) -> bool:
        """Whether it was told to hold and has not stopped yet."""
        return self._held and self._move is not None

    @property
    def held(self) -> bool:
        """Whether it stands because it was told to hold."""
        return self._held and self._move is None

    @property
    def rate_now(self) -> float:
        """Speed along the path, units per minute."""
        if self._move is None:
            return 0.0
        t = self._now_s - self._began_s
        step = 1e-3
        way = self._move.at(t + step) - self._move.at(t)
        return float(np.linalg.norm(way)) / step * 60

    @property
    def planned(self) -> FloatArray:
        """(n,) where the last queued move will end."""
        for block in reversed(self._queue):
            return self._filled(block.target)
        if self._block is not None:
            return self._filled(self._block.target)
        return self.counter.copy()

    def pressed(self) -> tuple[int, ...]:
        """Axes whose switch is covered."""
        return self._covered(self.truth)

    def _covered(self, truth: FloatArray) -> tuple[int, ...]:
        found = [
            k
            for k, axis in enumerate(self.settings)
            if (axis.switch == "high" and truth[k] >= -1e-9)
            or (axis.switch == "low" and truth[k] <= 1e-9)
        ]
        return tuple(sorted({*found, *self.press} - self.broken))

    def queue(self, block: Block) -> None:
        """Add a move behind the others."""
        self._queue.append(block)
        self.begun += 1

    def hold(self, now_s: float) -> None:
        """Brake; what is left of the move stays in the queue."""
        self.tick(now_s)
        self._held = True
        if self._move is not None:
            self._move = self._move.halted(now_s - self._began_s)

    def resume(self, now_s: float) -> None:
        """Go on after a hold."""
        self.tick(now_s)
        self._held = False

    def freeze(self) -> None:
        """Stop dead and forget the queue; steps may be lost, the count goes on."""
        self._queue.clear()
        self._move = self._block = None
        self._held = False

    def tick(self, now_s: float) -> tuple[int, ...]:
        """Let time pass.

        Returns:
            Axes whose switch ended a seeking move in the meantime.
        """
        met: tuple[int, ...] = ()
        while True:
            if self._move is None and not self._take_next():
                break
            if self._move is None:
                break
            end_s = self._began_s + self._move.duration_s
            self._place(self._switch_s(min(now_s, end_s)))
            met = self._met_switch()
            if met or now_s < end_s:
                break
            self._finish(end_s)
            if self._held:
                break
        if self._move is None and not met:
            self._now_s = max(now_s, self._now_s)
        return met

    def _filled(self, target: FloatArray) -> FloatArray:
        return np.where(np.isnan(target), self.counter, target)

    def _take_next(self) -> bool:
        """Start the next move, or the rest of the one that was held."""
        if self._held:
            return False
        if self._block is None:
            if not self._queue:
                return False
            self._block = self._queue.popleft()
        self._move = self._moved(self._block)
        self._began_s = self._now_s
        return True

    def _moved(self, block: Block) -> StraightMove:
        """A trapezoid that no axis objects to, to a whole number of steps."""
        target = self._filled(block.target)
        steps = np.array([axis.steps_per_unit for axis in self.settings])
        target = np.where(
            np.isnan(block.target), target, np.round(target * steps) / steps
        )
        way = np.abs(target - self.counter)
        length = max(float(np.linalg.norm(way)), 1e-12)
        along = block.rate * self.override * self.scale
        fastest = np.array([a.rate_min / 60 for a in self.settings]) * self.scale
        asked = np.full(len(way), np.inf)
        np.multiply(along, way / length, out=asked, where=way > 0)
        speed = np.minimum(fastest, asked)
        ramps = np.array([a.acceleration for a in self.settings]) * self.scale
        return StraightMove.limited(
            self.counter, target, speed=np.maximum(speed, 1e-9), acceleration=ramps
        )

    def _switch_s(self, t_s: float) -> float:
        """When a seeking move meets its first switch, at most ``t_s``."""
        if self._block is None or not self._block.seek or not self._covered_at(t_s):
            return t_s
        low_s, high_s = min(self._now_s, t_s), t_s
        for _ in range(_HALVINGS):
            middle_s = (low_s + high_s) / 2
            if self._covered_at(middle_s):
                high_s = middle_s
            else:
                low_s = middle_s
        return high_s

    def _covered_at(self, t_s: float) -> bool:
        """Whether a switch that the move seeks is covered at a moment ahead."""
        if self._move is None or self._block is None:
            return False
        truth = self._move.at(t_s - self._began_s) + self.offset
        return bool(set(self._covered(truth)) & set(self._block.seek))

    def _place(self, t_s: float) -> None:
        """Counters follow the move; an axis at its mechanical end does not."""
        if self._move is None:
            return
        self._now_s = max(t_s, self._now_s)
        before = self.truth
        counter = self._move.at(t_s - self._began_s)
        truth = before + (counter - self.counter)
        self.counter = counter
        self.offset = np.clip(truth, self._lowest, self._highest) - counter

    @property
    def _lowest(self) -> FloatArray:
        return np.array([_ends(axis)[0] for axis in self.settings])

    @property
    def _highest(self) -> FloatArray:
        return np.array([_ends(axis)[1] for axis in self.settings])

    def _met_switch(self) -> tuple[int, ...]:
        if self._block is None or not self._block.seek:
            return ()
        return tuple(k for k in self.pressed() if k in self._block.seek)

    def _finish(self, end_s: float) -> None:
        """The move under way has ended; a held one keeps its block."""
        done = self._move is not None and not np.isfinite(self._move.ramp.halt_s)
        self._move = None
        self._now_s = max(end_s, self._now_s)
        if done:
            self._block = None

    def back_to_switch(self, axis: int) -> None:
        """Undo the little that an axis went beyond its switch between two ticks."""
        beyond = float(self.truth[axis])
        if abs(beyond) < _OVERRUN:
            self.counter[axis] -= beyond

    def turn_by_hand(self, axis: int, amount: float) -> None:
        """Push an axis; the counter does not notice."""
        self.offset[axis] += amount

    def joints(self) -> tuple[float, ...]:
        """True joints: mm, and rad for A, B and C."""
        return tuple(
            float(_joint(axis, truth))
            for axis, truth in zip(self.settings, self.truth, strict=True)
        )


_HALVINGS = 50
_OVERRUN = 2.0  # between switch and mechanical end, mm or deg


def _ends(axis: AxisSettings) -> tuple[float, float]:
    """Mechanical ends, from the switch."""
    if axis.switch == "high":
        return -axis.travel - _OVERRUN, _OVERRUN
    if axis.switch == "low":
        return -_OVERRUN, axis.travel + _OVERRUN
    return -axis.travel, axis.travel


def _joint(axis: AxisSettings, truth: float) -> float:
    value = axis.joint_zero + axis.joint_sign * truth
    return float(np.radians(value)) if axis.letter in "ABC" else value
