"""One step of the search: what is maximised, and the linear programme for it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mvp.constraints.base import D
from mvp.planning.linear import (
    LinearSolution,
    LinearSolver,
    Programme,
    linear_solver,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from mvp.constraints.base import Kind
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.optics import Views
    from mvp.planning.chart import Chart
    from mvp.planning.rows import Linearised, RowTable

PENALTY_PER_SIGMA = 50.0
JUST_INSIDE = 0.02
_UNBOUNDED = 1e7


@dataclass(frozen=True, eq=False)
class Merit:
    """What is maximised: sum over groups of min(cap, smallest index in the group).

    Attributes:
        groups: (R,) group of each row, -1 for none.
        caps: (G,) largest value a group is credited with.
        floors: (R,) lower bounds of rows; every sigma below costs the penalty.
        penalty: what one sigma below a floor costs.
    """

    groups: IntArray
    caps: FloatArray
    floors: FloatArray
    penalty: float = PENALTY_PER_SIGMA

    def group_values(self, index: FloatArray) -> FloatArray:
        """Credited value of every group, (N, G)."""
        columns = [
            np.minimum(index[:, self.groups == g].min(axis=1), cap)
            for g, cap in enumerate(self.caps)
        ]
        return np.stack(columns, axis=1)

    def shortfall(self, index: FloatArray) -> FloatArray:
        """Largest violation of a floor, (N,) >= 0."""
        return np.asarray(np.max(self.floors - index, axis=1, initial=0.0))

    def value(self, index: FloatArray) -> FloatArray:
        """(N,) merit of indices (N, R)."""
        credit = self.group_values(index).sum(axis=1)
        return np.asarray(credit - self.penalty * self.shortfall(index))


def max_min(table: RowTable) -> Merit:
    """The default: the smallest index over all rows, hard rows not negative."""
    groups = np.where(table.hard, -1, 0)
    floors = np.where(table.hard, 0.0, -np.inf)
    return Merit(groups, np.array([_UNBOUNDED]), floors)


def by_kind(table: RowTable, floor: float, cap: float) -> Merit:
    """Second stage: the sum over kinds of the worst index, none below ``floor``."""
    soft = [k for k, hard in zip(table.kinds, table.hard, strict=True) if not hard]
    number = {kind: g for g, kind in enumerate(dict.fromkeys(soft))}
    groups = [
        -1 if hard else number[kind]
        for kind, hard in zip(table.kinds, table.hard, strict=True)
    ]
    floors = np.where(table.hard, 0.0, floor)
    return Merit(np.array(groups), np.full(len(number), cap), floors)


def relax_kinds(table: RowTable, kinds: Collection[Kind]) -> Merit:
    """The worst index of some requirements, all others kept just inside.

    Exactly on the boundary a view may count as outside, from where a search does not
    come back; hence the small floor.
    """
    chosen = np.array([k in kinds for k in table.kinds])
    floors = np.where(chosen, -np.inf, np.where(table.hard, 0.0, JUST_INSIDE))
    return Merit(np.where(chosen, 0, -1), np.array([_UNBOUNDED]), floors)


@dataclass(frozen=True, eq=False)
class Duals:
    """Who holds the optimum: weights of rows (sum 1 for one group) and of bounds.

    Attributes:
        rows: (R,) dual of every row, >= 0.
        bounds: dual of a lens bound by name ("d_min", "f_max", ...), merit per mm.
    """

    rows: FloatArray
    bounds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Step:
    """A step y (n,), the merit the model promises there, and who limits it."""

    y: FloatArray
    predicted: float
    find_duals: Callable[[], Duals]

    @property
    def duals(self) -> Duals:
        """Who limits it; worked out when asked for, as few steps are."""
        return self.find_duals()


class Table(Protocol):
    """Rows that a search maximises: sigma-indices, or the paper's own forms."""

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Requirement of each row, (R,)."""
        ...

    @property
    def curved(self) -> BoolArray:
        """Rows that are no distance to a facet, (R,)."""
        ...

    def index(self, views: Views) -> FloatArray:
        """Values (N, R)."""
        ...

    def linearise(self, views: Views, chart: Chart) -> Linearised:
        """Values and slopes."""
        ...


@dataclass(frozen=True, eq=False)
class State:
    """Box (n,) of the step and lens values of one view, mm."""

    low: FloatArray
    high: FloatArray
    d_mm: float
    f_mm: float
    a_mm: float


class LinearModel:
    """Builds and solves the linear programme of one view.

    Columns: y, one t per group, one shortfall v. Rows: index >= t of its group,
    index + v >= floor, lens bounds on d.
    """

    def __init__(self, table: Table, chart: Chart, merit: Merit) -> None:
        self.table = table
        self.chart = chart
        self.merit = merit
        self._solver: LinearSolver = linear_solver()

    def states(self, views: Views, radius: FloatArray) -> list[State]:
        """What the programme must know of each view besides its rows."""
        low, high = self.chart.box(views, radius)
        return [
            State(low[k], high[k], float(d), float(f), float(a))
            for k, (d, f, a) in enumerate(
                zip(views.d_mm, views.f_mm, views.a_mm, strict=True)
            )
        ]

    def solve(self, state: State, model: Linearised) -> Step | None:
        """The best step of one view inside its box; None if there is none."""
        low, high = state.low, state.high
        index, slope = model.index[0], model.slope[0]
        grouped, floored = self._relevant(index, slope, np.maximum(-low, high))
        rows, rows_low = self._index_rows(index, slope, grouped, floored)
        bounds, bounds_low, names = self._lens_rows(state, model.jacobian[0])
        n_groups = len(self.merit.caps)
        cost = np.zeros(rows.shape[1])
        cost[self.chart.n :] = 1.0
        cost[-1] = -self.merit.penalty
        programme = Programme(
            cost,
            rows=np.concatenate([rows, bounds]),
            rows_low=np.concatenate([rows_low, bounds_low]),
            low=np.concatenate([low, np.full(n_groups, -_UNBOUNDED), [0.0]]),
            high=np.concatenate([high, self.merit.caps, [_UNBOUNDED]]),
        )
        solution = self._solver.maximise(programme)
        if solution is None:
            return None
        chosen = np.concatenate([grouped, floored])
        y = np.clip(solution.x[: self.chart.n], low, high)
        duals = partial(self._duals, solution, chosen, names, state)
        return Step(y, float(cost @ solution.x), duals)

    def _relevant(
        self, index: FloatArray, slope: FloatArray, reach: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Rows that can matter within the box: as members of a group, as floors."""
        spread = np.abs(slope) @ reach
        member = np.zeros(len(index), dtype=bool)
        for g, cap in enumerate(self.merit.caps):
            group = self.merit.groups == g
            best = min(float((index + spread)[group].min()), float(cap))
            member |= group & (index - spread <= best)
        floored = index - spread < self.merit.floors
        return np.flatnonzero(member), np.flatnonzero(floored)

    def _index_rows(
        self,
        index: FloatArray,
        slope: FloatArray,
        grouped: IntArray,
        floored: IntArray,
    ) -> tuple[FloatArray, FloatArray]:
        n, n_groups = self.chart.n, len(self.merit.caps)
        rows = np.zeros((len(grouped) + len(floored), n + n_groups + 1))
        rows[: len(grouped), :n] = slope[grouped]
        rows[np.arange(len(grouped)), n + self.merit.groups[grouped]] = -1.0
        rows[len(grouped) :, :n] = slope[floored]
        rows[len(grouped) :, -1] = 1.0
        low = np.concatenate(
            [-index[grouped], self.merit.floors[floored] - index[floored]]
        )
        return rows, low

    def _lens_rows(
        self, state: State, jacobian: FloatArray
    ) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
        """d_min and d_max as rows; f and a are bounds of their own coordinates."""
        width = self.chart.n + len(self.merit.caps) + 1
        if not self.chart.lens.d_free:
            return np.zeros((0, width)), np.zeros(0), ()
        rows = np.zeros((2, width))
        rows[0, : self.chart.n] = jacobian[D]
        rows[1, : self.chart.n] = -jacobian[D]
        d_low, d_high = self.chart.lens.d_mm
        gaps = (d_low - state.d_mm, state.d_mm - d_high)
        low = np.minimum(np.array(gaps), 0.0)
        return rows, low, ("d_min", "d_max")

    def _duals(
        self,
        solution: LinearSolution,
        chosen: IntArray,
        names: tuple[str, ...],
        state: State,
    ) -> Duals:
        weights = np.zeros(len(self.table.kinds))
        np.add.at(weights, chosen, np.abs(solution.row_duals[: len(chosen)]))
        bounds = {
            name: float(abs(dual))
            for name, dual in zip(names, solution.row_duals[len(chosen) :], strict=True)
            if abs(dual) > 1e-9
        }
        return Duals(weights, bounds | self._box_duals(solution, state))

    def _box_duals(self, solution: LinearSolution, state: State) -> dict[str, float]:
        """Duals of f and a where the lens, not the trust region, is the bound."""
        lens = self.chart.lens
        column = self.chart.n_orbit + 3 + int(lens.d_free)
        found = {}
        for name, free, value, (low, high) in (
            ("f", lens.f_free, state.f_mm, lens.f_mm),
            ("a", lens.a_free, state.a_mm, lens.a_mm),
        ):
            if not free:
                continue
            dual = abs(float(solution.box_duals[column])) / value
            moved = value * float(np.exp(solution.x[column]))
            if dual > 1e-9 and np.isclose(moved, low, rtol=1e-6):
                found[f"{name}_min"] = dual
            if dual > 1e-9 and np.isclose(moved, high, rtol=1e-6):
                found[f"{name}_max"] = dual
            column += 1
        return found
