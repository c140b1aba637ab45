"""Motions as functions of time, and their history: where was it at any moment?"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray


class Motion(Protocol):
    """Where something is, seconds after the motion began; it stands after the end."""

    @property
    def duration_s(self) -> float:
        """When it stands still."""
        ...

    def at(self, t_s: float) -> FloatArray:
        """(n,) place after ``t_s``."""
        ...

    def halted(self, t_s: float) -> Motion:
        """The same motion, told to stop at ``t_s``."""
        ...


@dataclass(frozen=True)
class Ramp:
    """Along a path of length 1: accelerate, run, brake.

    Attributes:
        speed: largest rate, 1/s.
        acceleration: of both ramps, 1/s^2.
        halt_s: when it is told to brake early; inf: never.
    """

    speed: float
    acceleration: float
    halt_s: float = np.inf

    @property
    def _peak(self) -> float:
        return min(self.speed, float(np.sqrt(self.acceleration)))

    @property
    def _whole_s(self) -> float:
        return 1 / self._peak + self._peak / self.acceleration

    @property
    def duration_s(self) -> float:
        """When it stands still."""
        if self.halt_s >= self._whole_s:
            return self._whole_s
        return self.halt_s + self._rate(self.halt_s) / self.acceleration

    def at(self, t_s: float) -> float:
        """Share of the path, 0 .. 1."""
        if t_s <= self.halt_s:
            return self._place(t_s)
        rate = self._rate(self.halt_s)
        brake = min(t_s - self.halt_s, rate / self.acceleration)
        done = self._place(self.halt_s)
        return done + rate * brake - self.acceleration * brake**2 / 2

    def _rate(self, t_s: float) -> float:
        ramp = min(t_s, self._whole_s - t_s) * self.acceleration
        return float(np.clip(ramp, 0.0, self._peak))

    def _place(self, t_s: float) -> float:
        t = float(np.clip(t_s, 0.0, self._whole_s))
        rise = self._peak / self.acceleration
        if t > self._whole_s - rise:
            return 1 - self.acceleration * (self._whole_s - t) ** 2 / 2
        if t < rise:
            return self.acceleration * t**2 / 2
        return self._peak * (t - rise / 2)


@dataclass(frozen=True, eq=False)
class StraightMove:
    """From one place to another (n,), all axes in step."""

    start: FloatArray
    target: FloatArray
    ramp: Ramp

    @classmethod
    def limited(
        cls,
        start: FloatArray,
        target: FloatArray,
        *,
        speed: FloatArray,
        acceleration: FloatArray,
    ) -> StraightMove:
        """As fast as the slowest axis allows."""
        way = np.maximum(np.abs(target - start), 1e-12)
        ramp = Ramp(float((speed / way).min()), float((acceleration / way).min()))
        return cls(start, target, ramp)

    @property
    def duration_s(self) -> float:
        """When it stands still."""
        moved = bool(np.abs(self.target - self.start).max() > 1e-12)
        return self.ramp.duration_s if moved else 0.0

    def at(self, t_s: float) -> FloatArray:
        """(n,) place after ``t_s``."""
        if t_s >= self.ramp.duration_s and not np.isfinite(self.ramp.halt_s):
            return self.target
        return np.asarray(self.start + self.ramp.at(t_s) * (self.target - self.start))

    def halted(self, t_s: float) -> StraightMove:
        """The same motion, braking from ``t_s``."""
        halt = min(t_s, self.ramp.halt_s)
        return replace(self, ramp=replace(self.ramp, halt_s=max(0.0, halt)))


@dataclass(frozen=True, eq=False)
class StepMove:
    """A motor that steps at one rate through points (k,), and stops dead."""

    points: tuple[float, ...]
    rate: float
    halt_s: float = np.inf

    @property
    def duration_s(self) -> float:
        """When it stands still."""
        return min(float(self._times[-1]), self.halt_s)

    @property
    def _times(self) -> FloatArray:
        legs = np.abs(np.diff(self.points)) / self.rate
        return np.concatenate([[0.0], np.cumsum(legs)])

    def at(self, t_s: float) -> FloatArray:
        """(1,) place after ``t_s``."""
        t = min(t_s, self.halt_s)
        return np.array([np.interp(t, self._times, self.points)])

    def passed(self, t_s: float) -> list[float]:
        """Turning points passed until ``t_s``, and the place reached."""
        t = min(t_s, self.halt_s)
        turns = [
            p for p, when in zip(self.points, self._times, strict=True) if when < t
        ]
        return [*turns, float(self.at(t)[0])]

    def halted(self, t_s: float) -> StepMove:
        """The same motion, stopped at ``t_s``."""
        return replace(self, halt_s=min(max(0.0, t_s), self.halt_s))


@dataclass(eq=False)
class History:
    """Every motion of one device with its start time, the oldest first."""

    first: FloatArray
    begun_s: list[float] = field(default_factory=list)
    motions: list[Motion] = field(default_factory=list)

    def at(self, t_s: float) -> FloatArray:
        """(n,) where it was at a moment."""
        index = bisect_right(self.begun_s, t_s) - 1
        if index < 0:
            return self.first
        return self.motions[index].at(t_s - self.begun_s[index])

    def begin(self, motion: Motion, t_s: float) -> None:
        """Start a motion; it must start where the device is."""
        self.begun_s.append(t_s)
        self.motions.append(motion)

    def halt(self, t_s: float) -> None:
        """Tell the motion in progress to stop."""
        if self.motions:
            self.motions[-1] = self.motions[-1].halted(t_s - self.begun_s[-1])

    @property
    def end_s(self) -> float:
        """When the last motion ends or ended; -inf before the first."""
        if not self.motions:
            return -np.inf
        return self.begun_s[-1] + self.motions[-1].duration_s

    def moving_between(self, start_s: float, end_s: float) -> bool:
        """Whether anything moved in an interval."""
        return any(
            begun < end_s and begun + motion.duration_s > start_s
            for begun, motion in zip(self.begun_s, self.motions, strict=True)
        )
