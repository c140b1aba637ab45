"""What the motors of a lens do: steps to f, d, a and back.

The zoom axis gives f and the iris axis a; the focus axis gives the extension x, and an
extension tube of length t adds to it: d = f + x + t. Between nodes of the table values
follow a monotone cubic, so every value belongs to one step. The zoom may also change the
pupil offset, the extension, the principal point and the distortion (``ZoomCurves``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.errors import InputError
from mvp.optics.motor_axis import MotorAxis
from mvp.optics.zoom_curves import ZoomCurves, ZoomOptics

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from mvp.calibrated.models import LensTableCalibration, LensValidity
    from mvp.geometry import FloatArray


@dataclass(frozen=True)
class LensSetting:
    """What a lens does to the light, mm; names as in ``Views``.

    Attributes:
        f_mm: see ``Views``, like d, a and e.
        centre_px: principal point at this setting; None: the camera's own.
        k1: OpenCV's at this setting; None: the camera's own.
    """

    f_mm: float
    d_mm: float
    a_mm: float
    e_mm: float = 0.0
    centre_px: tuple[float, float] | None = None
    k1: float | None = None


@dataclass(frozen=True)
class LensSteps:
    """What the motors are told."""

    zoom: int
    focus: int
    iris: int


@dataclass(frozen=True, eq=False)
class LensTable:
    """A calibrated motorised lens.

    Attributes:
        zoom: steps to f.
        focus: steps to the extension x = d - f - tube.
        iris: steps to a.
        pupil_offset_mm: e, the same at every setting unless ``by_zoom`` has it.
        tube_mm: length of the extension tube behind the lens.
        by_zoom: what the zoom changes beside f; None: nothing.
    """

    zoom: MotorAxis
    focus: MotorAxis
    iris: MotorAxis
    pupil_offset_mm: float = 0.0
    tube_mm: float = 0.0
    by_zoom: ZoomCurves | None = None

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
            None if model.by_zoom is None else ZoomCurves.from_table(model.by_zoom),
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
        ends = [self.zoom_optics(step).focus_shift_mm for step in self._zoom_nodes]
        return low + self.tube_mm + min(ends), high + self.tube_mm + max(ends)

    def d_range_mm(self, f_mm: float) -> tuple[float, float]:
        """Smallest and largest d at one focal length, mm."""
        low, high = self.focus.range_mm
        least = f_mm + self._shift_mm(f_mm) + self.tube_mm
        return least + low, least + high

    @property
    def _zoom_nodes(self) -> FloatArray:
        return self.zoom.steps if self.by_zoom is None else self.by_zoom.steps

    def zoom_optics(self, zoom: float) -> ZoomOptics:
        """What the zoom changes beside f, at a step."""
        return ZoomOptics() if self.by_zoom is None else self.by_zoom.at(zoom)

    def optics_of(self, f_mm: float) -> ZoomOptics:
        """What the zoom changes beside f, where it gives a focal length."""
        return self.zoom_optics(float(self.zoom.fractional_steps(f_mm)))

    def _shift_mm(self, f_mm: float) -> float:
        return 0.0 if self.by_zoom is None else self.optics_of(f_mm).focus_shift_mm

    def at_focal_length(self, f_mm: float) -> LensTable:
        """The same lens as if the zoom changed nothing but f from here on."""
        if self.by_zoom is None:
            return self
        here = self.optics_of(f_mm)
        e = here.pupil_offset_mm
        return replace(
            self,
            focus=replace(
                self.focus, values_mm=self.focus.values_mm + here.focus_shift_mm
            ),
            pupil_offset_mm=self.pupil_offset_mm if e is None else e,
            by_zoom=None,
        )

    def setting(self, zoom: int, focus: int, iris: int) -> LensSetting:
        """What the lens does at motor steps.

        Raises:
            InputError: steps outside the table; the hint names the ends.
        """
        self._check_steps(LensSteps(zoom, focus, iris))
        return self.optics_at(zoom, focus, iris)

    def optics_at(self, zoom: float, focus: float, iris: float) -> LensSetting:
        """``setting`` at any place of the motors, also between and beyond steps."""
        f, here = float(self.zoom.value_mm(zoom)), self.zoom_optics(zoom)
        d = f + float(self.focus.value_mm(focus)) + here.focus_shift_mm + self.tube_mm
        e, a = here.pupil_offset_mm, float(self.iris.value_mm(iris))
        return LensSetting(
            f, d, a, self.pupil_offset_mm if e is None else e, here.centre_px, here.k1
        )

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
        shift = self._shift_mm(f_mm)
        for tube in sorted({0.0, *tubes_mm}):
            if self.focus.reaches(d_mm - f_mm - shift - tube):
                return tube
        return None

    def _nearest_steps(self, f_mm: float, d_mm: float, a_mm: float) -> LensSteps:
        zoom = self.zoom.nearest_step(f_mm)
        shift = self.zoom_optics(zoom).focus_shift_mm
        extension = d_mm - float(self.zoom.value_mm(zoom)) - shift - self.tube_mm
        return LensSteps(
            zoom, self.focus.nearest_step(extension), self.iris.nearest_step(a_mm)
        )

    def _out_of_reach(self, f_mm: float, d_mm: float, a_mm: float) -> list[str]:
        d_low, d_high = self.d_range_mm(f_mm)
        extension = d_mm - f_mm - self._shift_mm(f_mm) - self.tube_mm
        wanted = (
            ("f", f_mm, self.zoom.reaches(f_mm), self.f_range_mm),
            ("d", d_mm, self.focus.reaches(extension), (d_low, d_high)),
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
