"""What the motors of a lens do: steps to f, d, a and back.

The zoom axis gives f and the iris axis a; the focus axis gives the extension x, and an
extension tube of length t adds to it: d = f + x + t. Between nodes of the table values
follow a monotone cubic, so every value belongs to one step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.interpolate import PchipInterpolator

from mvp.errors import CalibrationError, InputError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from mvp.calibrated.models import (
        AxisTable,
        LensTableCalibration,
        LensValidity,
    )
    from mvp.geometry import FloatArray

AxisName: TypeAlias = Literal["zoom", "focus", "iris"]

_BISECTIONS = 50


@dataclass(frozen=True)
class LensSetting:
    """What a lens does to the light, mm; names as in ``Views``."""

    f_mm: float
    d_mm: float
    a_mm: float
    e_mm: float = 0.0


@dataclass(frozen=True)
class LensSteps:
    """What the motors are told."""

    zoom: int
    focus: int
    iris: int


@dataclass(frozen=True, eq=False)
class MotorAxis:
    """One motor: steps against a physical value, both strictly monotone.

    Attributes:
        name: zoom, focus or iris.
        steps: (k,) nodes, sorted.
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
        if len(steps) != len(values) or len(steps) < 2:
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
        if first >= last:
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

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.steps, self.values_mm)

    def value_mm(self, steps: ArrayLike) -> FloatArray:
        """Values at steps (also fractions); on straight lines beyond the ends."""
        asked = np.asarray(steps, np.float64)
        inner = np.clip(asked, self.steps[0], self.steps[-1])
        beyond = asked - inner
        slope = np.where(beyond < 0, *self._end_slopes())
        return np.asarray(self._curve(inner) + slope * beyond)

    def fractional_steps(self, values_mm: ArrayLike) -> FloatArray:
        """The inverse of ``value_mm``, to 1e-9 steps."""
        target = np.asarray(values_mm, np.float64)
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
        exact = float(self.fractional_steps(value_mm))
        first, last = self.range_steps
        return first - 0.5 <= exact <= last + 0.5

    def _end_slopes(self) -> tuple[float, float]:
        """Secants of the first and last interval: never zero, unlike end tangents."""
        secant = np.diff(self.values_mm) / np.diff(self.steps)
        return float(secant[0]), float(secant[-1])


@dataclass(frozen=True, eq=False)
class LensTable:
    """A calibrated motorised lens.

    Attributes:
        zoom: steps to f.
        focus: steps to the extension x = d - f - tube.
        iris: steps to a.
        pupil_offset_mm: e, the same at every setting.
        tube_mm: length of the extension tube behind the lens.
    """

    zoom: MotorAxis
    focus: MotorAxis
    iris: MotorAxis
    pupil_offset_mm: float = 0.0
    tube_mm: float = 0.0

    @classmethod
    def from_calibration(
        cls, model: LensTableCalibration, *, tube_mm: float = 0.0
    ) -> LensTable:
        """From the result of ``mvp-cell calibrate lens``.

        Raises:
            CalibrationError: a table is not monotone.
        """
        return cls(
            MotorAxis.from_table("zoom", model.zoom_f_mm),
            MotorAxis.from_table("focus", model.focus_extension_mm),
            MotorAxis.from_table("iris", model.iris_a_mm),
            model.pupil_offset_mm,
            tube_mm,
        )

    def with_tube(self, tube_mm: float) -> LensTable:
        """The same lens on another extension tube (0 takes it off)."""
        return replace(self, tube_mm=tube_mm)

    def within(self, validity: LensValidity | None) -> LensTable:
        """The same lens where its table holds.

        Raises:
            CalibrationError: that is nowhere.
        """
        if validity is None:
            return self
        return replace(
            self,
            zoom=self.zoom.within(validity.zoom_steps),
            focus=self.focus.within(validity.focus_steps),
            iris=self.iris.within(validity.iris_steps),
        )

    @property
    def f_range_mm(self) -> tuple[float, float]:
        """Smallest and largest focal length, mm."""
        return self.zoom.range_mm

    @property
    def a_range_mm(self) -> tuple[float, float]:
        """Smallest and largest pupil diameter, mm."""
        return self.iris.range_mm

    @property
    def extension_range_mm(self) -> tuple[float, float]:
        """Smallest and largest d - f with the tube, mm."""
        low, high = self.focus.range_mm
        return low + self.tube_mm, high + self.tube_mm

    def d_range_mm(self, f_mm: float) -> tuple[float, float]:
        """Smallest and largest d at one focal length, mm."""
        low, high = self.extension_range_mm
        return f_mm + low, f_mm + high

    def setting(self, zoom: int, focus: int, iris: int) -> LensSetting:
        """What the lens does at motor steps.

        Raises:
            InputError: steps outside the table; the hint names the ends.
        """
        self._check_steps(LensSteps(zoom, focus, iris))
        f = float(self.zoom.value_mm(zoom))
        d = f + float(self.focus.value_mm(focus)) + self.tube_mm
        return LensSetting(f, d, float(self.iris.value_mm(iris)), self.pupil_offset_mm)

    def steps(self, f_mm: float, d_mm: float, a_mm: float) -> LensSteps:
        """Nearest whole motor steps; focus makes good what rounding did to f.

        Raises:
            InputError: not reachable; the hint gives the nearest reachable values.
        """
        self._check_reach(f_mm, d_mm, a_mm)
        return self._nearest_steps(f_mm, d_mm, a_mm)

    def nearest(self, f_mm: float, d_mm: float, a_mm: float) -> LensSetting:
        """What the lens gives when asked for a setting, in or out of reach."""
        return self.at(self._nearest_steps(f_mm, d_mm, a_mm))

    def at(self, steps: LensSteps) -> LensSetting:
        """``setting`` of a triple of steps."""
        return self.setting(steps.zoom, steps.focus, steps.iris)

    def reaches(self, f_mm: float, d_mm: float, a_mm: float) -> bool:
        """Whether a setting lies in the table, to half a step on every axis."""
        return not self._out_of_reach(f_mm, d_mm, a_mm)

    def tube_for(
        self, d_mm: float, f_mm: float, tubes_mm: Iterable[float]
    ) -> float | None:
        """The shortest extension tube that brings d into range.

        Args:
            d_mm: wanted image distance.
            f_mm: focal length.
            tubes_mm: lengths at hand; no tube (0.0) is always one of them.

        Returns:
            0.0 if the bare lens does it, None if no tube does.
        """
        for tube in sorted({0.0, *tubes_mm}):
            if self.focus.reaches(d_mm - f_mm - tube):
                return tube
        return None

    def _nearest_steps(self, f_mm: float, d_mm: float, a_mm: float) -> LensSteps:
        zoom = self.zoom.nearest_step(f_mm)
        extension = d_mm - float(self.zoom.value_mm(zoom)) - self.tube_mm
        return LensSteps(
            zoom, self.focus.nearest_step(extension), self.iris.nearest_step(a_mm)
        )

    def _out_of_reach(self, f_mm: float, d_mm: float, a_mm: float) -> list[str]:
        d_low, d_high = self.d_range_mm(f_mm)
        wanted = (
            ("f", f_mm, self.zoom.reaches(f_mm), self.f_range_mm),
            (
                "d",
                d_mm,
                self.focus.reaches(d_mm - f_mm - self.tube_mm),
                (d_low, d_high),
            ),
            ("a", a_mm, self.iris.reaches(a_mm), self.a_range_mm),
        )
        return [
            f"{name} = {value:.4f} mm is outside {low:.4f} .. {high:.4f} mm"
            for name, value, reached, (low, high) in wanted
            if not reached
        ]

    def _check_reach(self, f_mm: float, d_mm: float, a_mm: float) -> None:
        faults = self._out_of_reach(f_mm, d_mm, a_mm)
        if faults:
            near = self.nearest(f_mm, d_mm, a_mm)
            raise InputError(
                "the lens cannot be set: " + "; ".join(faults),
                hint=f"nearest reachable: f = {near.f_mm:.4f}, d = {near.d_mm:.4f}, "
                f"a = {near.a_mm:.4f} mm",
                where="lens table",
            )

    def _check_steps(self, steps: LensSteps) -> None:
        for axis, value in (
            (self.zoom, steps.zoom),
            (self.focus, steps.focus),
            (self.iris, steps.iris),
        ):
            first, last = axis.range_steps
            if not first <= value <= last:
                raise InputError(
                    f"{axis.name} step {value} is outside the lens table",
                    hint=f"nearest reachable: {min(max(value, first), last)} "
                    f"(the table holds {first} .. {last})",
                    where="lens table",
                )


def pupil_shift_mm(d_mm: ArrayLike, reference_d_mm: ArrayLike) -> FloatArray:
    """How far the entrance pupil moved towards the object since a reference setting.

    The lens moves as one piece in front of a sensor that is fixed to the flange, so the
    pupil moves along the optical axis by d - d_ref (positive towards the object).
    """
    moved = np.asarray(d_mm, np.float64) - np.asarray(reference_d_mm, np.float64)
    return np.asarray(moved)
