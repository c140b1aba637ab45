"""How near and how far a camera can be at all, in closed form from lens and demands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints import (
    FieldOfViewCircle,
    FieldOfViewRectangle,
    FocusFar,
    FocusNear,
    Resolution,
)
from mvp.optics.thick_lens import depth_limits_mm, principal_distance_mm

if TYPE_CHECKING:
    from mvp.constraints import Constraint
    from mvp.geometry import FloatArray
    from mvp.planning.problem import LensBounds, PlanningProblem


def distance_bounds_mm(problem: PlanningProblem) -> tuple[float, float]:
    """Distances of the pupil from the target's centre that an admissible view may have.

    Necessary, not sufficient, whatever the direction: the centre lies among the key
    points, so it is no nearer than the near limit of focus at the largest d and no
    deeper than the far limit at the smallest; its sphere must fit into the widest
    viewing cone; and the smallest detail, anywhere in the picture, must not look too
    small. (0, inf) without such constraints; low > high where nothing is admissible.
    """
    lens = _corners(problem.lens)
    half_rad = min((_half_angle_rad(c, lens) for c in problem.constraints), default=0.0)
    bounds = [_bounds(c, problem, lens, half_rad) for c in problem.constraints]
    return max(low for low, _ in bounds), min(high for _, high in bounds)


def _corners(lens: LensBounds) -> FloatArray:
    """Every combination (4, 8) of the bounds of d, f, a, with its f_cal, mm.

    All that is asked of them is monotonic in each, so that the extremes are there.
    """
    d, f, a = (axis.ravel() for axis in np.meshgrid(lens.d_mm, lens.f_mm, lens.a_mm))
    return np.stack([d, f, a, principal_distance_mm(d, f, lens.e_mm)])


def _half_angle_rad(constraint: Constraint, lens: FloatArray) -> float:
    """Largest angle off the axis at which the picture ends; pi / 2 if it has no end."""
    match constraint:
        case FieldOfViewCircle():
            radius = constraint.image_radius_mm
        case FieldOfViewRectangle():
            left, right, top, bottom = constraint.extents_mm
            radius = float(np.hypot(max(left, right), max(top, bottom)))
        case _:
            return np.pi / 2
    return float(np.arctan2(radius, lens[3].min()))


def _bounds(
    constraint: Constraint, problem: PlanningProblem, lens: FloatArray, half_rad: float
) -> tuple[float, float]:
    d, f, a, f_cal = lens
    e = problem.lens.e_mm
    match constraint:
        case FocusNear():
            near, _ = depth_limits_mm(d, f, a, constraint.c_mm, e)
            return float(near.min()) - e, np.inf
        case FocusFar() if half_rad < np.pi / 2:
            _, far = depth_limits_mm(d, f, a, constraint.c_mm, e)
            return 0.0, (float(far.max()) - e) / np.cos(half_rad)
        case FieldOfViewCircle():
            aside = np.linalg.norm(constraint.centre_mm - problem.target_centre_mm)
            return constraint.radius_mm / np.sin(half_rad) - float(aside), np.inf
        case Resolution() if len(constraint.required_px) and half_rad < np.pi / 2:
            # Detail l at distance r spans at most l / (r cos^2) of the picture.
            detail = np.linalg.norm(constraint.ends_mm - constraint.starts_mm, axis=1)
            seen = float((detail / constraint.required_px).min())
            largest = float(f_cal.max()) / constraint.finest_pitch_mm
            nearest = seen * largest / np.cos(half_rad) ** 2
            return 0.0, nearest + problem.target_radius_mm
        case _:
            return 0.0, np.inf
