"""A new result beside the one that the cell had when its session began."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.wizard.comparison import (
    ALARM_SIGMAS,
    compare_cameras,
    compare_lens_tables,
    compare_rigid,
)
from mvp.calibrated import (
    CameraCalibration,
    LensTableCalibration,
    ResultComparison,
    ResultDifference,
    RigidCalibration,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.wizard.comparison import Comparison
    from mvp.fileedge import FileModel
    from mvp.wizard import SessionFacts


def compared_with_before(
    facts: SessionFacts,
    document: FileModel | None,
    *,
    distance_mm: float,
    point_part_mm: Sequence[float] = (0.0, 0.0, 0.0),
) -> Comparison | None:
    """None without a result.

    Args:
        facts: with the calibrations that were in place.
        document: the new result.
        distance_mm: working distance from the entrance pupil.
        point_part_mm: where poses of a part are compared.
    """
    if isinstance(document, CameraCalibration):
        return compare_cameras(facts.camera, document, distance_mm=distance_mm)
    if isinstance(document, LensTableCalibration):
        return compare_lens_tables(
            facts.lens_table,
            document,
            distance_mm=distance_mm,
            half_field_mm=half_field_mm(facts, document, distance_mm),
        )
    if isinstance(document, RigidCalibration):
        part = document.schema_ == "mvp-cell/part-pose/1"
        before = facts.part_pose if part else facts.hand_eye
        at = point_part_mm if part else (0.0, 0.0, distance_mm)
        return compare_rigid(before, document, at_source_mm=at)
    return None


def half_field_mm(
    facts: SessionFacts, table: LensTableCalibration, distance_mm: float
) -> float:
    """From the middle of the widest field of view to its corner, at a distance."""
    sensor = facts.sensor
    half = np.hypot(
        sensor.width_px * sensor.pitch_x_mm, sensor.height_px * sensor.pitch_y_mm
    )
    return float(half / 2 / min(table.zoom_f_mm.values_mm) * distance_mm)


def line_of(comparison: Comparison) -> str:
    """For the terminal."""
    alarm = f"ALARM, more than {ALARM_SIGMAS:g} sigma: " if comparison.alarm else ""
    return f"against the calibration before: {alarm}{comparison.words}"


def kept(comparison: Comparison) -> ResultComparison:
    """For the session's result; where a sigma is 0 the number of them is left out."""
    known = comparison.sigmas is not None and np.isfinite(comparison.sigmas)
    return ResultComparison(
        previous_date=comparison.previous_date,
        alarm=comparison.alarm,
        sigmas=comparison.sigmas if known else None,
        differences=[
            ResultDifference(name=d.name, change=d.change, sigma=d.sigma, unit=d.unit)
            for d in comparison.differences
        ],
        remarks=list(comparison.remarks),
        words=comparison.words,
    )
