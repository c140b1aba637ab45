"""A second look at a view that shares no formula with the search.

The paper's vector forms (1)-(10), a plain projection, the region's own classification,
and an exact visibility test if one is given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mvp.constraints import (
    FieldOfViewCircle,
    FieldOfViewRectangle,
    FocusFar,
    FocusNear,
    Resolution,
    Visibility,
    paper_forms,
)
from mvp.planning.candidates import in_region

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.constraints import Constraint
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

    ExactOracle: TypeAlias = Callable[[FloatArray], BoolArray]

_ROUNDING = 1e-9


@dataclass(frozen=True)
class Recheck:
    """Margins of one view by the second path.

    Attributes:
        values: g1, g2a, g2b, g3, g4 and "exactly visible" (1 or -1), worst of each;
            g1 in px, the rest in mm; inf where there is no limit.
        holds: whether every one is >= 0.
    """

    values: dict[str, float]
    holds: bool


def recheck(
    problem: PlanningProblem, view: Views, *, oracle: ExactOracle | None = None
) -> Recheck:
    """Evaluate one view (N = 1) again, by the independent path.

    Args:
        problem: whose constraints count; kinds without a second path are evaluated as
            they are.
        view: the view.
        oracle: exact visibility of pupil positions (N, 3).
    """
    values: dict[str, float] = {}
    for constraint in problem.constraints:
        name, value = _second_path(constraint, view)
        values[name] = min(value, values.get(name, np.inf))
    if oracle is not None:
        seen = bool(np.asarray(oracle(view.position_mm))[0])
        values["exactly visible"] = 1.0 if seen else -1.0
    return Recheck(values, all(v >= -_ROUNDING for v in values.values()))


def _second_path(constraint: Constraint, view: Views) -> tuple[str, float]:
    r, nu = view.position_mm[0], view.direction[0]
    d, f, a, e = (float(v[0]) for v in (view.d_mm, view.f_mm, view.a_mm, view.e_mm))
    f_cal = paper_forms.principal_distance(d, f, e)
    match constraint:
        case Resolution():
            return "g1", _pixels(constraint, view)
        case FocusNear():
            near = paper_forms.near_limit(d, f, a, constraint.c_mm, e)
            return "g2a", float(paper_forms.g2a(r, nu, constraint.points_mm, near, e))
        case FocusFar():
            far = paper_forms.far_limit(d, f, a, constraint.c_mm, e)
            return "g2b", float(paper_forms.g2b(r, nu, constraint.points_mm, far, e))
        case FieldOfViewCircle():
            alpha = paper_forms.field_of_view_angle(
                2 * constraint.image_radius_mm, f_cal
            )
            g3 = paper_forms.g3(
                r, nu, constraint.centre_mm, constraint.radius_mm, alpha
            )
            return "g3", float(g3)
        case FieldOfViewRectangle():
            return "g3", _inside_image(constraint, view)
        case Visibility():
            seen = bool(in_region(constraint, view.position_mm)[0])
            distance = abs(float(constraint.margin(view)[0]))
            return "g4", float(paper_forms.g4(distance, seen))
        case _:
            value = constraint.rows(view, gradient=False).value
            return constraint.kind, float(value.min())


def _images(points: FloatArray, view: Views) -> tuple[FloatArray, FloatArray]:
    """Image (k, 2) mm and depth (k,) mm of part points, one point at a time."""
    x, y, nu = view.rotation[0].T
    offset = points - view.position_mm[0]
    depth = offset @ nu
    f_cal = paper_forms.principal_distance(view.d_mm[0], view.f_mm[0], view.e_mm[0])
    safe = np.where(depth > 0, depth, np.nan)
    return np.stack([offset @ x, offset @ y], axis=1) * (f_cal / safe)[:, None], depth


def _pixels(rows: Resolution, view: Views) -> float:
    if rows.rule == "worst":
        f_cal = paper_forms.principal_distance(view.d_mm[0], view.f_mm[0], view.e_mm[0])
        w = paper_forms.required_length(
            rows.pitch_x_mm, rows.pitch_y_mm, rows.required_px
        )
        slack = paper_forms.g1_image(
            view.position_mm[0],
            view.direction[0],
            rows.starts_mm,
            rows.ends_mm,
            w,
            f_cal,
        )
        return float(slack.min() / rows.diagonal_pitch_mm)
    a, _ = _images(rows.starts_mm, view)
    b, _ = _images(rows.ends_mm, view)
    counts = np.abs(b - a) / np.array([rows.pitch_x_mm, rows.pitch_y_mm])
    slack = counts.max(axis=1) - rows.required_px
    return float(np.nan_to_num(slack, nan=-1.0).min())


def _inside_image(field: FieldOfViewRectangle, view: Views) -> float:
    """Smallest distance of an imaged point from a side of the sensor, mm."""
    image, _ = _images(field.points_mm, view)
    left, right, top, bottom = field.extents_mm
    slack = np.stack(
        [
            left + image[:, 0],
            right - image[:, 0],
            top + image[:, 1],
            bottom - image[:, 1],
        ]
    )
    return float(np.nan_to_num(slack, nan=-1.0).min())
