"""What speaks against using a calibration in a cell, and what to do about it.

Objections are data: ``run`` raises all that were not accepted in one error, ``check``
lists them, a plan notes those that were accepted or only warn.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvp.errors import CalibrationError
from mvp.optics import LensTable

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from mvp.calibrated import (
        CameraCalibration,
        LensTableCalibration,
        Quality,
        RigidCalibration,
        Validity,
    )
    from mvp.cell.calibrations import Calibrations
    from mvp.devices import Axis, Side
    from mvp.planning.plan import PlannedView

    Model = CameraCalibration | LensTableCalibration | RigidCalibration

NAMES = ("camera", "lens_table", "hand_eye", "part_pose")
WIZARDS = {
    "camera": "camera",
    "lens_table": "lens",
    "hand_eye": "hand-eye",
    "part_pose": "part",
}
_MADE_WITH = {
    "camera": "camera",
    "lens_table": "lens",
    "hand_eye": "arm",
    "part_pose": "arm",
}
IMPORTED = "imported"  # code of the cause of every result of another program
_OTHER_TABLE = 0.03  # of f and d: nominal and measured tables differ by so much
_WARM_K = 5.0  # where a file states a temperature, but no range


@dataclass(frozen=True)
class Objection:
    """One thing that speaks against one calibration.

    Attributes:
        name: of the calibration, as in ``[calibration]``.
        path: of its file.
        text: what speaks against it; names the file.
        fix: what to do.
        refused: it must not be used; otherwise somebody should look at it.
        waivable: a person may take the responsibility.
        stale: it was good, but was made with others than are in place now.
    """

    name: str
    path: Path
    text: str
    fix: str
    refused: bool = True
    waivable: bool = True
    stale: bool = False


def measure_again(name: str) -> str:
    """The command that makes this calibration."""
    return f"`mvp-cell calibrate {WIZARDS[name]} CELL` measures it"


def require_accepted(objections: Iterable[Objection], reason: str) -> dict[str, str]:
    """The calibrations that a person accepts, with the reason given.

    Raises:
        CalibrationError: something speaks against one, and nobody takes the
            responsibility, or nobody can; all of it is named.
    """
    refused = [one for one in objections if one.refused]
    left = [one for one in refused if not (reason.strip() and one.waivable)]
    if left:
        raise CalibrationError(
            "\n".join(dict.fromkeys(one.text for one in left)),
            hint="\n".join(dict.fromkeys(_hint(one) for one in left)),
            where=str(left[0].path),
        )
    return {one.name: reason.strip() for one in refused}


def _hint(objection: Objection) -> str:
    if not objection.waivable:
        return objection.fix
    return (
        f"{objection.fix}, or take the responsibility with --accept-calibration REASON"
    )


# ------------------------------------------------------------------ a file by itself


def of_file(
    name: str, path: Path, model: Model, *, simulated: bool
) -> Iterator[Objection]:
    """From a simulation, not good enough, or not measured at all.

    Args:
        name: of the calibration.
        path: of its file.
        model: its content.
        simulated: the cell is; nominal values only warn there.
    """
    nominal = model.provenance.origin == "nominal"
    if model.provenance.simulated and not simulated:
        yield Objection(
            name,
            path,
            f"{path}: this {name} calibration comes from a simulated cell and cannot be "
            "used on a real one",
            "name one that was measured on this cell in [calibration] of the cell file",
            waivable=False,
        )
    excused = nominal and simulated and model.quality.verdict == "marginal"
    if model.quality.verdict != "go" and not excused:
        yield _poor(name, path, model.quality)
    if nominal:
        yield _nominal(name, path, model.quality, refused=not simulated)


def _nominal(name: str, path: Path, quality: Quality, *, refused: bool) -> Objection:
    why = "taken from data sheets, nothing of this cell was measured"
    if any(cause.code == IMPORTED for cause in quality.causes):
        why = "imported, and nobody says of which camera it was measured and when"
    text = f"{path}: the {name} calibration is nominal: {why}"
    return Objection(name, path, text, measure_again(name), refused=refused)


def _poor(name: str, path: Path, quality: Quality) -> Objection:
    why = "; ".join(quality.reasons) or "no reason given"
    next_action = f"{quality.next_action}; " if quality.next_action else ""
    return Objection(
        name,
        path,
        f"{path}: the {name} calibration is {quality.verdict.upper()}: {why}",
        f"{next_action}name a better one in [calibration] of the cell file",
    )


# --------------------------------------------------------------- one beside the other


def of_lens_setting(
    hand_eye: RigidCalibration,
    lens_table: LensTableCalibration,
    paths: Mapping[str, Path],
    tubes_mm: Sequence[float],
) -> Iterator[Objection]:
    """A hand-eye result whose lens setting this lens cannot have had.

    The entrance pupil moves with the lens. The result is carried over to other settings
    of the same lens, so its own must be one of them, with or without a tube.
    """
    path, fix = paths["hand_eye"], measure_again("hand_eye")
    d_mm, f_mm = hand_eye.reference_d_mm, hand_eye.reference_f_mm
    if d_mm is None:
        yield Objection(
            "hand_eye",
            path,
            f"{path}: does not say at which lens setting hand-eye was measured, so it "
            "cannot be carried over to another one",
            fix,
            refused=False,
        )
        return
    try:
        table = LensTable.from_calibration(lens_table)
    except CalibrationError:
        return  # told with file and value where the table is used
    lens = paths["lens_table"]
    f_range = table.f_range_mm
    if f_mm is not None and not _near(f_mm, [f_range]):
        at, has = f"f = {f_mm:g} mm", _ranges_words([f_range])
    else:
        at_f = f_range if f_mm is None else (f_mm, f_mm)
        ranges = _d_ranges(table, at_f, tubes_mm)
        if _near(d_mm, ranges):
            return
        at, has = f"d = {d_mm:g} mm", _ranges_words(ranges)
    yield Objection(
        "hand_eye",
        path,
        f"{path}: hand-eye was measured at {at}, but this lens has {has} mm ({lens})",
        fix,
    )


def _near(value_mm: float, ranges_mm: Sequence[tuple[float, float]]) -> bool:
    """Inside of a range, as far as another lens table may tell it otherwise."""
    return any(
        low * (1 - _OTHER_TABLE) <= value_mm <= high * (1 + _OTHER_TABLE)
        for low, high in ranges_mm
    )


def _ranges_words(ranges_mm: Sequence[tuple[float, float]]) -> str:
    return " or ".join(f"{low:.2f} to {high:.2f}" for low, high in ranges_mm)


def _d_ranges(
    table: LensTable, f_mm: tuple[float, float], tubes_mm: Sequence[float]
) -> list[tuple[float, float]]:
    """Smallest and largest d with each tube, the bare lens included."""
    lenses = [table.with_tube(tube) for tube in sorted({0.0, *tubes_mm})]
    return [
        (lens.d_range_mm(f_mm[0])[0], lens.d_range_mm(f_mm[1])[1]) for lens in lenses
    ]


# ------------------------------------------------------------ against what is connected


def of_serials(found: Calibrations, serials: Mapping[str, str]) -> Iterator[Objection]:
    """Made with other devices than those that answered, or nobody can tell.

    Nominal values were made with no device.

    Args:
        found: the calibrations.
        serials: what answered, by role; empty where a device does not say.
    """
    for name in NAMES:
        provenance = getattr(found, name).provenance
        own = {_MADE_WITH[name]: provenance.device_serial}
        for role, expected in (own | provenance.serial_numbers).items():
            if role not in serials:
                continue
            serial = serials[role]
            if not (expected and serial) and provenance.origin == "measured":
                yield _untold(found, name, role, expected)
            elif expected and serial and serial != expected:
                yield Objection(
                    name,
                    found.files[name],
                    f"{found.files[name]}: this {name} calibration was made with {role} "
                    f"{expected}, but {role} {serial} is connected",
                    "connect that device, or name the calibration of this one in "
                    "[calibration] of the cell file",
                )


def _untold(found: Calibrations, name: str, role: str, expected: str) -> Objection:
    """Neither good nor bad: one of the two does not say which device it is."""
    path = found.files[name]
    made = f"was made with {role} {expected}" if expected else f"names no {role}"
    here = (
        f"the {role} that is connected does not say its serial number"
        if expected
        else f"nobody can tell whether it was made with the {role} that is connected"
    )
    return Objection(
        name,
        path,
        f"{path}: this {name} calibration {made}; {here}",
        f"make sure that it is the same device; {measure_again(name)}",
        refused=False,
    )


def of_approach(
    found: Calibrations, approach: Mapping[Axis, Side] | None
) -> Iterator[Objection]:
    """A lens that arrives from another side than its table was measured from.

    Args:
        found: the calibrations.
        approach: side by axis, as the lens says; None: it cannot say.
    """
    if approach is None:
        return
    table = found.lens_table
    axes = {
        "zoom": table.zoom_f_mm,
        "focus": table.focus_extension_mm,
        "iris": table.iris_a_mm,
    }
    for axis, side in approach.items():
        if axes[axis].approach != side:
            yield _other_side(found, "lens_table", axis, axes[axis].approach, side)
    for name in NAMES:
        validity = getattr(found, name).validity
        wanted = None if validity is None else validity.approach
        if wanted is not None and wanted != approach["focus"]:
            yield _other_side(found, name, "focus", wanted, approach["focus"])


def _other_side(
    found: Calibrations, name: str, axis: Axis, wanted: Side, side: Side
) -> Objection:
    path = found.files[name]
    measured, arrives = wanted.replace("_", " "), side.replace("_", " ")
    return Objection(
        name,
        path,
        f"{path}: this {name} calibration was measured with {axis} coming {measured}, "
        f"but the lens arrives {arrives}",
        f"correct [lens] of the cell file, or measure anew: {measure_again(name)}",
    )


def of_temperature(
    found: Calibrations, temperature_c: float | None
) -> Iterator[Objection]:
    """Out of the temperature at which a calibration holds.

    Where a file states no range, it holds within 5 K of its own temperature.

    Args:
        found: the calibrations.
        temperature_c: as a device or the cell file says; None: unknown.
    """
    for name in NAMES:
        model, path = getattr(found, name), found.files[name]
        low, high = _interval_c(model.validity, model.provenance.temperature_c)
        if low is None and high is None:
            continue
        holds = f"holds {_range_words(low, high)}"
        if temperature_c is None:
            yield Objection(
                name,
                path,
                f"{path}: this {name} calibration {holds}, but nobody knows how warm it "
                "is now",
                "state temperature_c in [conditions] of the cell file",
                refused=False,
            )
        elif not _within(temperature_c, low, high):
            yield Objection(
                name,
                path,
                f"{path}: this {name} calibration {holds}, but it is "
                f"{temperature_c:g} deg C now",
                f"wait until it is that warm again, or measure anew: {measure_again(name)}",
            )


def _interval_c(
    validity: Validity | None, measured_c: float | None
) -> tuple[float | None, float | None]:
    if validity is not None:
        low, high = validity.temperature_min_c, validity.temperature_max_c
        if low is not None or high is not None:
            return low, high
    if measured_c is None:
        return None, None
    return measured_c - _WARM_K, measured_c + _WARM_K


def _within(value: float, low: float | None, high: float | None) -> bool:
    return (low is None or low <= value) and (high is None or value <= high)


def _range_words(low: float | None, high: float | None) -> str:
    if low is None:
        return f"up to {high:g} deg C"
    if high is None:
        return f"from {low:g} deg C on"
    return f"from {low:g} to {high:g} deg C"


# ------------------------------------------------------------------- against the plan


def of_views(found: Calibrations, views: Sequence[PlannedView]) -> Iterator[Objection]:
    """Lens steps that a plan asks for outside of where the table was validated."""
    valid, path = found.lens_table.validity, found.files["lens_table"]
    if valid is None:
        return
    ranges = {
        "zoom": valid.zoom_steps,
        "focus": valid.focus_steps,
        "iris": valid.iris_steps,
    }
    for view in views:
        steps = view.lens_steps.model_dump()
        for axis, (low, high) in ranges.items():
            if not low <= steps[axis] <= high:
                yield Objection(
                    "lens_table",
                    path,
                    f"{path}: {view.id} needs {axis} step {steps[axis]}, but the table "
                    f"holds from {low} to {high}",
                    "narrow [lens] of the task, or measure the lens over a wider range: "
                    f"{measure_again('lens_table')}",
                )
