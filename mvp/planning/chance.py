"""How likely a view fails under the cell's errors, by drawing them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from mvp.constraints import N_COORDINATES, SHIFT, TURN, Uncertainty, Visibility
from mvp.constraints.base import A, D, F
from mvp.planning.candidates import in_region

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.constraints import Constraint, Kind
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
    for part, views in _chunks(view, errors):
        for constraint in _plain(problem):
            good[part] &= _kept(constraint, views)
    for constraint in _sights(problem):
        good[good] = _visible(constraint, view, errors[good, SHIFT])
    return good


def held_by_kind(
    problem: PlanningProblem, view: Views, errors: FloatArray
) -> dict[Kind, BoolArray]:
    """Which requirement still holds with each of the errors (N, 9), (N,) each."""
    plain, sights = _plain(problem), _sights(problem)
    kinds = [constraint.kind for constraint in (*plain, *sights)]
    held = {kind: np.ones(len(errors), dtype=bool) for kind in kinds}
    for part, views in _chunks(view, errors):
        for constraint in plain:
            held[constraint.kind][part] &= _kept(constraint, views)
    for constraint in sights:
        held[constraint.kind] &= _visible(constraint, view, errors[:, SHIFT])
    return held


def _plain(problem: PlanningProblem) -> list[Constraint]:
    """What is evaluated row by row; hard kinds are not moved by errors."""
    return [
        constraint
        for constraint in problem.constraints
        if constraint.kind not in problem.hard_kinds
        and not isinstance(constraint, Visibility)
    ]


def _sights(problem: PlanningProblem) -> list[Visibility]:
    return [c for c in problem.constraints if isinstance(c, Visibility)]


def _chunks(view: Views, errors: FloatArray) -> Iterator[tuple[slice, Views]]:
    """The perturbed views, not too many at once, and which errors they are of."""
    for start in range(0, len(errors), _CHUNK):
        part = slice(start, start + _CHUNK)
        yield part, perturbed(view, errors[part])


def _kept(constraint: Constraint, views: Views) -> BoolArray:
    rows = constraint.rows(views, gradient=False)
    return np.asarray((rows.value >= 0).all(axis=1))


def _visible(constraint: Visibility, view: Views, shift: FloatArray) -> BoolArray:
    """A shift shorter than the distance to the boundary needs no test."""
    good = np.ones(len(shift), dtype=bool)
    margin = float(constraint.margin(view)[0])
    open_question = np.linalg.norm(shift, axis=1) >= margin
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
    enlarged: float = 1.0,
) -> float:
    """Share of draws of normal errors that break a constraint.

    Args:
        problem: whose constraints, and whose errors.
        view: N = 1.
        rng: draws the errors.
        uncertainty: independent errors to draw instead of the problem's own.
        draws: how many.
        enlarged: makes all errors larger by one factor.
    """
    if uncertainty is not None:
        problem = replace(problem, uncertainty=uncertainty, errors=None)
    errors = drawn_errors(problem, view, rng, draws, enlarged=enlarged)
    return float(np.mean(~holds(problem, view, errors)))


def drawn_errors(
    problem: PlanningProblem,
    view: Views,
    rng: np.random.Generator,
    draws: int,
    *,
    enlarged: float = 1.0,
) -> FloatArray:
    """Normal errors (draws, 9) of one view, as measured or else as stated."""
    white = rng.normal(size=(draws, N_COORDINATES))
    if problem.errors is None:
        return np.asarray(white * (problem.uncertainty.sigma * enlarged))
    root = root_of(problem.errors.covariance(view)[0])
    return np.asarray(white @ (root.T * enlarged))


def root_of(covariance: FloatArray) -> FloatArray:
    """L (n, n) with L L' = covariance, which may be singular."""
    size = np.sqrt(np.diag(covariance).clip(min=0))
    safe = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    return np.asarray(safe[:, None] * vectors * np.sqrt(values.clip(min=0)))
