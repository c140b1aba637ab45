"""A planner that shares no search with ours: differential evolution over views.

It works in coordinates of its own in which margins are nearly separable (direction,
log distance, aim, log focus, roll, log f, log a), on the same rows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import differential_evolution

from mvp.optics import Views
from mvp.planning.candidates import looking_at
from mvp.planning.rows import RowTable

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.planning import PlanningProblem

_AIM = 0.3
_FOCUS = (-0.6, 1.5)
_NEAREST = 1.5
_MEMBERS_PER_COORDINATE = 15


def evolved(problem: PlanningProblem, *, seed: int, evaluations: int) -> float:
    """Largest smallest index that differential evolution finds.

    Args:
        problem: what is asked.
        seed: of the evolution.
        evaluations: views that it may look at.
    """
    table = RowTable.of(problem)
    bounds = _bounds(problem)

    def cost(x: FloatArray) -> FloatArray:
        columns = x[:, None] if x.ndim == 1 else x
        return -table.worst(table.index(orbit_views(columns, problem)))

    population = _MEMBERS_PER_COORDINATE * len(bounds)
    result = differential_evolution(
        cost,
        bounds,
        rng=np.random.default_rng(seed),
        maxiter=evaluations // population - 1,
        popsize=_MEMBERS_PER_COORDINATE,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    return -float(result.fun)


def _bounds(problem: PlanningProblem) -> list[tuple[float, float]]:
    nearest = np.log(_NEAREST * max(problem.target_radius_mm, 1.0))
    bounds = [(-np.pi, np.pi), (-1.0, 1.0), (nearest, np.log(problem.farthest_mm))]
    bounds += [(-_AIM, _AIM), (-_AIM, _AIM), _FOCUS]
    if problem.roll_free:
        bounds.append((-np.pi, np.pi))
    for free, (low, high) in (
        (problem.lens.f_free, problem.lens.f_mm),
        (problem.lens.a_free, problem.lens.a_mm),
    ):
        if free:
            bounds.append((float(np.log(low)), float(np.log(high))))
    return bounds


def orbit_views(x: FloatArray, problem: PlanningProblem) -> Views:
    """Views of coordinates (n, N), in the order of ``_bounds``."""
    azimuth, sine, log_distance, tilt_x, tilt_y, focus, *rest = x
    count = x.shape[1]
    roll = rest.pop(0) if problem.roll_free else np.zeros(count)
    f = np.exp(rest.pop(0)) if problem.lens.f_free else problem.lens.f_mm[0]
    a = np.exp(rest.pop(0)) if problem.lens.a_free else problem.lens.a_mm[0]
    cosine = np.sqrt(1 - sine**2)
    out = np.stack([cosine * np.cos(azimuth), cosine * np.sin(azimuth), sine], axis=1)
    distance = np.exp(log_distance)
    position = problem.target_centre_mm + out * distance[:, None]
    rotation = _aimed(problem.target_centre_mm, position, tilt_x, tilt_y, roll)
    sharp = np.maximum(distance * np.exp(focus), f * 1.01)
    return Views(
        rotation,
        position,
        np.clip(f * sharp / (sharp - f), *problem.lens.d_mm),
        np.broadcast_to(f, count),
        np.broadcast_to(a, count),
        np.full(count, problem.lens.e_mm),
    )


def _aimed(
    target_mm: FloatArray,
    position_mm: FloatArray,
    tilt_x: FloatArray,
    tilt_y: FloatArray,
    roll: FloatArray,
) -> FloatArray:
    """(N, 3, 3) cameras at the target, then tilted and rolled."""
    base = looking_at(target_mm, position_mm)
    tilts = tilt_x[:, None] * base[:, :, 0] + tilt_y[:, None] * base[:, :, 1]
    tilted = looking_at(np.zeros(3), -(base[:, :, 2] + tilts))
    x, y, n = np.moveaxis(tilted, 2, 0)
    cosine, sine = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, n], axis=2)
