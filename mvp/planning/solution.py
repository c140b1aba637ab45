"""All that is known of one view: margins, indices, and who binds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from mvp.constraints import margin_report
from mvp.planning.chart import Chart
from mvp.planning.rows import RowTable
from mvp.planning.step import Duals, LinearModel, max_min

if TYPE_CHECKING:
    from mvp.constraints import Kind
    from mvp.geometry import FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

Status: TypeAlias = Literal["admissible", "infeasible"]

# Box, in the chart's coordinates, in which the duals of a view are found.
_PROBE_RADIUS = 0.05
_SAFE_SIGMA = 3.0


@dataclass(frozen=True)
class KindMargin:
    """Worst margin of one requirement at one view.

    Attributes:
        value: in ``unit`` as a plan promises it; inf when ``unbounded``.
        index: smallest of its rows in standard deviations.
        row: what the worst row is about.
    """

    value: float
    unit: str
    index: float
    unbounded: bool
    row: str


@dataclass(frozen=True, eq=False)
class Solution:
    """One view that the search ended at.

    Attributes:
        view: the view, N = 1.
        index: (R,) every row in standard deviations.
        t: the smallest of them.
        first_stage_t: the largest smallest index, before 5 % of it were given up.
        status: whether every constraint holds.
        margins: worst margin of every requirement.
        binding: requirement with the largest dual.
        binding_row: its row, in the user's words.
        duals: who holds the optimum.
        start: where the search began.
        stage: what was maximised last.
        steps: accepted steps.
        failure_probability: at the stated errors; None if not drawn.
        component: number of the region's piece by size; None if it is in one piece.
        notes: repairs and choices, in the user's words.
    """

    view: Views
    index: FloatArray
    t: float
    first_stage_t: float
    status: Status
    margins: dict[Kind, KindMargin]
    binding: Kind
    binding_row: str
    duals: Duals
    start: str
    stage: Literal["max-min", "second stage"]
    steps: int
    failure_probability: float | None = None
    component: int | None = None
    notes: tuple[str, ...] = field(default=())


def described(
    problem: PlanningProblem,
    model: LinearModel,
    view: Views,
    *,
    start: str,
    steps: int = 0,
    notes: tuple[str, ...] = (),
) -> Solution:
    """All that is known of one view: margins, indices, who binds."""
    table = RowTable.of(problem)
    linear = table.linearise(view, model.chart)
    index = linear.index[0]
    state = model.states(view, np.array([_PROBE_RADIUS]))[0]
    step = model.solve(state, linear)
    duals = Duals(np.zeros(len(index))) if step is None else step.duals
    t = float(table.worst(linear.index)[0])
    row = _binding_row(table, index, duals)
    return Solution(
        view=view,
        index=index,
        t=t,
        first_stage_t=t,
        status="admissible" if t >= 0 else "infeasible",
        margins=margins(problem, view, index),
        binding=table.kinds[row],
        binding_row=table.labels[row],
        duals=duals,
        start=start,
        stage="max-min",
        steps=steps,
        notes=tuple(dict.fromkeys((*notes, *_warnings(t)))),
    )


def _warnings(t: float) -> tuple[str, ...]:
    if 0 <= t < _SAFE_SIGMA:
        return (
            f"admissible, but only {t:.2f} standard deviations from failing: expect "
            "pictures that do not keep the specification",
        )
    return ()


def evaluate(
    problem: PlanningProblem, view: Views, *, start: str = "given"
) -> Solution:
    """A given view (N = 1), such as one of rounded motor steps, without any search."""
    table = RowTable.of(problem)
    model = LinearModel(table, Chart.of(problem), max_min(table))
    return described(problem, model, view, start=start)


def _binding_row(table: RowTable, index: FloatArray, duals: Duals) -> int:
    """The row with the largest dual of the requirement with the largest share."""
    if duals.rows.sum() <= 0:
        return int(np.argmin(np.where(table.hard, np.inf, index)))
    share = {kind: duals.rows[table.mask(kind)].sum() for kind in set(table.kinds)}
    kind = max(sorted(share), key=lambda k: float(share[k]))
    return int(np.argmax(np.where(table.mask(kind), duals.rows, -1.0)))


def margins(
    problem: PlanningProblem, view: Views, index: FloatArray
) -> dict[Kind, KindMargin]:
    """Worst margin of every requirement, in the plan's units and in sigmas.

    Args:
        problem: whose requirements.
        view: N = 1.
        index: (R,) sigma-indices of the view's rows.
    """
    found: dict[Kind, KindMargin] = {}
    start = 0
    for constraint in problem.constraints:
        rows = index[start : start + len(constraint.labels)]
        start += len(constraint.labels)
        if not len(rows):
            continue
        report = margin_report(constraint, view)
        margin = KindMargin(
            float(report.value[0]),
            report.unit,
            float(rows.min()),
            bool(report.unbounded[0]),
            report.label(0),
        )
        known = found.get(constraint.kind)
        if known is None or margin.index < known.index:
            found[constraint.kind] = margin
    return found
