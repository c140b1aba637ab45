"""Where a lens table holds, beside what was measured, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mvp.calibrated import LensTableCalibration, RigidCalibration
    from mvp.optics import LensSteps, LensTable, MotorAxis
    from mvp.wizard import SessionFacts


_SAME_ZOOM = 0.02


def carried_words(
    hand_eye: RigidCalibration, table: LensTableCalibration, f_mm: float
) -> str:
    """That hand-eye is carried to another zoom than measured; empty where it is not.

    Nothing measures how the pupil moves with the zoom unless the table says so.
    """
    known = hand_eye.reference_f_mm
    measured = table.by_zoom is not None and bool(table.by_zoom.pupil_shift_mm)
    if known is None or measured or abs(f_mm - known) <= _SAME_ZOOM * known:
        return ""
    return (
        f"hand-eye was measured at f = {known:.4g} mm and is carried to f = {f_mm:.4g} mm "
        "as if the pupil moved with d alone, which no measurement shows: calibrate "
        "hand-eye at this zoom, or keep lens.f_mm of the task near the one it has"
    )


def narrowed_axes(whole: LensTable, valid: LensTable) -> tuple[MotorAxis, ...]:
    """The motors whose table holds over less than was measured."""
    pairs = zip(_axes(whole), _axes(valid), strict=True)
    return tuple(held for all_, held in pairs if held.range_steps != all_.range_steps)


def _axes(table: LensTable) -> tuple[MotorAxis, MotorAxis, MotorAxis]:
    return table.zoom, table.focus, table.iris


def beyond_words(narrowed: Sequence[MotorAxis], steps: LensSteps) -> tuple[str, str]:
    """Which ranges, and which steps beyond them a view needs."""
    needed: dict[str, int] = {s: getattr(steps, s) for s in ("zoom", "focus", "iris")}
    beyond = [
        (axis, needed[axis.name])
        for axis in narrowed
        if not axis.range_steps[0] <= needed[axis.name] <= axis.range_steps[1]
    ]
    ranges = [
        f"{a.name} steps {a.range_steps[0]} to {a.range_steps[1]}" for a, _ in beyond
    ]
    return ", ".join(ranges), ", ".join(f"{a.name} step {n}" for a, n in beyond)


def require_held(facts: SessionFacts, steps: Mapping[str, int]) -> None:
    """Refuse lens steps at which the table that a session builds on does not hold.

    Args:
        facts: of the session.
        steps: zoom, focus and iris, before the lens is told.

    Raises:
        CalibrationError: nothing was measured there, and nobody accepted that.
    """
    for axis in _axes(facts.table_in_use):
        low, high = axis.range_steps
        step = steps[axis.name]
        if not low <= step <= high:
            raise CalibrationError(
                f"`calibrate {facts.key}` needs {axis.name} step {step}, but the lens table "
                f"holds from {low} to {high}",
                hint="measure the lens over a wider range: mvp-cell calibrate lens CELL; or "
                "take the responsibility with --accept-calibration REASON",
                where="lens table",
            )
