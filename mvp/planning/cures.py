"""Single changes that make an impossible task possible, confirmed by planning again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvp.constraints import FocusFar, FocusNear, Resolution, Visibility, Workspace
from mvp.optics.thick_lens import focus_distance_mm
from mvp.optics.views import concatenated
from mvp.planning.blockers import FaceName, blocking_faces
from mvp.planning.chart import Chart
from mvp.planning.relaxation import (
    KINDS_OF,
    Amount,
    Knob,
    in_words,
    needed,
    relaxed,
    sensible,
)
from mvp.planning.rows import RowTable
from mvp.planning.search import Limits, climb
from mvp.planning.solve import Attempt, searched
from mvp.planning.step import JUST_INSIDE, LinearModel, max_min, relax_kinds
from mvp.visibility import Region

if TYPE_CHECKING:
    from mvp.constraints import Kind
    from mvp.optics import Views
    from mvp.planning.problem import LensBounds, PlanningProblem

_BEST = 4
_REPLAN_CANDIDATES = 10_000
_REPLAN_STARTS = 6
# A lens or tube that would do is looked for with d from just above f (an object 1250 f
# away) up to 3 f (twice life size).
_LIFTED = 3.0
_CLOSEST_GAP = 8e-4
_BISECTIONS = 6
_UNASKED_STARTS = 2
_TRIES = 4
_PERCENT = 0.01
_UNTIL_ADMISSIBLE = Limits(enough=0.0)
# Only the least that must give way is asked for: what is far behind may stop.
_BEST_ONLY = Limits(heat_steps=15, finalists=6)


@dataclass(frozen=True, eq=False)
class Cure:
    """A single change that makes the task possible.

    Attributes:
        kind: which knob, or "lens" for a wider lens range.
        text: in the user's words.
        value: factor or new bound (mm), as the knob says.
        view: a view that is admissible with it.
        index: its smallest index with the change made; >= 0 is the confirmation.
        problem: the changed problem.
    """

    kind: Knob | Literal["lens"]
    text: str
    value: float
    view: Views
    index: float
    problem: PlanningProblem


def knob_cures(
    problem: PlanningProblem, failed: Attempt, namer: FaceName
) -> tuple[list[Cure], list[str]]:
    """Every knob's cure, cheapest for the user first, and the knobs without one."""
    kinds = set(RowTable.of(problem).kinds) - problem.hard_kinds
    cures: list[Cure] = []
    no_help: list[str] = []
    for knob, turned in KINDS_OF.items():
        if not kinds.intersection(turned):
            continue
        cure = knob_cure(problem, failed, knob, namer)
        if cure is None:
            no_help.append(knob)
        else:
            cures.append(cure)
    return cures, no_help


def knob_cure(
    problem: PlanningProblem,
    failed: Attempt,
    knob: Knob,
    namer: FaceName,
) -> Cure | None:
    """Turn one knob as little as possible with all other requirements kept.

    None when no such view was found, or planning with it did not confirm it.
    """
    if knob == "visibility":
        problem = _walled(problem)
    table, chart = RowTable.of(problem), Chart.of(problem)
    table = replace(table, fixed_scales=_fixed_scales(problem, knob))
    merit = relax_kinds(table, KINDS_OF[knob])
    starts = _relaxation_starts(problem, table, failed, knob)
    model = LinearModel(table, chart, merit)
    ended = climb(problem, model, starts, limits=_BEST_ONLY)
    kept = np.flatnonzero(merit.shortfall(ended.index) <= JUST_INSIDE)
    amounts = [(int(k), needed(problem, ended.views[int(k)], knob)) for k in kept]
    amounts = [(k, a) for k, a in amounts if sensible(problem, a)]
    if not amounts:
        return None
    sign = -1.0 if knob == "resolution" else 1.0
    k, amount = min(amounts, key=lambda pair: sign * pair[1].factor)
    return _confirmed(problem, ended.views[k], amount, namer)


def _walled(problem: PlanningProblem) -> PlanningProblem:
    """With the workspace as a requirement of its own where its walls were facets.

    Seeing through what hides a feature does not let the camera through a wall.
    """
    regions = [c.region for c in problem.constraints if isinstance(c, Visibility)]
    if not any(isinstance(region, Region) and region.walls for region in regions):
        return problem
    walls = Workspace(problem.workspace)
    return replace(problem, constraints=(*problem.constraints, walls))


def _fixed_scales(problem: PlanningProblem, knob: Knob) -> dict[Kind, float]:
    """Scales in which a knob's rows are made to give way as little as possible.

    A standard deviation shrinks with distance, so that the least violation in sigmas
    is not the least in the user's unit.
    """
    scales: dict[Kind, float] = {}
    for constraint in problem.constraints:
        if constraint.kind not in KINDS_OF[knob]:
            continue
        match constraint:
            case Resolution():
                scales[constraint.kind] = _PERCENT * float(constraint.required_px.max())
            case FocusNear() | FocusFar():
                scales[constraint.kind] = _PERCENT * constraint.c_mm
            case _:
                scales[constraint.kind] = problem.uncertainty.position_mm
    return scales


def _relaxation_starts(
    problem: PlanningProblem, table: RowTable, failed: Attempt, knob: Knob
) -> Views:
    """Where to begin to give way.

    At the ends of the search that failed, at the candidates that miss least elsewhere,
    and at the best views there are without the knob's requirement.
    """
    ends = concatenated([s.view for s in failed.solutions[:_BEST]])
    others = np.array([kind not in KINDS_OF[knob] for kind in table.kinds])
    candidates = failed.screened.views
    if not len(candidates) or not others.any():
        return ends
    worst = table.index(candidates)[:, others].min(axis=1)
    chosen = np.argsort(-worst, kind="stable")[:_BEST]
    without = replace(
        problem,
        constraints=tuple(
            c for c in problem.constraints if c.kind not in KINDS_OF[knob]
        ),
        candidates=min(problem.candidates, _REPLAN_CANDIDATES),
        starts=_UNASKED_STARTS,
    )
    unasked = [s.view for s in searched(without, seed=0).solutions[:_UNASKED_STARTS]]
    return concatenated([ends, candidates[chosen], *unasked])


def _confirmed(
    problem: PlanningProblem, view: Views, amount: Amount, namer: FaceName
) -> Cure | None:
    for _ in range(_TRIES):
        changed = relaxed(problem, amount)
        table = RowTable.of(changed)
        if not len(table.kinds):
            return None
        model = LinearModel(table, Chart.of(changed), max_min(table))
        ended = climb(changed, model, view, limits=_UNTIL_ADMISSIBLE)
        index = float(table.worst(ended.index)[0])
        if index >= 0 and changed.accepted(ended.views).all():
            text = in_words(problem, ended.views, amount)
            if amount.knob == "visibility":
                names = ", ".join(blocking_faces(problem, ended.views, namer))
                text = f"blocked by {names}" if names else text
            return Cure(amount.knob, text, amount.factor, ended.views, index, changed)
        amount = amount.more()
    return None


def lens_cure(problem: PlanningProblem, seed: int) -> Cure | None:
    """Lift the bounds of d; if that helps, the smallest range that does."""
    lifted = replace(
        problem,
        lens=replace(problem.lens, d_mm=_lifted(problem.lens)),
        candidates=min(problem.candidates, _REPLAN_CANDIDATES),
        starts=min(problem.starts, _REPLAN_STARTS),
    )
    found = searched(lifted, seed=seed).solutions
    if not found or found[0].t < 0:
        return None
    view = found[0].view
    low, high = problem.lens.d_mm
    d = float(view.d_mm[0])
    if low <= d <= high:
        return Cure("lens", "search again", d, view, found[0].t, problem)
    return _narrowed(problem, view, d, high if d > high else low)


def _lifted(lens: LensBounds) -> tuple[float, float]:
    closest = lens.f_mm[0] * (1 + _CLOSEST_GAP)
    return min(closest, lens.d_mm[0]), max(_LIFTED * lens.f_mm[1], lens.d_mm[1])


def _narrowed(
    problem: PlanningProblem, view: Views, works: float, fails: float
) -> Cure | None:
    """Bisect the bound of d between a value that works and one that does not."""
    best: tuple[PlanningProblem, Views, float] | None = None
    for step in range(_BISECTIONS + 1):
        bound = works if step == 0 else (works + fails) / 2
        low, high = problem.lens.d_mm
        widened = (low, bound) if bound > high else (bound, high)
        changed = replace(problem, lens=replace(problem.lens, d_mm=widened))
        table = RowTable.of(changed)
        model = LinearModel(table, Chart.of(changed), max_min(table))
        start = changed.lens.clipped(view)
        ended = climb(changed, model, start, limits=_UNTIL_ADMISSIBLE)
        index = float(table.worst(ended.index)[0])
        if index >= 0:
            works, view, best = bound, ended.views, (changed, ended.views, index)
        else:
            fails = bound
    if best is None:
        return None
    changed, view, index = best
    side = "up" if works > problem.lens.d_mm[1] else "down"
    limit = problem.lens.d_mm[1] if side == "up" else problem.lens.d_mm[0]
    sharp = float(focus_distance_mm(works, float(view.f_mm[0])))
    text = (
        f"needs d {side} to {works:.3f} mm instead of {limit:.3f} "
        f"(sharp at {sharp:.0f} mm)"
    )
    return Cure("lens", text, works, view, index, changed)
