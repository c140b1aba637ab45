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
from mvp.optics import (
    MotorAxis,
    ZoomCurves,
    focus_distance_mm,
    principal_distance_mm,
)

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
        _distance(previous, new, f[0], x),
        _worst("a", a, previous.a_standard_deviation_mm, new.a_standard_deviation_mm),
        _pupil_offset(previous, new, f[0]),
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


def _distance(
    previous: LensTableCalibration,
    new: LensTableCalibration,
    zooms: FloatArray,
    pair: tuple[FloatArray, FloatArray, FloatArray],
) -> Difference:
    """D by the focus, and where the zoom shifts it at the zoom where that is worst."""
    steps, before, now = pair
    shifts = _shift_mm(new, zooms) - _shift_mm(previous, zooms)
    off = (now - before) + shifts[:, None]
    zoom, focus = np.unravel_index(int(np.abs(off).argmax()), off.shape)
    at_zoom = f" of zoom {zooms[zoom]:.0f}" if shifts.any() else ""
    return Difference(
        f"d, worst at step {steps[focus]:.0f}{at_zoom}",
        float(off[zoom, focus]),
        both_sigmas(previous.d_standard_deviation_mm, new.d_standard_deviation_mm),
        "mm",
    )


def _pupil_offset(
    previous: LensTableCalibration, new: LensTableCalibration, zooms: FloatArray
) -> Difference:
    """E of both tables, where it differs most if the zoom changes it."""
    before, now = (_e_mm(file, zooms) for file in (previous, new))
    worst = int(np.abs(now - before).argmax())
    by_zoom = any(_e_by_zoom(file) for file in (previous, new))
    where = f", worst at zoom {zooms[worst]:.0f}" if by_zoom else ""
    return Difference(
        f"pupil offset e{where}",
        float(now[worst] - before[worst]),
        both_sigmas(_e_sigma_mm(previous), _e_sigma_mm(new)),
        "mm",
    )


def _e_by_zoom(file: LensTableCalibration) -> bool:
    return file.by_zoom is not None and bool(file.by_zoom.pupil_offset_mm)


def _e_mm(file: LensTableCalibration, zooms: FloatArray) -> FloatArray:
    """Pupil offset at zoom steps."""
    own = _by_zoom(file, "pupil_offset_mm", zooms)
    return np.full(len(zooms), file.pupil_offset_mm) if own is None else own


def _shift_mm(file: LensTableCalibration, zooms: FloatArray) -> FloatArray:
    """What the zoom adds to x = d - f at zoom steps."""
    own = _by_zoom(file, "focus_shift_mm", zooms)
    return np.zeros(len(zooms)) if own is None else own


def _by_zoom(
    file: LensTableCalibration, name: str, zooms: FloatArray
) -> FloatArray | None:
    """None where the zoom does not change it."""
    if file.by_zoom is None:
        return None
    return ZoomCurves.from_table(file.by_zoom).value(name, zooms)


def _e_sigma_mm(file: LensTableCalibration) -> float:
    """The largest of all zooms."""
    if file.by_zoom is not None and _e_by_zoom(file):
        stated = file.by_zoom.standard_deviation.get("pupil_offset_mm", 0.0)
        return max(stated, file.pupil_offset_standard_deviation_mm)
    return file.pupil_offset_standard_deviation_mm


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
    (zooms, f_before, f_now), (_, x_before, x_now) = pairs
    middle = len(f_now) // 2
    here = zooms[middle : middle + 1]
    e_before, e_now = (float(_e_mm(file, here)[0]) for file in (previous, new))
    x_before = x_before + _shift_mm(previous, here)
    x_now = x_now + _shift_mm(new, here)
    old = _at_setting(f_before[middle], x_before, e_before)
    now = _at_setting(f_now[middle], x_now, e_now)
    best = int(np.abs(now[1] - distance_mm).argmin())
    sigma = both_sigmas(previous.d_standard_deviation_mm, new.d_standard_deviation_mm)
    lateral = half_field_mm / float(now[0][best])
    f = float(f_now[middle])
    along = ((distance_mm + e_now - f) / f) ** 2
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
