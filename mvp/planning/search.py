"""Trust-region sequential linear programming, many starts in step.

Each iteration models every index linearly in the orbit chart, solves one small linear
programme per start, and judges the step by the true indices. Where the step falls
short, the programme is solved again with the row values of the trial point
(second-order correction).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints.base import SHIFT
from mvp.optics.views import concatenated

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem
    from mvp.planning.rows import Linearised
    from mvp.planning.step import LinearModel, State, Step

_ACCEPT, _POOR, _GOOD, _SHORT = 0.1, 0.3, 0.7, 0.9
_GROW, _HALVE, _SHRINK = 2.0, 0.5, 0.4


@dataclass(frozen=True)
class Limits:
    """When a search stops, and how far it may step.

    ``enough``: a merit that needs no improvement; all searches stop where one has it.
    ``finalists``: only so many of the searches, the best after ``heat_steps``, go on.
    """

    steps: int = 60
    predicted_gain: float = 1e-4
    small_gain: float = 1e-3
    small_gains: int = 3
    radius: float = 1.0
    largest_radius: float = 8.0
    smallest_radius: float = 1e-6
    enough: float = np.inf
    heat_steps: int = 60
    finalists: int = 60


DEFAULT_LIMITS = Limits()


@dataclass(frozen=True, eq=False)
class Climbed:
    """Where K searches ended.

    Attributes:
        views: K views. ``index``: (K, R). ``value``: (K,) merit.
        steps: (K,) accepted steps.
    """

    views: Views
    index: FloatArray
    value: FloatArray
    steps: IntArray


class _Pool:
    """State of K searches; every array has the leading axis K."""

    def __init__(self, model: LinearModel, views: Views, limits: Limits) -> None:
        self.model = model
        self.limits = limits
        self.views = views
        self.index = model.table.index(views)
        self.value = model.merit.value(self.index)
        count = len(views)
        self.radius = np.full(count, limits.radius)
        self.small = np.zeros(count, dtype=np.int64)
        self.steps = np.zeros(count, dtype=np.int64)
        self.active = np.ones(count, dtype=bool)
        self.linear: list[Linearised | None] = [None] * count
        self.states: list[State] = []

    def refresh(self) -> None:
        """Model anew the active views that moved."""
        stale = [k for k in np.flatnonzero(self.active) if self.linear[k] is None]
        if not stale:
            return
        batch = self.model.table.linearise(
            self.views[np.array(stale)], self.model.chart
        )
        for position, k in enumerate(stale):
            self.linear[k] = batch.of(position)

    def propose(self) -> tuple[IntArray, list[Step]]:
        """Steps of the active searches; those that promise nothing stop."""
        which, steps = [], []
        self.states = self.model.states(self.views, self.radius)
        for k in np.flatnonzero(self.active):
            linear = self.linear[k]
            step = None if linear is None else self.model.solve(self.states[k], linear)
            gain = -np.inf if step is None else step.predicted - self.value[k]
            if step is None or gain < self.limits.predicted_gain:
                self.active[k] = False
                continue
            which.append(k)
            steps.append(step)
        return np.array(which, dtype=np.int64), steps

    def tried(self, which: IntArray, y: FloatArray) -> tuple[Views, FloatArray]:
        """Trial views and their indices."""
        trial = self.model.chart.retract(self.views[which], y)
        return trial, self.model.table.index(trial)

    def corrected(
        self, k: int, y: FloatArray, position_mm: FloatArray, index: FloatArray
    ) -> FloatArray:
        """Second-order correction of one step; the old step if there is none.

        Smooth rows take their values at the trial point. Distance rows keep their
        facets, whose safe inner model is exact in the true, curved shift.
        """
        linear = self.linear[k]
        if linear is None:
            return y
        table = self.model.table
        offset = index - linear.slope[0] @ y
        shift = position_mm - self.views.position_mm[k]
        curve = shift - linear.jacobian[0, SHIFT] @ y
        bent = linear.index[0] + linear.shift_slope[0] @ curve
        offset = np.where(table.curved, offset, bent)
        patched = replace(linear, index=offset[None])
        step = self.model.solve(self.states[k], patched)
        return y if step is None else step.y

    def decide(
        self,
        which: IntArray,
        gain: FloatArray,
        predicted: FloatArray,
        trial: Views,
        index: FloatArray,
        taken: BoolArray,
    ) -> None:
        """Take or refuse each trial and move its trust radius."""
        ratio = gain / predicted
        grown = self.radius[which] * np.where(
            ratio > _GOOD, _GROW, np.where(ratio < _POOR, _HALVE, 1.0)
        )
        radius = np.where(taken, grown, self.radius[which] * _SHRINK)
        self.radius[which] = np.minimum(radius, self.limits.largest_radius)
        small = taken & (gain < self.limits.small_gain)
        self.small[which] = np.where(small, self.small[which] + 1, 0)
        moved = which[taken]
        self.steps[moved] += 1
        self.index[moved] = index[taken]
        self.value[moved] = self.model.merit.value(index[taken])
        self.views = _replaced(self.views, moved, trial[taken])
        for k in moved:
            self.linear[k] = None
        self.active &= self.radius > self.limits.smallest_radius
        self.active &= self.small < self.limits.small_gains


def climb(
    problem: PlanningProblem,
    model: LinearModel,
    views: Views,
    *,
    limits: Limits = DEFAULT_LIMITS,
    visit: Callable[[Views], None] | None = None,
) -> Climbed:
    """Search from every view (K, at least one) with the target's centre in front.

    Args:
        problem: filters the steps.
        model: what is maximised, and how a step is found.
        views: starts.
        limits: when to stop.
        visit: told all views after every iteration.
    """
    pool = _Pool(model, views, limits)
    for step in range(limits.steps):
        if (pool.value >= limits.enough).any():
            break
        if step == limits.heat_steps:
            pool.active[np.argsort(-pool.value, kind="stable")[limits.finalists :]] = (
                False
            )
        pool.refresh()
        which, steps = pool.propose()
        if not len(which):
            break
        _advance(problem, pool, which, steps)
        if visit is not None:
            visit(pool.views)
    return Climbed(pool.views, pool.index, pool.value, pool.steps)


def _advance(
    problem: PlanningProblem, pool: _Pool, which: IntArray, steps: list[Step]
) -> None:
    merit = pool.model.merit
    y = np.stack([step.y for step in steps])
    predicted = np.array([step.predicted for step in steps]) - pool.value[which]
    trial, index = pool.tried(which, y)
    gain = merit.value(index) - pool.value[which]
    short = np.flatnonzero(gain < _SHORT * predicted)
    if (pool.value[which] + gain >= pool.limits.enough).any():
        short = short[:0]
    if len(short):
        again = np.stack(
            [
                pool.corrected(int(which[i]), y[i], trial.position_mm[i], index[i])
                for i in short
            ]
        )
        second, second_index = pool.tried(which[short], again)
        second_gain = merit.value(second_index) - pool.value[which[short]]
        better = second_gain > gain[short]
        chosen = short[better]
        trial = _replaced(trial, chosen, second[better])
        index[chosen] = second_index[better]
        gain[chosen] = second_gain[better]
    taken = gain > _ACCEPT * predicted
    if taken.any():
        taken[taken] = problem.accepted(trial[taken])
    pool.decide(which, gain, predicted, trial, index, taken)


def _replaced(views: Views, where: IntArray, new: Views) -> Views:
    """The batch with some views exchanged."""
    if not len(where):
        return views
    order = np.arange(len(views))
    order[where] = len(views) + np.arange(len(where))
    return concatenated([views, new])[order]
