"""A lens table as the file that a cell reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.lens_table.judge import judge_lens
from calibration.results import named_covariance, quality_of
from calibration.verdict import Verdict
from mvp.calibrated import (
    AxisTable,
    LensNodeResult,
    LensTableCalibration,
    LensValidity,
    NamedCovariance,
    Provenance,
    Quality,
)
from mvp.errors import CalibrationError
from mvp.optics import achievable_set

if TYPE_CHECKING:
    from calibration.lens_table.tables import LensTables
    from mvp.optics import AxisName

_OPTICS = ("f_mm", "x_mm", "e_mm")


@dataclass(frozen=True)
class LensIdentity:
    """Which lens, and when.

    Attributes:
        serial: of the lens.
        date: ISO 8601.
        simulated: it is not a real one.
    """

    serial: str
    date: str
    simulated: bool = False


def calibration_file(
    tables: LensTables, identity: LensIdentity
) -> LensTableCalibration:
    """The result with tables, nodes, achievable set, validity and verdict.

    Raises:
        CalibrationError: a table is not monotone, so no setting belongs to one step.
    """
    if tables.table is None:
        raise CalibrationError(
            "the lens table does not rise or fall throughout",
            hint=judge_lens(tables).next_action,
            where=identity.serial,
        )
    fit, curves = tables.fit, tables.curves
    sigma = {name: float(curve.nodes.sigma_mm.max()) for name, curve in curves.items()}
    return LensTableCalibration(
        schema="mvp-cell/lens-table/1",
        provenance=_provenance(tables, identity),
        quality=_quality(tables),
        zoom_f_mm=_axis(tables, "zoom"),
        focus_extension_mm=_axis(tables, "focus"),
        iris_a_mm=_axis(tables, "iris"),
        pupil_offset_mm=fit.e_mm,
        d_standard_deviation_mm=float(fit.d_sigma_mm.max()),
        f_standard_deviation_mm=sigma["zoom"],
        a_standard_deviation_mm=sigma["iris"],
        covariance=_covariance(tables),
        pupil_offset_standard_deviation_mm=fit.e_sigma_mm,
        by_zoom=tables.by_zoom.table(),
        nodes=_nodes(tables),
        achievable=achievable_set(tables.table),
        validity=_validity(tables),
    )


def _provenance(tables: LensTables, identity: LensIdentity) -> Provenance:
    return Provenance(
        date=identity.date,
        device_serial=identity.serial,
        method=f"focus settings and sharp distances, {tables.fit.way}",
        simulated=identity.simulated,
        input_sha256=tables.measured.digest(),
        temperature_c=tables.measured.conditions.temperature_c,
    )


def _quality(tables: LensTables) -> Quality:
    """Remarks that do not lower the grade are reasons, but no causes."""
    verdict = judge_lens(tables)
    against = Verdict(tuple(c for c in verdict.causes if c.grade != "go"))
    left_out = [tables.curves[name].left_out_mm for name in ("zoom", "focus")]
    errors = np.concatenate(left_out)
    found = quality_of(
        against,
        tables.fit.estimate,
        out_of_sample_mm=float(np.sqrt(np.mean(errors**2))) if len(errors) else None,
    )
    return found.model_copy(update={"reasons": verdict.reasons})


def _covariance(tables: LensTables) -> NamedCovariance:
    """Of f, x and e; x as numbered in the fit."""
    estimate = tables.fit.estimate
    names = [name for name in estimate.names if name.startswith(_OPTICS)]
    return named_covariance(names, estimate.block(names))


def _axis(tables: LensTables, name: AxisName) -> AxisTable:
    curve, found = tables.curves[name], tables.measured.hysteresis.get(name)
    return AxisTable(
        steps=[int(step) for step in curve.table_steps],
        values_mm=[float(value) for value in curve.table_mm],
        approach=tables.measured.approach.get(name, "from_below"),
        backlash_steps=found.backlash_steps if found else 0,
        repeatability_steps=found.repeatability_steps if found else 0.0,
    )


def _nodes(tables: LensTables) -> list[LensNodeResult]:
    fit = tables.fit
    found = np.column_stack([fit.node_values, fit.d_mm, fit.d_sigma_mm])
    return [
        LensNodeResult(
            zoom=node.zoom,
            focus=node.focus,
            f_cal_mm=f_cal,
            d_mm=d,
            d_standard_deviation_mm=d_sigma,
            centre_x_px=cx,
            centre_y_px=cy,
            k1=k1 * f_cal**2,
        )
        for node, (f_cal, cx, cy, k1, d, d_sigma) in zip(
            fit.seen.nodes, found.tolist(), strict=True
        )
    ]


def _validity(tables: LensTables) -> LensValidity:
    ends = {
        name: (int(curve.nodes.steps[0]), int(curve.nodes.steps[-1]))
        for name, curve in tables.curves.items()
    }
    conditions = tables.measured.conditions
    low, high = conditions.interval_c or (None, None)
    return LensValidity(
        temperature_min_c=low,
        temperature_max_c=high,
        temperature_source=conditions.source,
        zoom_steps=ends["zoom"],
        focus_steps=ends["focus"],
        iris_steps=ends["iris"],
    )
