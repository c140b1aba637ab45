"""Search by the objective that a task names."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from mvp.planning import PRESETS, Attempt, attempt, evaluate, solve_paper
from mvp.planning.starts import user_starts

if TYPE_CHECKING:
    from mvp.planning import PaperSolution, PlanningProblem, Solution


def searched(problem: PlanningProblem, objective: str, seed: int) -> Attempt:
    """Solutions by preference.

    With one of the paper's weighted sums its admissible results come first, then those
    of the default objective: an optimum of the sum lies on a constraint and may not
    survive the rounding to motor steps.
    """
    found = attempt(problem, seed=seed)
    if objective not in PRESETS:
        return found
    sums = solve_paper(problem, PRESETS[objective], seed=seed)
    paper = [_solution(problem, s, objective) for s in sums if s.admissible]
    lost = (
        f"the optimum of the weighted sum {objective} lies on a constraint and is lost "
        "when the lens is rounded to motor steps; this is the default objective's view"
    )
    fallback = [replace(s, notes=(*s.notes, lost)) for s in found.solutions]
    return Attempt((*paper, *fallback), found.screened)


def _solution(
    problem: PlanningProblem, found: PaperSolution, objective: str
) -> Solution:
    note = (
        f"weighted sum {objective}: h = {found.value:.4g} at the {found.kept} view of "
        f"{found.start}"
    )
    solution = evaluate(problem, found.view, start=found.start)
    return replace(solution, status="admissible", notes=(*found.notes, note))


def repairs(problem: PlanningProblem, found: Attempt) -> tuple[str, ...]:
    """What was changed about the starts that a person gave."""
    starts = user_starts(problem, found.screened)
    return tuple(note for start in starts for note in start.notes)
