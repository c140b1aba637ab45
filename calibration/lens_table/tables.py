"""From measurements to the table that the planner reads."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from calibration.lens_table.interpolation import AxisCurve, AxisNodes, best_curve
from calibration.lens_table.separation import LensFit, separate
from calibration.lens_table.zoom_curves import ByZoom, curves_by_zoom
from mvp.errors import CalibrationError
from mvp.optics import LensTable, MotorAxis, ZoomCurves

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibration.lens_table.hysteresis import Hysteresis, Side
    from calibration.lens_table.nodes import LensNode, Measured
    from mvp.calibrated import TemperatureSource
    from mvp.geometry import FloatArray
    from mvp.optics import AxisName

_AXES: tuple[AxisName, ...] = ("zoom", "focus", "iris")


@dataclass(frozen=True)
class Conditions:
    """Temperature while measuring, and who said so.

    Attributes:
        temperature_c: mean; None: unknown.
        source: of it.
        range_k: the table holds so far above and below.
    """

    temperature_c: float | None = None
    source: TemperatureSource = "unknown"
    range_k: float = 5.0

    def __post_init__(self) -> None:
        if (self.temperature_c is None) != (self.source == "unknown"):
            raise ValueError("a temperature needs a source, and a source a temperature")
        if self.temperature_c is not None and not np.isfinite(self.temperature_c):
            raise ValueError("a temperature is finite, or None when unknown")
        if not (self.range_k > 0 and np.isfinite(self.range_k)):
            raise ValueError("the range above and below is positive and finite")

    @property
    def interval_c(self) -> tuple[float, float] | None:
        """Where the table holds."""
        if self.temperature_c is None:
            return None
        return self.temperature_c - self.range_k, self.temperature_c + self.range_k


@dataclass(frozen=True, eq=False)
class LensMeasurements:
    """All that was measured on a lens.

    Attributes:
        nodes: at zoom and focus steps.
        iris: pupil diameter (mm) at iris steps.
        approach: the side from which all nodes of an axis were reached.
        hysteresis: of the axes where both sides were measured.
        conditions: temperature.
        blur_limit_mm: c, the accepted blur on the sensor; sets what d must be good for.
        e_prior_mm: mean and one standard deviation known beforehand.
    """

    nodes: Sequence[LensNode]
    iris: Mapping[int, Measured]
    blur_limit_mm: float
    approach: Mapping[AxisName, Side] = field(default_factory=dict)
    hysteresis: Mapping[AxisName, Hysteresis] = field(default_factory=dict)
    conditions: Conditions = Conditions()
    e_prior_mm: tuple[float, float] | None = None

    def digest(self) -> str:
        """SHA-256 of the numbers, the same for the same numbers in any order."""
        rows = [
            (
                n.zoom,
                n.focus,
                *n.values,
                *n.covariance.ravel(),
                n.fill,
                *tuple(
                    v for m in (n.sharp_mm, n.pupil_mm) if m for v in (m.value, m.sigma)
                ),
            )
            for n in sorted(self.nodes, key=lambda n: (n.zoom, n.focus))
        ]
        rows += [(s, self.iris[s].value, self.iris[s].sigma) for s in sorted(self.iris)]
        text = "\n".join(" ".join(float(v).hex() for v in row) for row in rows)
        return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class LensTables:
    """Curves of the three motors and the table made of them.

    Attributes:
        measured: where they come from.
        fit: f, x, d, e with their uncertainty.
        curves: of zoom (f), focus (x) and iris (a).
        by_zoom: curves of what else the zoom changes.
        table: as the planner reads it; None where a curve is not monotone.
        round_trip_steps: the largest difference after steps -> mm -> steps.
    """

    measured: LensMeasurements
    fit: LensFit
    curves: Mapping[AxisName, AxisCurve]
    by_zoom: ByZoom
    table: LensTable | None
    round_trip_steps: int

    @property
    def depth_of_focus_mm(self) -> FloatArray:
        """(n,): c d / a at every node with the iris wide open (half depth of focus)."""
        widest = float(self.curves["iris"].table_mm.max())
        return np.asarray(self.measured.blur_limit_mm * self.fit.d_mm / widest)

    @property
    def sharp_sigma_mm(self) -> FloatArray:
        """(n,): one standard deviation of the sharp place behind the lens at every node.

        How far the sensor is from where the table puts it for an object at the sharp
        distance: f, x and e together, which are known better than each of them.
        """
        return self.fit.sharp_sigma_mm


def build_tables(measured: LensMeasurements) -> LensTables:
    """Separate f, d and e, and draw a curve for every motor.

    Raises:
        CalibrationError: too little was measured to make a table at all.
    """
    fit = separate(measured.nodes, e_prior_mm=measured.e_prior_mm)
    seen = fit.seen
    _check_counts(len(seen.zoom_steps), len(seen.focus_steps), len(measured.iris))
    irises = sorted(measured.iris)
    a = AxisNodes(
        np.array(irises, dtype=np.int64),
        np.array([measured.iris[step].value for step in irises]),
        np.array([measured.iris[step].sigma for step in irises]),
    )
    curves: dict[AxisName, AxisCurve] = {
        "zoom": best_curve(AxisNodes(seen.zoom_steps, fit.f_mm, fit.f_sigma_mm)),
        "focus": best_curve(AxisNodes(seen.focus_steps, fit.x_mm, fit.x_sigma_mm)),
        "iris": best_curve(a),
    }
    by_zoom, table = curves_by_zoom(fit, measured.e_prior_mm), None
    if all(curve.monotone for curve in curves.values()):
        zoom, focus, iris = (
            MotorAxis(
                name,
                curves[name].table_steps.astype(np.float64),
                curves[name].table_mm,
            )
            for name in _AXES
        )
        more = by_zoom.table()
        table = LensTable(
            zoom,
            focus,
            iris,
            fit.e_mm,
            by_zoom=None if more is None else ZoomCurves.from_table(more),
        )
    return LensTables(measured, fit, curves, by_zoom, table, round_trip_steps(table))


def round_trip_steps(table: LensTable | None) -> int:
    """Largest |steps - back| over every whole step of every axis; -1 without a table."""
    if table is None:
        return -1
    worst = 0
    for axis in (table.zoom, table.focus, table.iris):
        first, last = axis.range_steps
        steps = np.arange(first, last + 1)
        back = np.rint(axis.fractional_steps(axis.value_mm(steps)))
        worst = max(worst, int(np.abs(back - steps).max()))
    return worst


def _check_counts(zooms: int, focuses: int, irises: int) -> None:
    few = [
        f"{name} at {count}"
        for name, count, least in (
            ("zoom", zooms, 1),
            ("focus", focuses, 2),
            ("iris", irises, 2),
        )
        if count < least
    ]
    if few:
        raise CalibrationError(
            "a table needs two or more steps of focus and iris; measured: "
            f"{', '.join(few)}",
            hint="measure at least both ends of each motor's range",
        )
