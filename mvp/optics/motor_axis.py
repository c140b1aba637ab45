"""One motor of a lens: steps against a physical value and back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from scipy.interpolate import PchipInterpolator

    from mvp.calibrated.models import AxisTable
    from mvp.geometry import FloatArray

AxisName: TypeAlias = Literal["zoom", "focus", "iris"]

_BISECTIONS = 50
_SAME_MM = 1e-6


@lru_cache(maxsize=64)
def _curve_through(steps: bytes, values_mm: bytes) -> PchipInterpolator:
    """Tables are built from one file again and again, their curves once."""
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(np.frombuffer(steps), np.frombuffer(values_mm))


@dataclass(frozen=True, eq=False)
class MotorAxis:
    """One motor: steps against a physical value, both strictly monotone.

    Attributes:
        name: zoom, focus or iris.
        steps: (k,) nodes, sorted; a zoom may have one, which is then the only one.
        values_mm: (k,) values at the nodes, rising or falling.
        valid_steps: where the table holds; None: all of it.
    """

    name: AxisName
    steps: FloatArray
    values_mm: FloatArray
    valid_steps: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        steps = np.asarray(self.steps, np.float64).reshape(-1)
        values = np.asarray(self.values_mm, np.float64).reshape(-1)
        fewest = 1 if self.name == "zoom" else 2
        if len(steps) != len(values) or len(steps) < fewest:
            raise CalibrationError(
                f"lens table, {self.name}: steps and values need two or more pairs",
                hint="measure this axis of the lens again, or restore the file",
            )
        order = np.argsort(steps)
        steps, values = steps[order], values[order]
        rises = np.diff(values)
        if not (
            (np.diff(steps) > 0).all() and ((rises > 0).all() or (rises < 0).all())
        ):
            raise CalibrationError(
                f"lens table, {self.name}: the values do not rise or fall steadily "
                "with the steps",
                hint="measure this axis of the lens again, or restore the file",
            )
        object.__setattr__(self, "steps", steps)
        object.__setattr__(self, "values_mm", values)

    @classmethod
    def from_table(cls, name: AxisName, table: AxisTable) -> MotorAxis:
        """From the calibration file's model."""
        return cls(name, np.array(table.steps, np.float64), np.array(table.values_mm))

    @property
    def fixed(self) -> bool:
        """There is one step only."""
        return len(self.steps) == 1

    @property
    def range_mm(self) -> tuple[float, float]:
        """Smallest and largest value where the table holds, mm."""
        if self.valid_steps is None:
            return self._whole_mm
        ends = self.value_mm(self.range_steps)
        return float(ends.min()), float(ends.max())

    @property
    def _whole_mm(self) -> tuple[float, float]:
        return float(self.values_mm.min()), float(self.values_mm.max())

    @property
    def range_steps(self) -> tuple[int, int]:
        """First and last step of the table, or where it holds."""
        first, last = int(self.steps[0]), int(self.steps[-1])
        if self.valid_steps is None:
            return first, last
        return max(first, self.valid_steps[0]), min(last, self.valid_steps[1])

    def within(self, valid_steps: tuple[int, int]) -> MotorAxis:
        """The same values, only from one step to another.

        Raises:
            CalibrationError: the table has fewer than two steps there.
        """
        found = replace(self, valid_steps=valid_steps)
        first, last = found.range_steps
        if first > last or (first == last and not self.fixed):
            raise CalibrationError(
                f"lens table, {self.name}: it is said to hold from step "
                f"{valid_steps[0]} to {valid_steps[1]}, but was measured from "
                f"{int(self.steps[0])} to {int(self.steps[-1])}",
                hint="measure this axis of the lens again, or restore the file",
            )
        return found

    @property
    def sense(self) -> int:
        """+1 where the value rises with the steps, -1 where it falls."""
        return 1 if self.values_mm[-1] > self.values_mm[0] else -1

    @property
    def _curve(self) -> PchipInterpolator:
        return _curve_through(self.steps.tobytes(), self.values_mm.tobytes())

    def value_mm(self, steps: ArrayLike) -> FloatArray:
        """Values at steps (also fractions); on straight lines beyond the ends."""
        asked = np.asarray(steps, np.float64)
        if self.fixed:
            return np.full(asked.shape, self.values_mm[0])
        inner = np.clip(asked, self.steps[0], self.steps[-1])
        beyond = asked - inner
        slope = np.where(beyond < 0, *self._end_slopes())
        return np.asarray(self._curve(inner) + slope * beyond)

    def fractional_steps(self, values_mm: ArrayLike) -> FloatArray:
        """The inverse of ``value_mm``, to 1e-9 steps."""
        target = np.asarray(values_mm, np.float64)
        if self.fixed:
            return np.full(target.shape, self.steps[0])
        inner = np.clip(target, *self._whole_mm)
        rising, wanted = self.values_mm * self.sense, inner * self.sense
        piece = np.clip(np.searchsorted(rising, wanted), 1, len(rising) - 1) - 1
        c_3, c_2, c_1, c_0 = self._curve.c[:, piece] * self.sense
        start = self.steps[piece]
        low, high = np.zeros_like(start), self.steps[piece + 1] - start
        for _ in range(_BISECTIONS):
            t = (low + high) / 2
            short = ((c_3 * t + c_2) * t + c_1) * t + c_0 < wanted
            low, high = np.where(short, t, low), np.where(short, high, t)
        beyond = target - inner
        slope = np.where(beyond * self.sense < 0, *self._end_slopes())
        return np.asarray(start + (low + high) / 2 + beyond / slope)

    def nearest_step(self, value_mm: float) -> int:
        """The whole step inside the table whose value is nearest."""
        exact = float(self.fractional_steps(value_mm))
        near = np.clip([np.floor(exact), np.ceil(exact)], *self.range_steps)
        error = np.abs(self.value_mm(near) - value_mm)
        return int(near[int(np.argmin(error))])

    def reaches(self, value_mm: float) -> bool:
        """Whether a value lies in the table, to half a step."""
        if self.fixed:
            return abs(value_mm - float(self.values_mm[0])) <= _SAME_MM
        exact = float(self.fractional_steps(value_mm))
        first, last = self.range_steps
        return first - 0.5 <= exact <= last + 0.5

    def _end_slopes(self) -> tuple[float, float]:
        """Secants of the first and last interval: never zero, unlike end tangents."""
        secant = np.diff(self.values_mm) / np.diff(self.steps)
        return float(secant[0]), float(secant[-1])
