"""The paper's weighted sum of margins (15)-(17), kept for comparison.

It needs weights for every task, and its optima lie on constraints that it does not
favour; the default is the largest smallest sigma-index (``solve``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from mvp.optics.views import concatenated
from mvp.planning.candidates import distinct, screen
from mvp.planning.chart import Chart
from mvp.planning.paper_polish import polished
from mvp.planning.paper_table import PaperTable, PaperWeights
from mvp.planning.rows import RowTable
from mvp.planning.search import Limits, climb
from mvp.planning.starts import user_starts
from mvp.planning.step import LinearModel, Merit
from mvp.planning.tolerance import MESH_PRECISION_MM

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

PAPER_1 = PaperWeights(1e3, 1e-2, 1e-2, 1e-1, 0.0)
"""Experiment 1: visibility is only checked, the best admissible iterate is kept."""

PAPER_2 = PaperWeights(1e2, 1e-2, 1e-2, 1.0, 1.0)
"""Experiments 2 and 3."""

VisibilityMode: TypeAlias = Literal["constraint", "checked"]

PRESETS: dict[str, PaperWeights] = {"paper-1": PAPER_1, "paper-2": PAPER_2}

_PENALTY = 1e3
_UNBOUNDED = 1e7
_STARTS = 6
_LIMITS = Limits(
    steps=200, predicted_gain=1e-7, small_gain=1e-7, small_gains=5, radius=0.5
)
_PROBE = 1e-3
_SLACK = 1e-6


@dataclass(frozen=True, eq=False)
class PaperSolution:
    """Where the weighted sum ended.

    Attributes:
        view: the view, N = 1.
        value: h of (15), D1 capped at the workspace's farthest point.
        admissible: every constraint (16) holds.
        stationarity: gain of h that the linear model still promises per unit of trust
            radius, relative to 1 + |h|; 0 at a KKT point.
        kept: "final" where the optimisation ended, or "iterate" for the best
            admissible one on the way there.
        start: which start it came from.
        notes: repairs, in the user's words.
    """

    view: Views
    value: float
    admissible: bool
    stationarity: float
    kept: Literal["final", "iterate"]
    start: str
    notes: tuple[str, ...] = ()


def solve_paper(
    problem: PlanningProblem,
    weights: PaperWeights,
    *,
    seed: int,
    visibility: VisibilityMode = "constraint",
) -> list[PaperSolution]:
    """Maximise the weighted sum from the user's starts, or from the best candidates.

    Args:
        problem: whose constraints hold; a field of view that is no circle, and
            workspace walls, are constraints but no terms of the sum.
        weights: of the sum.
        seed: of the candidates.
        visibility: "constraint" keeps g4 >= 0 throughout, as (16) demands, whatever its
            weight; "checked" does as experiment 1 did: it is left out, and the best
            admissible iterate is kept, which is then no KKT point.

    Returns:
        Admissible solutions first, by h; empty only when no candidate sees the features.
    """
    table = PaperTable.of(problem, weights)
    merit = paper_merit(table, visibility)
    model = LinearModel(table, Chart.of(problem), merit)
    screened = screen(problem, RowTable.of(problem), np.random.default_rng([seed, 0]))
    own = user_starts(problem, screened)
    views = [start.view for start in own]
    names = [(start.name, start.notes) for start in own]
    if not own:
        for k in distinct(problem, screened, _STARTS):
            views.append(screened.views[int(k)])
            names.append((f"candidate {k + 1}", ()))
    found = [
        _from_start(problem, model, view, name, notes)
        for view, (name, notes) in zip(views, names, strict=True)
    ]
    return sorted(found, key=lambda s: (not s.admissible, -s.value))


def paper_merit(table: PaperTable, visibility: VisibilityMode = "constraint") -> Merit:
    """The sum of the terms, every constraint kept by a floor of 0.

    Visibility is kept by the precision of its boundary: beyond it only one of the
    facets that meet there is known, and a search does not find back.
    """
    groups = table.groups
    left_out = visibility == "checked" and table.weights.visibility == 0
    ignored = np.array([left_out and kind == "visibility" for kind in table.kinds])
    visible = np.array([kind == "visibility" for kind in table.kinds])
    inside = MESH_PRECISION_MM * (table.weights.visibility or 1.0)
    floors = np.where(ignored, -np.inf, np.where(visible, inside, 0.0))
    caps = np.full(int(groups.max()) + 1, _UNBOUNDED)
    return Merit(groups, caps, floors, _PENALTY)


def _from_start(
    problem: PlanningProblem,
    model: LinearModel,
    start: Views,
    name: str,
    notes: tuple[str, ...],
) -> PaperSolution:
    trail: list[Views] = []
    ended = climb(problem, model, start, limits=_LIMITS, visit=trail.append)
    final = polished(model, ended.views)
    value = model.merit.group_values(model.table.index(final)).sum(axis=1)
    if _admissible(problem, final)[0]:
        rate = stationarity(model, final)
        return PaperSolution(final, float(value[0]), True, rate, "final", name, notes)
    visited = concatenated([*trail, final])
    good = _admissible(problem, visited)
    if not good.any():
        rate = stationarity(model, final)
        return PaperSolution(final, float(value[0]), False, rate, "final", name, notes)
    values = model.merit.group_values(model.table.index(visited)).sum(axis=1)
    best = int(np.argmax(np.where(good, values, -np.inf)))
    view = visited[best]
    rate = stationarity(model, view)
    return PaperSolution(view, float(values[best]), True, rate, "iterate", name, notes)


def _admissible(problem: PlanningProblem, views: Views) -> BoolArray:
    table = RowTable.of(problem)
    return np.asarray(table.worst(table.index(views)) >= -_SLACK)


def stationarity(model: LinearModel, view: Views) -> float:
    """Relative gain per trust radius that the linear model promises at a view."""
    linear = model.table.linearise(view, model.chart)
    value: FloatArray = model.merit.value(linear.index)
    step = model.solve(model.states(view, np.array([_PROBE]))[0], linear)
    if step is None:
        return float("inf")
    gain = max(step.predicted - float(value[0]), 0.0)
    return gain / _PROBE / (1.0 + abs(float(value[0])))
