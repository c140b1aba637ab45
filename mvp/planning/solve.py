"""The planner: pre-screen, search from distinct starts, second stage, ranking."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.optics.views import concatenated
from mvp.planning.candidates import Screened, distinct, glance, screen
from mvp.planning.chance import failure_probability
from mvp.planning.chart import Chart
from mvp.planning.components import component_numbers
from mvp.planning.distances import distance_bounds_mm
from mvp.planning.rows import RowTable
from mvp.planning.search import Climbed, Limits, climb
from mvp.planning.second_look import farther, in_order, misled
from mvp.planning.solution import Solution, described
from mvp.planning.starts import Start, user_starts
from mvp.planning.step import LinearModel, by_kind, max_min

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem, Progress

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


@dataclass(frozen=True, eq=False)
class Attempt:
    """Everything one run of the search found out.

    Attributes:
        solutions: best first, one per distinct end; where none is admissible, those
            pressed against the target come last.
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
            rounds of twice the size of the last and ends with the first view that is
            as good, without a second stage; ``progress`` hears "description" when it
            holds that view. Without such a view it ends as it does by default.
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
    if misled(problem, ended.solutions):
        again = searched(farther(problem), seed=seed, stop_at_index=stop_at_index)
        ends = in_order(problem, (*ended.solutions, *again.solutions))
        ended = replace(ended, solutions=ends)
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
    if np.isfinite(stop_at_index):
        soon = _first_good(problem, table, rng, tell, stop_at_index)
        if soon is not None:
            return soon
    tell("candidates", 0.0)
    screened = screen(problem, table, rng)
    starts = _starts(problem, screened)
    if not starts:
        return Attempt((), screened)
    tell("search", 0.2)
    model = LinearModel(table, Chart.of(problem), max_min(table))
    ended = climb(problem, model, _views(starts), limits=Limits(enough=stop_at_index))
    order = _ranking(ended)
    found = [_solution(problem, model, ended, k, starts[k]) for k in order]
    pieces = component_numbers(problem, ended.views.position_mm[order])
    numbered = [
        replace(solution, component=piece)
        for solution, piece in zip(found, pieces, strict=True)
    ]
    return Attempt(tuple(numbered), screened)


def _first_good(
    problem: PlanningProblem,
    table: RowTable,
    rng: np.random.Generator,
    tell: Progress,
    stop_at_index: float,
) -> Attempt | None:
    """The first view found that is good enough; None if short searches find none."""
    tell("first look", 0.0)
    within = distance_bounds_mm(problem)
    model = LinearModel(table, Chart.of(problem), max_min(table))
    for look in _looks(problem):
        screened = glance(look, table, rng, within)
        ended = _good_of(look, model, screened, stop_at_index)
        if ended is None:
            continue
        tell("description", 0.9)
        start, view, steps = ended
        found = described(
            problem, model, view, start=start.name, steps=steps, notes=start.notes
        )
        (piece,) = component_numbers(problem, view.position_mm)
        tell("done", 1.0)
        return Attempt((replace(found, component=piece),), screened)
    return None


def _good_of(
    look: PlanningProblem,
    model: LinearModel,
    screened: Screened,
    stop_at_index: float,
) -> tuple[Start, Views, int] | None:
    """A start, the view that is good enough, and how many steps lie between them."""
    if len(screened.views) and screened.worst[0] >= stop_at_index:
        best = screened.views[0]
        return Start(best, _name(0)), best, 0
    starts = _starts(look, screened)
    if not starts:
        return None
    limits = Limits(steps=_FIRST_STEPS, enough=stop_at_index)
    ended = climb(look, model, _views(starts), limits=limits)
    k = int(np.argmax(ended.value))
    if ended.value[k] < stop_at_index:
        return None
    return starts[k], ended.views[k], int(ended.steps[k])


def _looks(problem: PlanningProblem) -> Iterator[PlanningProblem]:
    """The same problem with few candidates and starts, twice as many every time.

    Nothing is looked at where only a person's own starts are to be searched from.
    """
    if not problem.starts:
        return
    candidates, starts = _FIRST_CANDIDATES, _FIRST_STARTS
    while 2 * candidates <= problem.candidates:
        few = min(starts, problem.starts)
        yield replace(problem, candidates=candidates, starts=few)
        candidates, starts = 2 * candidates, 2 * starts


def _starts(problem: PlanningProblem, screened: Screened) -> list[Start]:
    chosen = distinct(problem, screened, problem.starts)
    own = [Start(screened.views[int(k)], _name(int(k))) for k in chosen]
    return [*user_starts(problem, screened), *own]


def _name(candidate: int) -> str:
    return f"candidate {candidate + 1}"


def _views(starts: list[Start]) -> Views:
    return concatenated([start.view for start in starts])


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

    def chance(solution: Solution, enlarged: float) -> float:
        rng = np.random.default_rng([seed, 1])
        return failure_probability(problem, solution.view, rng, enlarged=enlarged)

    chosen = first
    if second.t >= (_KEEP - 1e-3) * first.t and chance(second, factor) < chance(
        first, factor
    ):
        chosen = second
    probability = chance(chosen, 1.0)
    return replace(chosen, failure_probability=probability)
