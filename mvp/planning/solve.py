"""The planner: pre-screen, search from distinct starts, second stage, ranking."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from mvp.constraints import margin_report
from mvp.optics.views import concatenated
from mvp.planning.candidates import Screened, distinct, glance, screen
from mvp.planning.chance import failure_probability
from mvp.planning.chart import Chart
from mvp.planning.components import component_numbers
from mvp.planning.rows import RowTable
from mvp.planning.search import Climbed, Limits, climb
from mvp.planning.starts import Start, user_starts
from mvp.planning.step import Duals, LinearModel, by_kind, max_min

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.constraints import Kind
    from mvp.geometry import FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem, Progress

Status: TypeAlias = Literal["admissible", "infeasible"]

# The second stage gives up at most a twentieth of the worst index, and is credited
# with each requirement's up to three times that.
_KEEP = 0.95
_CAP = 3.0
# A search that may stop early first looks at this little, then at twice as much.
_FIRST_CANDIDATES, _FIRST_STARTS, _FIRST_STEPS = 800, 3, 10
_SECOND_STAGE_STEPS = 25
_SECOND_STAGE_GAIN = 0.03
# Ends this close in index, and 1 mm in place, are one.
_SAME = 1e-3
_SAME_PLACE_MM = 1.0
# One row fails in one draw of 2000 there: often enough in 50 000 to compare two views.
_COMPARED_AT_SIGMA = 3.3
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


@dataclass(frozen=True, eq=False)
class Attempt:
    """Everything one run of the search found out.

    Attributes:
        solutions: best first, one per distinct end.
        screened: the candidates it started from.
    """

    solutions: tuple[Solution, ...]
    screened: Screened


def solve(
    problem: PlanningProblem,
    *,
    seed: int,
    progress: Progress | None = None,
    stop_at_index: float = np.inf,
) -> list[Solution]:
    """Search; the best solution first, also when none is admissible.

    The list is empty only when no candidate sees the features at all. The same seed
    gives the same answer.

    Args:
        problem: what is asked.
        seed: of everything random.
        progress: told the stage and the share of the work done.
        stop_at_index: a smallest index that is good enough. The search then works in
            rounds of twice the size of the last, ends with the first view that is as
            good (without a second stage), and is exhaustive only if there is none.
    """
    found = attempt(problem, seed=seed, progress=progress, stop_at_index=stop_at_index)
    return list(found.solutions)


def attempt(
    problem: PlanningProblem,
    *,
    seed: int,
    progress: Progress | None = None,
    stop_at_index: float = np.inf,
) -> Attempt:
    """``solve``, with the candidates: what an explanation of a failure needs."""
    tell = progress or (lambda stage, share: None)
    ended = searched(problem, seed=seed, progress=progress, stop_at_index=stop_at_index)
    if not ended.solutions or ended.solutions[0].t >= stop_at_index:
        return ended
    tell("second stage", 0.8)
    best = _second_stage(problem, ended.solutions[0], seed)
    tell("done", 1.0)
    return replace(ended, solutions=(best, *ended.solutions[1:]))


def searched(
    problem: PlanningProblem,
    *,
    seed: int,
    progress: Progress | None = None,
    stop_at_index: float = np.inf,
) -> Attempt:
    """The first stage alone: largest smallest index from every distinct start."""
    tell = progress or (lambda stage, share: None)
    table, rng = RowTable.of(problem), np.random.default_rng([seed, 0])
    model = LinearModel(table, Chart.of(problem), max_min(table))
    if np.isfinite(stop_at_index):
        tell("first look", 0.0)
        for look in _looks(problem):
            soon = _first_good(look, model, rng, stop_at_index)
            if soon is not None:
                tell("done", 1.0)
                return soon
    tell("candidates", 0.0)
    screened = screen(problem, table, rng)
    starts = _starts(problem, screened)
    if not starts:
        return Attempt((), screened)
    tell("search", 0.2)
    ended = climb(
        problem,
        model,
        concatenated([s.view for s in starts]),
        limits=Limits(enough=stop_at_index),
    )
    order = _ranking(ended)
    found = [_solution(problem, model, ended, k, starts[k]) for k in order]
    pieces = component_numbers(problem, ended.views.position_mm[order])
    numbered = [
        replace(solution, component=piece)
        for solution, piece in zip(found, pieces, strict=True)
    ]
    return Attempt(tuple(numbered), screened)


def _looks(problem: PlanningProblem) -> Iterator[PlanningProblem]:
    """The same problem with few candidates and starts, twice as many every time."""
    candidates, starts = _FIRST_CANDIDATES, _FIRST_STARTS
    while 2 * candidates <= problem.candidates:
        few = min(starts, problem.starts)
        yield replace(problem, candidates=candidates, starts=few, user_starts=None)
        candidates, starts = 2 * candidates, 2 * starts


def _first_good(
    problem: PlanningProblem,
    model: LinearModel,
    rng: np.random.Generator,
    stop_at_index: float,
) -> Attempt | None:
    """The first view found that is good enough; None if a short search finds none."""
    screened = glance(problem, model.table, rng)
    starts = _starts(problem, screened)
    if not starts:
        return None
    view, steps, name = starts[0].view, 0, starts[0].name
    if screened.worst[0] < stop_at_index:
        views = concatenated([start.view for start in starts])
        limits = Limits(steps=_FIRST_STEPS, enough=stop_at_index)
        ended = climb(problem, model, views, limits=limits)
        best = int(np.argmax(ended.value))
        if ended.value[best] < stop_at_index:
            return None
        view, steps, name = ended.views[best], int(ended.steps[best]), starts[best].name
    solution = described(problem, model, view, start=name, steps=steps)
    return Attempt((solution,), screened)


def _starts(problem: PlanningProblem, screened: Screened) -> list[Start]:
    chosen = distinct(problem, screened, problem.starts)
    own = [Start(screened.views[int(k)], f"candidate {k + 1}") for k in chosen]
    return [*user_starts(problem, screened), *own]


def _ranking(ended: Climbed) -> list[int]:
    """Ends by merit, without those that repeat a better one."""
    order: list[int] = []
    for k in np.argsort(-ended.value, kind="stable"):
        place = ended.views.position_mm[k]
        repeated = any(
            abs(ended.value[j] - ended.value[k]) < _SAME
            and np.linalg.norm(ended.views.position_mm[j] - place) < _SAME_PLACE_MM
            for j in order
        )
        if not repeated:
            order.append(int(k))
    return order


def _solution(
    problem: PlanningProblem, model: LinearModel, ended: Climbed, k: int, start: Start
) -> Solution:
    return described(
        problem,
        model,
        ended.views[k],
        start=start.name,
        steps=int(ended.steps[k]),
        notes=start.notes,
    )


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


def _second_stage(problem: PlanningProblem, best: Solution, seed: int) -> Solution:
    """Give up 5 % of the smallest index to raise the others, if that fails less."""
    if best.t <= 0:
        return best
    table, chart = RowTable.of(problem), Chart.of(problem)
    merit = by_kind(table, _KEEP * best.t, _CAP * best.t)
    ended = climb(
        problem,
        LinearModel(table, chart, merit),
        best.view,
        limits=Limits(steps=_SECOND_STAGE_STEPS, small_gain=_SECOND_STAGE_GAIN),
    )
    model = LinearModel(table, chart, max_min(table))
    other = described(
        problem,
        model,
        ended.views,
        start=best.start,
        steps=best.steps + int(ended.steps[0]),
        notes=best.notes,
    )
    return _safer(
        problem,
        best,
        replace(
            other,
            stage="second stage",
            first_stage_t=best.t,
            component=best.component,
        ),
        seed,
    )


def _safer(
    problem: PlanningProblem, first: Solution, second: Solution, seed: int
) -> Solution:
    """The one that fails less, with errors enlarged until failures can be counted."""
    factor = max(1.0, first.t / _COMPARED_AT_SIGMA)
    enlarged = problem.uncertainty.scaled(factor)

    def chance(solution: Solution, at: int) -> float:
        rng = np.random.default_rng([seed, 1])
        sigma = enlarged if at else problem.uncertainty
        return failure_probability(problem, solution.view, rng, uncertainty=sigma)

    chosen = first
    if second.t >= (_KEEP - 1e-3) * first.t and chance(second, 1) < chance(first, 1):
        chosen = second
    probability = chance(chosen, 0)
    return replace(chosen, failure_probability=probability)
