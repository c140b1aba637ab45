"""Requirements made weaker: by how much one must give way, and in the user's words."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from mvp.constraints import (
    FieldOfViewCircle,
    FieldOfViewRectangle,
    FocusFar,
    FocusNear,
    Resolution,
    Visibility,
    Workspace,
)
from mvp.geometry import Box

if TYPE_CHECKING:
    from mvp.constraints import Constraint, Kind
    from mvp.geometry import FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

Knob: TypeAlias = Literal[
    "resolution", "blur", "field_of_view", "workspace", "visibility"
]

KINDS_OF: dict[Knob, tuple[Kind, ...]] = {
    "resolution": ("resolution",),
    "blur": ("focus_near", "focus_far"),
    "field_of_view": ("field_of_view",),
    "workspace": ("workspace",),
    "visibility": ("visibility",),
}
"""Requirements that one knob of the task turns, cheapest for the user first."""


_SENSIBLE: dict[Knob, float] = {"blur": 6.0, "field_of_view": 3.0}
"""Factors beyond which a change is no advice any more.

Six times the blur turns a sharp line into a band in which neighbours merge; three
times the picture is more than from a half-inch sensor to the largest that the same
mount takes. Resolution has no such factor: who asked for 0.01 mm is helped by hearing
that 0.4 mm can be had. Its limit is that the detail stays smaller than the features.
"""


@dataclass(frozen=True)
class Amount:
    """How far one knob is turned.

    Attributes:
        knob: what is given up.
        factor: on the required pixels, the blur circle or the image size; for
            workspace and visibility the distance in mm.
    """

    knob: Knob
    factor: float

    def more(self, step: float = 0.01) -> Amount:
        """A little further."""
        if self.knob == "resolution":
            return replace(self, factor=self.factor * (1 - step))
        return replace(self, factor=self.factor * (1 + step))


def sensible(problem: PlanningProblem, amount: Amount) -> bool:
    """Whether anybody would turn a knob that far, and would still be asking for it.

    Fewer pixels per detail are the same as a larger detail in as many pixels. Once that
    detail is as large as all features together, nothing is asked of the picture.
    """
    if not 0 < amount.factor < np.inf:
        return False
    if amount.knob == "resolution":
        largest_mm = amount.factor * 2 * problem.target_radius_mm
        return _detail_mm(problem) <= largest_mm
    return amount.factor <= _SENSIBLE.get(amount.knob, np.inf)


def _detail_mm(problem: PlanningProblem) -> float:
    """The largest detail that is asked for, mm."""
    asked = [c for c in problem.constraints if isinstance(c, Resolution)]
    return max((float(_details_mm(c).max(initial=0.0)) for c in asked), default=0.0)


def _details_mm(constraint: Resolution) -> FloatArray:
    """The length that each row (R,) must resolve, mm."""
    pieces = constraint.ends_mm - constraint.starts_mm
    return np.asarray(np.linalg.norm(pieces, axis=1))


def needed(problem: PlanningProblem, view: Views, knob: Knob) -> Amount:
    """How far a knob must be turned for a view (N = 1) to satisfy its requirement."""
    factors = [
        _factor(c, view) for c in problem.constraints if c.kind in KINDS_OF[knob]
    ]
    worst = min(factors) if knob == "resolution" else max(factors)
    return Amount(knob, _rounded(knob, worst))


def _factor(constraint: Constraint, view: Views) -> float:
    value = constraint.rows(view, gradient=False).value[0]
    match constraint:
        case Resolution():
            return float((1 + value / constraint.required_px).min())
        case FocusNear() | FocusFar():
            return float(1 - value.min() / constraint.c_mm)
        case FieldOfViewCircle():
            return _circle_factor(constraint, view)
        case FieldOfViewRectangle():
            return _rectangle_factor(constraint, view)
        case _:
            return float(max(-value.min(), 0.0))


def _circle_factor(field: FieldOfViewCircle, view: Views) -> float:
    q = view.camera_points(field.centre_mm[None])[0, 0]
    distance = float(np.linalg.norm(q))
    if distance <= field.radius_mm:
        return float("inf")
    off_axis = float(np.arctan2(np.hypot(q[0], q[1]), q[2]))
    half = off_axis + float(np.arcsin(field.radius_mm / distance))
    if half >= np.pi / 2:
        return float("inf")
    return float(view.f_cal_mm[0] * np.tan(half) / field.image_radius_mm)


def _rectangle_factor(field: FieldOfViewRectangle, view: Views) -> float:
    q = view.camera_points(field.points_mm)[0]
    if (q[:, 2] <= 0).any():
        return float("inf")
    image = q[:, :2] * (view.f_cal_mm[0] / q[:, 2:])
    needs = np.stack([-image[:, 0], image[:, 0], -image[:, 1], image[:, 1]])
    return float((needs / field.extents_mm[:, None]).max())


def _rounded(knob: Knob, factor: float) -> float:
    """Two digits, towards the side that gives more."""
    if not np.isfinite(factor):
        return factor
    if knob == "resolution":
        return two_digits(factor, up=False) if factor > 0 else 0.0
    if knob in ("workspace", "visibility"):
        return float(np.ceil(factor))
    return float(np.ceil(factor * 100) / 100)


def two_digits(value: float, *, up: bool) -> float:
    """A positive number with two significant digits, never on the other side of it."""
    digits = 1 - int(np.floor(np.log10(value)))
    scaled = value * 10.0**digits
    whole = np.ceil(scaled - 1e-9) if up else np.floor(scaled + 1e-9)
    return round(float(whole) / 10.0**digits, digits)


def relaxed(problem: PlanningProblem, amount: Amount) -> PlanningProblem:
    """The same problem with one knob turned."""
    constraints = [
        c if c.kind not in KINDS_OF[amount.knob] else _weaker(c, amount)
        for c in problem.constraints
    ]
    kept = tuple(c for c in constraints if c is not None)
    changed = replace(problem, constraints=kept)
    if amount.knob == "workspace":
        return replace(changed, workspace=_grown(problem.workspace, amount.factor))
    return changed


def _weaker(constraint: Constraint, amount: Amount) -> Constraint | None:
    match constraint:
        case Resolution():
            return replace(
                constraint, required_px=constraint.required_px * amount.factor
            )
        case FocusNear() | FocusFar():
            return replace(constraint, c_mm=constraint.c_mm * amount.factor)
        case FieldOfViewCircle():
            radius = constraint.image_radius_mm * amount.factor
            return replace(constraint, image_radius_mm=radius)
        case FieldOfViewRectangle():
            return replace(constraint, extents_mm=constraint.extents_mm * amount.factor)
        case Workspace():
            return replace(constraint, box=_grown(constraint.box, amount.factor))
        case Visibility():
            return None
        case _:
            return constraint


def _grown(box: Box, distance_mm: float) -> Box:
    return Box(box.low_mm - distance_mm, box.high_mm + distance_mm)


def in_words(problem: PlanningProblem, view: Views, amount: Amount) -> str:
    """What turning the knob means, in the numbers that the user gave."""
    if amount.knob == "workspace":
        return f"needs {amount.factor:.0f} mm more room for the camera"
    if amount.knob == "visibility":
        return "possible where the features are hidden now"
    texts = [
        _words(c, view, amount.factor)
        for c in problem.constraints
        if c.kind in KINDS_OF[amount.knob]
    ]
    return texts[0]


def _words(constraint: Constraint, view: Views, factor: float) -> str:
    match constraint:
        case Resolution():
            value = constraint.rows(view, gradient=False).value[0]
            row = int(np.argmin(value / constraint.required_px))
            asked = float(constraint.required_px[row])
            detail_mm = float(_details_mm(constraint)[row])
            return (
                f"ask {two_digits(asked * factor, up=False):g} px instead of "
                f"{asked:.3g} px per detail, or {asked:.3g} px of a detail of "
                f"{two_digits(detail_mm / factor, up=True):g} mm instead of "
                f"{detail_mm:.3g} mm ({constraint.labels[row]})"
            )
        case FocusNear() | FocusFar():
            c_um = 1e3 * constraint.c_mm
            return f"needs c = {c_um * factor:.3g} um instead of {c_um:.3g}"
        case FieldOfViewCircle():
            wide = 2 * constraint.image_radius_mm
            return f"needs an image {wide * factor:.3g} mm wide instead of {wide:.3g}"
        case FieldOfViewRectangle():
            return f"needs a sensor {factor:.2f} times as large"
        case _:
            return f"needs {factor:.1f} {constraint.unit} more"
