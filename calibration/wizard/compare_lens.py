"""Two lens tables at the same steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.wizard.compared import (
    Comparison,
    Difference,
    both_sigmas,
    compared,
    incomparable,
    other_device,
)
from mvp.optics import MotorAxis, focus_distance_mm, principal_distance_mm

if TYPE_CHECKING:
    from mvp.calibrated import AxisTable, LensTableCalibration
    from mvp.geometry import FloatArray
    from mvp.optics import AxisName

_STEPS = 25
_FAR_MM = 1e9
_AXES: tuple[AxisName, ...] = ("zoom", "focus", "iris")


def compare_lens_tables(
    previous: LensTableCalibration,
    new: LensTableCalibration,
    *,
    distance_mm: float,
    half_field_mm: float,
) -> Comparison:
    """What both tables say at the same steps, over the range that both cover.

    Args:
        previous: the one before.
        new: the new one.
        distance_mm: working distance from the entrance pupil.
        half_field_mm: from the middle of the field of view to its corner there.
    """
    stamps = previous.provenance, new.provenance
    other = other_device(*stamps) + _other_sides(previous, new)
    pairs = [
        _on_common_steps(name, old, now)
        for name, old, now in zip(_AXES, _tables(previous), _tables(new), strict=True)
    ]
    empty = [axis for axis, pair in zip(_AXES, pairs, strict=True) if pair is None]
    other += tuple(f"no steps in common: {axis}" for axis in empty)
    if other:
        return incomparable("lens", *stamps, other)
    f, x, a = (pair for pair in pairs if pair is not None)
    found = (
        *_on_the_work(previous, new, (f, x), distance_mm, half_field_mm),
        _worst("f", f, previous.f_standard_deviation_mm, new.f_standard_deviation_mm),
        _worst("d", x, previous.d_standard_deviation_mm, new.d_standard_deviation_mm),
        _worst("a", a, previous.a_standard_deviation_mm, new.a_standard_deviation_mm),
        Difference(
            "pupil offset e",
            new.pupil_offset_mm - previous.pupil_offset_mm,
            both_sigmas(
                previous.pupil_offset_standard_deviation_mm,
                new.pupil_offset_standard_deviation_mm,
            ),
            "mm",
        ),
    )
    known = [one.sigmas for one in found[2:] if one.sigmas is not None]
    return compared("lens", *stamps, found, max(known, default=None), ())


def _other_sides(
    previous: LensTableCalibration, new: LensTableCalibration
) -> tuple[str, ...]:
    return tuple(
        f"{name} was approached {old.approach}, now {now.approach}"
        for name, old, now in zip(_AXES, _tables(previous), _tables(new), strict=True)
        if old.approach != now.approach
    )


def _tables(file: LensTableCalibration) -> tuple[AxisTable, AxisTable, AxisTable]:
    return file.zoom_f_mm, file.focus_extension_mm, file.iris_a_mm


def _on_common_steps(
    name: AxisName, before: AxisTable, now: AxisTable
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Steps in both ranges, and the values that both tables have there."""
    first = max(min(before.steps), min(now.steps))
    last = min(max(before.steps), max(now.steps))
    if first >= last:
        return None
    steps = np.linspace(first, last, _STEPS)
    axes = [MotorAxis.from_table(name, table) for table in (before, now)]
    return steps, axes[0].value_mm(steps), axes[1].value_mm(steps)


def _worst(
    name: str,
    pair: tuple[FloatArray, FloatArray, FloatArray],
    before_sigma: float,
    sigma: float,
) -> Difference:
    steps, before, now = pair
    worst = int(np.abs(now - before).argmax())
    where = f"{name}, worst at step {steps[worst]:.0f}"
    change = float(now[worst] - before[worst])
    return Difference(where, change, both_sigmas(before_sigma, sigma), "mm")


def _on_the_work(
    previous: LensTableCalibration,
    new: LensTableCalibration,
    pairs: tuple[tuple[FloatArray, FloatArray, FloatArray], ...],
    distance_mm: float,
    half_field_mm: float,
) -> tuple[Difference, Difference]:
    """Lateral shift at the corner of the field, and shift of the sharp distance.

    At the setting in both tables' middle zoom that is sharp nearest to the distance.
    """
    (_, f_before, f_now), (_, x_before, x_now) = pairs
    middle = len(f_now) // 2
    old = _at_setting(f_before[middle], x_before, previous.pupil_offset_mm)
    now = _at_setting(f_now[middle], x_now, new.pupil_offset_mm)
    best = int(np.abs(now[1] - distance_mm).argmin())
    sigma = both_sigmas(previous.d_standard_deviation_mm, new.d_standard_deviation_mm)
    lateral = half_field_mm / float(now[0][best])
    f = float(f_now[middle])
    along = ((distance_mm + new.pupil_offset_mm - f) / f) ** 2
    at = f"at {distance_mm:.0f} mm"
    corner = float(now[0][best] - old[0][best]) * lateral
    sharp = float(now[1][best] - old[1][best])
    return (
        Difference(
            f"shift at the corner of the field {at}",
            corner,
            None if sigma is None else sigma * lateral,
            "mm",
        ),
        Difference(
            f"shift of the sharp distance {at}",
            sharp if np.isfinite(sharp) else 0.0,
            None if sigma is None else sigma * along,
            "mm",
        ),
    )


def _at_setting(
    f_mm: float, x_mm: FloatArray, e_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Principal and sharp distance (from the pupil) at extensions x; the latter finite."""
    d = f_mm + x_mm
    sharp = focus_distance_mm(d, f_mm) - e_mm
    return principal_distance_mm(d, f_mm, e_mm), np.minimum(sharp, _FAR_MM)
