"""What the motors of a lens reach, told in millimetres."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.calibrated import AchievableSet, AchievableZoom
from mvp.optics.thick_lens import focus_distance_mm

if TYPE_CHECKING:
    from mvp.optics.lens_table import LensTable
    from mvp.optics.motor_axis import MotorAxis


def achievable_set(table: LensTable) -> AchievableSet:
    """What the motors reach, at every zoom of the table, on the tube that it is on."""
    first, last = table.zoom.range_steps
    steps = np.unique(np.clip(table.zoom.steps, first, last))
    values = np.atleast_1d(table.zoom.value_mm(steps))
    return AchievableSet(
        zooms=[
            _at_zoom(table, int(step), float(f))
            for step, f in zip(steps, values, strict=True)
        ],
        a_low_mm=table.a_range_mm[0],
        a_high_mm=table.a_range_mm[1],
        f_per_step_mm=_largest_step_mm(table.zoom),
        x_per_step_mm=_largest_step_mm(table.focus),
        a_per_step_mm=_largest_step_mm(table.iris),
    )


def achievable_words(table: LensTable) -> str:
    """The same in one line: f, a, and between which distances it can be sharp."""
    reach = achievable_set(table)
    f = [zoom.f_mm for zoom in reach.zooms]
    near = min(zoom.sharp_near_mm for zoom in reach.zooms)
    ends = [zoom.sharp_far_mm for zoom in reach.zooms if zoom.sharp_far_mm is not None]
    far = f"{max(ends):.0f} mm" if len(ends) == len(reach.zooms) else "infinity"
    span = f"{min(f):.2f} to {max(f):.2f}" if len(f) > 1 else f"{f[0]:.2f}"
    return (
        f"f {span} mm, a {reach.a_low_mm:.2f} to {reach.a_high_mm:.2f} mm, sharp from "
        f"{near:.0f} mm to {far}"
    )


def _at_zoom(table: LensTable, step: int, f_mm: float) -> AchievableZoom:
    here = table.at_focal_length(f_mm)
    low, high = here.extension_range_mm
    ends = focus_distance_mm([f_mm + high, f_mm + low], f_mm) - here.pupil_offset_mm
    near, far = (float(end) for end in ends)
    return AchievableZoom(
        zoom=step,
        f_mm=f_mm,
        d_low_mm=f_mm + low,
        d_high_mm=f_mm + high,
        sharp_near_mm=near,
        sharp_far_mm=far if np.isfinite(far) else None,
    )


def _largest_step_mm(axis: MotorAxis) -> float:
    first, last = axis.range_steps
    values = axis.value_mm(np.arange(first, last + 1))
    return float(np.abs(np.diff(values)).max(initial=0.0))
