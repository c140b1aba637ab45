"""What the motors of the virtual lens truly do: dead bands, lost steps, f, d and a."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from drivers.virtual_motion import StepMove
from drivers.virtual_tracks import MotorTrack
from mvp.devices import AXES, Axis
from mvp.optics import LensTable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivers.virtual_settings import LensFaults, WorldErrors
    from mvp.calibrated import AxisTable, LensTableCalibration
    from mvp.optics import LensSetting


@dataclass(eq=False)
class AxisTruth:
    """One motor: its history, and the dead band between motor and glass.

    ``backlash`` > 0: measured from below, the glass lags by up to so many steps when
    the motor turns back; < 0: measured from above.
    """

    backlash: float
    motor: float
    glass: float
    begun_s: float = -np.inf
    motion: StepMove | None = None

    @classmethod
    def of(cls, table: AxisTable, motor: float) -> Self:
        """At rest at a motor position, engaged from the side of the table."""
        sign = 1 if table.approach == "from_below" else -1
        return cls(float(sign * table.backlash_steps), motor, motor)

    def motor_at(self, t_s: float) -> float:
        """Where the motor is at a moment, from the last motion on."""
        if self.motion is None or t_s <= self.begun_s:
            return self.motor
        return float(self.motion.at(t_s - self.begun_s)[0])

    def glass_at(self, t_s: float) -> float:
        """Where the glass is, in steps of the table."""
        if self.motion is None or t_s <= self.begun_s:
            return self.glass
        glass = self.glass
        for point in self.motion.passed(t_s - self.begun_s):
            low, high = sorted((point, point + self.backlash))
            glass = float(np.clip(glass, low, high))
        return glass

    def begin(self, points: tuple[float, ...], rate: float, t_s: float) -> float:
        """Drive through points, from where the motor is; returns the end, s."""
        motor, glass = self.motor_at(t_s), self.glass_at(t_s)
        self.motor, self.glass, self.begun_s = motor, glass, t_s
        self.motion = StepMove((motor, *points), rate)
        return self.end_s

    def halt(self, t_s: float) -> None:
        """Stop dead."""
        if self.motion is not None:
            self.motion = self.motion.halted(t_s - self.begun_s)

    @property
    def end_s(self) -> float:
        """When the motor stands."""
        if self.motion is None:
            return -np.inf
        return self.begun_s + self.motion.duration_s

    def moving_between(self, start_s: float, end_s: float) -> bool:
        """Whether the motor moved in an interval."""
        return self.begun_s < end_s and self.end_s > start_s


@dataclass(eq=False)
class LensTruth:
    """Three motors and the glass they move.

    Attributes:
        axes: driven by the virtual lens itself.
        tracks: motors that a simulator drives and only reports; they replace the axis.
    """

    table: LensTable
    axes: dict[Axis, AxisTruth]
    tracks: dict[Axis, MotorTrack] = field(default_factory=dict)

    @classmethod
    def of(cls, model: LensTableCalibration, *, tube_mm: float) -> Self:
        """A lens as its table says, switched off somewhere in the middle."""
        tables = {
            "zoom": model.zoom_f_mm,
            "focus": model.focus_extension_mm,
            "iris": model.iris_a_mm,
        }
        axes = {
            axis: AxisTruth.of(tables[axis], float(np.mean(tables[axis].steps) // 1))
            for axis in AXES
        }
        return cls(LensTable.from_calibration(model, tube_mm=tube_mm), axes)

    def mount_tube(self, tube_mm: float) -> None:
        """Another extension tube."""
        self.table = self.table.with_tube(tube_mm)

    def _motor(self, axis: Axis) -> AxisTruth | MotorTrack:
        return self.tracks.get(axis, self.axes[axis])

    def report(self, t_s: float, steps: Mapping[str, float]) -> None:
        """Take over where a simulator says that its motors are."""
        for axis in AXES:
            if axis in steps:
                own = self.axes[axis]
                track = self.tracks.setdefault(
                    axis, MotorTrack(own.backlash, own.motor)
                )
                track.report(t_s, float(steps[axis]))

    def motors(self, t_s: float) -> dict[Axis, float]:
        """Where the motors are."""
        return {axis: self._motor(axis).motor_at(t_s) for axis in AXES}

    def begin(
        self,
        points: dict[Axis, tuple[float, ...]],
        rates: dict[Axis, float],
        t_s: float,
        faults: LensFaults,
    ) -> float:
        """Drive all axes; returns when the last one stands, s."""
        ends = [t_s]
        for axis in AXES:
            truth = self.axes[axis]
            if axis in faults.backlash_steps:
                sign = -1 if truth.backlash < 0 else 1
                truth.backlash = sign * faults.backlash_steps[axis]
            ends.append(truth.begin(points[axis], rates[axis], t_s))
            if faults.stall == axis:
                truth.halt((t_s + ends[-1]) / 2)
        return max(ends)

    def halt(self, t_s: float) -> None:
        """Stop all motors dead."""
        for axis in AXES:
            self.axes[axis].halt(t_s)

    @property
    def end_s(self) -> float:
        """When the last motor stands."""
        return max(self._motor(axis).end_s for axis in AXES)

    def moving_between(self, start_s: float, end_s: float) -> bool:
        """Whether a motor moved in an interval."""
        return any(self._motor(axis).moving_between(start_s, end_s) for axis in AXES)

    def setting(
        self, t_s: float, errors: WorldErrors, faults: LensFaults
    ) -> LensSetting:
        """The true f, d, a and e at a moment."""
        zoom, focus, iris = (
            self._motor(axis).glass_at(t_s) + faults.lost_steps.get(axis, 0)
            for axis in AXES
        )
        lens = self.table.optics_at(zoom, focus, iris)
        return replace(
            lens,
            f_mm=lens.f_mm * (1 + errors.zoom_fraction),
            d_mm=lens.d_mm + errors.focus_d_mm,
            a_mm=lens.a_mm * (1 + errors.a_fraction),
            e_mm=lens.e_mm + errors.pupil_offset_mm,
        )
