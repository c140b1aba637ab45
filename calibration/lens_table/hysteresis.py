"""Where a motor leaves the glass when a step is reached from below and from above."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.stats import chi2

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray

Side: TypeAlias = Literal["from_below", "from_above"]

_IMPROBABLE = 1e-3
_OVERSHOOT_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class BothSides:
    """Repeated readings of something that follows the glass: f_cal, d, a, an edge's place.

    Attributes:
        steps: (k,), the motor steps that were reached, distinct and rising.
        below: (k, r), readings after an approach from below.
        above: (k, q), readings after an approach from above.
        slope: (k,), change of the reading by one step, from the table.
    """

    steps: IntArray
    below: FloatArray
    above: FloatArray
    slope: FloatArray

    def __post_init__(self) -> None:
        count = len(self.steps)
        if self.below.shape[:1] != (count,) or self.above.shape[:1] != (count,):
            raise ValueError("every step needs readings from both sides")
        if min(self.below.shape[1], self.above.shape[1]) < 2:
            raise ValueError("two or more readings are needed from each side")
        if len(self.slope) != count or (self.slope == 0).any():
            raise ValueError("every step needs a slope other than zero")


@dataclass(frozen=True, eq=False)
class Hysteresis:
    """What the approach side changes, in motor steps.

    Attributes:
        side: from which the table's nodes are to be reached: the more repeatable one, or
            from below where the two do not differ.
        width_steps: mean over the steps; > 0: the glass stays behind the motor.
        width_sigma_steps: its one standard deviation.
        widths_steps: (k,), at each step, with ``widths_sigma_steps``.
        repeatability_steps: one standard deviation of one approach from that side.
        repeatability_degrees: of freedom behind it.
        uniform_probability: of widths as different as these, if it is one width.
    """

    side: Side
    width_steps: float
    width_sigma_steps: float
    widths_steps: FloatArray
    widths_sigma_steps: FloatArray
    repeatability_steps: float
    repeatability_degrees: int
    uniform_probability: float

    @property
    def uniform(self) -> bool:
        """One width serves for the whole range."""
        return self.uniform_probability >= _IMPROBABLE

    @property
    def significant(self) -> bool:
        """The sides differ by more than chance."""
        return self.width_steps > 2 * self.width_sigma_steps

    @property
    def backlash_steps(self) -> int:
        """The largest width that was seen, rounded up; 0 where there is none."""
        if not self.significant:
            return 0
        widest = self.width_steps if self.uniform else float(self.widths_steps.max())
        return int(np.ceil(max(widest, 0.0)))

    @property
    def overshoot_steps(self) -> int:
        """By how much to pass a target so that it is surely reached from one side."""
        spread = np.hypot(self.repeatability_steps, self.widths_sigma_steps.max())
        return int(np.ceil(self.backlash_steps + _OVERSHOOT_SIGMAS * spread))


def measure_hysteresis(seen: BothSides) -> Hysteresis:
    """Width, better side and repeatability from both-side approaches."""
    slope = np.asarray(seen.slope, np.float64)[:, None]
    below, above = seen.below / slope, seen.above / slope
    sd_below, freedom_below = _pooled(below)
    sd_above, freedom_above = _pooled(above)
    widths = above.mean(axis=1) - below.mean(axis=1)
    variance = sd_below**2 / below.shape[1] + sd_above**2 / above.shape[1]
    sigma = np.full(len(widths), np.sqrt(variance))
    width = float(widths.mean())
    scatter = float(((widths - width) ** 2 / np.maximum(variance, 1e-300)).sum())
    better = _clearly_smaller(sd_above, freedom_above, sd_below, freedom_below)
    side: Side = "from_above" if better else "from_below"
    return Hysteresis(
        side,
        width,
        float(sigma[0] / np.sqrt(len(widths))),
        widths,
        sigma,
        sd_above if better else sd_below,
        freedom_above if better else freedom_below,
        float(chi2.sf(scatter, len(widths) - 1)) if len(widths) > 1 else 1.0,
    )


def _pooled(readings: FloatArray) -> tuple[float, int]:
    """Standard deviation within the steps, and its degrees of freedom."""
    freedom = readings.shape[0] * (readings.shape[1] - 1)
    squares = ((readings - readings.mean(axis=1, keepdims=True)) ** 2).sum()
    return float(np.sqrt(squares / freedom)), freedom


def _clearly_smaller(sd: float, freedom: int, other: float, other_freedom: int) -> bool:
    """The logarithm of a sample's sd has a variance of about 1 / (2 freedom)."""
    if sd == 0.0 or other == 0.0:
        return sd < other
    spread = np.sqrt(0.5 / freedom + 0.5 / other_freedom)
    return bool(np.log(other / sd) > _OVERSHOOT_SIGMAS * spread)
