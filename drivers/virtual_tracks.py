"""Motions that somebody else makes: places reported one by one, with their times."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray

_KEPT_S = 120.0
_TRIM_AT = 20_000
_SAME = 1e-9


@dataclass(eq=False)
class Track:
    """Where something was: straight between reports, standing after the last one.

    Attributes:
        first: (n,) place before the first report.
    """

    first: FloatArray
    times_s: list[float] = field(default_factory=list)
    places: list[FloatArray] = field(default_factory=list)

    def report(self, t_s: float, place: FloatArray) -> None:
        """Add a place (n,); a report from before the last one is a ValueError."""
        if self.times_s and t_s < self.times_s[-1]:
            raise ValueError("reports of a motion must come in the order of time")
        self.times_s.append(t_s)
        self.places.append(np.asarray(place, dtype=np.float64))
        if len(self.times_s) > _TRIM_AT:
            self._trim(t_s - _KEPT_S)

    def at(self, t_s: float) -> FloatArray:
        """(n,) where it was at a moment."""
        after = bisect_left(self.times_s, t_s)
        if after == len(self.times_s):
            return self.places[-1] if self.places else self.first
        end, place = self.times_s[after], self.places[after]
        if after == 0:
            return self.first if t_s < end else place
        begin, before = self.times_s[after - 1], self.places[after - 1]
        share = (t_s - begin) / (end - begin)
        return np.asarray(before + share * (place - before))

    @property
    def end_s(self) -> float:
        """When it last changed its place; -inf when it never did."""
        for k in range(len(self.times_s) - 1, -1, -1):
            before = self.places[k - 1] if k else self.first
            if np.abs(self.places[k] - before).max() > _SAME:
                return self.times_s[k]
        return -np.inf

    def moving_between(self, start_s: float, end_s: float) -> bool:
        """Whether it changed its place in an interval."""
        low = bisect_left(self.times_s, start_s)
        high = bisect_left(self.times_s, end_s)
        inside = [self.at(start_s), *self.places[low:high], self.at(end_s)]
        return bool(np.ptp(np.stack(inside), axis=0).max() > _SAME)

    def _trim(self, before_s: float) -> None:
        """Forget what nobody will ask for any more."""
        keep = max(bisect_left(self.times_s, before_s) - 1, 0)
        if keep:
            self.first = self.places[keep - 1]
            del self.times_s[:keep], self.places[:keep]


@dataclass(eq=False)
class MotorTrack:
    """A reported motor, and the glass that follows it through a dead band.

    Attributes:
        backlash: > 0 measured from below, < 0 from above; steps.
        start: place of motor and glass before the first report, steps.
    """

    backlash: float
    start: float
    track: Track = field(init=False)

    def __post_init__(self) -> None:
        self.track = Track(np.array([self.start, self.start]))

    def report(self, t_s: float, motor: float) -> None:
        """Where the motor is now; the glass is dragged along."""
        glass = float((self.track.places or [self.track.first])[-1][1])
        low, high = sorted((motor, motor + self.backlash))
        self.track.report(t_s, np.array([motor, np.clip(glass, low, high)]))

    def motor_at(self, t_s: float) -> float:
        """Where the motor is, steps."""
        return float(self.track.at(t_s)[0])

    def glass_at(self, t_s: float) -> float:
        """Where the glass is, in steps of the table."""
        return float(self.track.at(t_s)[1])

    @property
    def begun_s(self) -> float:
        """When its history begins."""
        return -np.inf

    @property
    def end_s(self) -> float:
        """When the motor stands."""
        return self.track.end_s

    def moving_between(self, start_s: float, end_s: float) -> bool:
        """Whether motor or glass moved in an interval."""
        return self.track.moving_between(start_s, end_s)
