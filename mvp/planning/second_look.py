"""A second look from farther away, where the first search ended against the features.

Right in front of the features every error is large, so that a hopeless view misses by
few standard deviations: the search is drawn there by the best candidates, and learns
nothing about what could be done from a sensible distance.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.planning.chart import Chart

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import BoolArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem
    from mvp.planning.solution import Solution

# In units of the least distance that the search allows.
_PRESSED = 1.2
_FARTHER = 2.0


def pressed(problem: PlanningProblem, view: Views) -> bool:
    """Whether a view (N = 1) ended as near to the target as the search allows."""
    chart = Chart.of(problem)
    return float(chart.target_camera(view)[0, 2]) <= _PRESSED * chart.nearest_mm


def misled(problem: PlanningProblem, ends: Sequence[Solution]) -> bool:
    """Whether nothing is admissible and most searches ended against the target."""
    if not ends or ends[0].t >= 0 or not problem.starts:
        return False
    return float(np.mean([pressed(problem, end.view) for end in ends])) > 0.5


def farther(problem: PlanningProblem) -> PlanningProblem:
    """The same problem for views that keep a distance."""
    chart = Chart.of(problem)

    def accept(views: Views) -> BoolArray:
        far = chart.target_camera(views)[:, 2] >= _FARTHER * chart.nearest_mm
        if far.any():
            far[far] = problem.accepted(views[far])
        return np.asarray(far)

    return replace(problem, accept=accept)


def in_order(
    problem: PlanningProblem, ends: Sequence[Solution]
) -> tuple[Solution, ...]:
    """Admissible ones by index, then those at a distance, then those against it."""

    def rank(end: Solution) -> tuple[bool, float]:
        return end.t < 0 and pressed(problem, end.view), -end.t

    return tuple(sorted(ends, key=rank))
