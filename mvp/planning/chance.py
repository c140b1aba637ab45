"""How likely a view fails under the cell's stated errors, by drawing them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from mvp.constraints import SHIFT, TURN, Uncertainty, Visibility
from mvp.constraints.base import A, D, F
from mvp.planning.candidates import in_region

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

DRAWS = 50_000
_CHUNK = 5_000


def perturbed(view: Views, errors: FloatArray) -> Views:
    """One view with errors (N, 9) in the order of the error coordinates."""
    many = view[np.zeros(len(errors), dtype=np.int64)]
    turn = Rotation.from_rotvec(errors[:, TURN]).as_matrix()
    return replace(
        many,
        rotation=many.rotation @ turn,
        position_mm=many.position_mm + errors[:, SHIFT],
        d_mm=many.d_mm + errors[:, D],
        f_mm=many.f_mm + errors[:, F],
        a_mm=many.a_mm + errors[:, A],
    )


def holds(problem: PlanningProblem, view: Views, errors: FloatArray) -> BoolArray:
    """Whether every constraint still holds with each of the errors (N, 9), (N,)."""
    good = np.ones(len(errors), dtype=bool)
    for start in range(0, len(errors), _CHUNK):
        part = slice(start, start + _CHUNK)
        good[part] = _analytic(problem, perturbed(view, errors[part]))
    return good & _visible(problem, view, errors[:, SHIFT])


def _analytic(problem: PlanningProblem, views: Views) -> BoolArray:
    good = np.ones(len(views), dtype=bool)
    for constraint in problem.constraints:
        if constraint.kind in problem.hard_kinds or isinstance(constraint, Visibility):
            continue
        good &= (constraint.rows(views, gradient=False).value >= 0).all(axis=1)
    return good


def _visible(problem: PlanningProblem, view: Views, shift: FloatArray) -> BoolArray:
    """A shift shorter than the distance to the boundary needs no test."""
    good = np.ones(len(shift), dtype=bool)
    for constraint in problem.constraints:
        if not isinstance(constraint, Visibility):
            continue
        margin = float(constraint.margin(view)[0])
        open_question = good & (np.linalg.norm(shift, axis=1) >= margin)
        if open_question.any():
            points = view.position_mm + shift[open_question]
            good[open_question] = in_region(constraint, points)
    return good


def failure_probability(
    problem: PlanningProblem,
    view: Views,
    rng: np.random.Generator,
    *,
    uncertainty: Uncertainty | None = None,
    draws: int = DRAWS,
) -> float:
    """Share of draws of independent normal errors that break a constraint."""
    sigma = (uncertainty or problem.uncertainty).sigma
    errors = rng.normal(size=(draws, len(sigma))) * sigma
    return float(np.mean(~holds(problem, view, errors)))
