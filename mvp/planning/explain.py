"""Why nothing is admissible, and the least that would change it.

The same search is asked three more questions: which rows and bounds hold the best
view back (duals), which single requirement could give way (the others hard), and
whether the lens range alone is the cause. Every cure is confirmed by planning with it.
The search is local, so "no help" means that none was found.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from mvp.constraints import FocusFar, FocusNear, Resolution, Visibility
from mvp.optics.thick_lens import focus_distance_mm
from mvp.optics.views import concatenated
from mvp.planning.chart import Chart
from mvp.planning.relaxation import (
    KINDS_OF,
    Amount,
    Knob,
    in_words,
    needed,
    relaxed,
)
from mvp.planning.rows import RowTable
from mvp.planning.search import Limits, climb
from mvp.planning.solve import Attempt, Solution, searched
from mvp.planning.step import JUST_INSIDE, LinearModel, max_min, relax_kinds

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.constraints import Kind
    from mvp.geometry import FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import LensBounds, PlanningProblem

    FaceName: TypeAlias = Callable[[int], str]

_BEST = 4
_MINOR_DUAL = 0.01
_REPLAN_CANDIDATES = 10_000
_REPLAN_STARTS = 6
_LIFTED = 3.0
_CLOSEST_GAP = 8e-4
_BISECTIONS = 6
_TRIES = 4
_SAMPLES = 5
_PERCENT = 0.01
_CLEAR_OF_TARGET = 1.2
_UNTIL_ADMISSIBLE = Limits(enough=0.0)


@dataclass(frozen=True)
class Conflict:
    """One requirement or lens bound that holds the best view back.

    Attributes:
        name: requirement, or a bound such as "d_max".
        weight: its dual; requirements sum to 1, bounds are sigma per mm.
        text: what it means.
    """

    name: str
    weight: float
    text: str


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


@dataclass(frozen=True, eq=False)
class Explanation:
    """The answer to "why not".

    Attributes:
        reason: one sentence.
        nearest: the least bad view, None if the features can be seen from nowhere.
        conflicts: who holds it back, strongest first.
        cures: confirmed single changes, cheapest for the user first.
        no_help: knobs for which no cure was found.
        fix: what to do, one sentence.
        searched: what the statement rests on.
    """

    reason: str
    nearest: Solution | None
    conflicts: tuple[Conflict, ...]
    cures: tuple[Cure, ...]
    no_help: tuple[str, ...]
    fix: str
    searched: str
    blockers: tuple[str, ...] = field(default=())

    @property
    def nearest_data(self) -> dict[str, float | str | list[float]]:
        """The nearest view as plain data for a plan file."""
        if self.nearest is None:
            return {}
        view = self.nearest.view
        return {
            "position_mm": [float(v) for v in view.position_mm[0]],
            "view_direction": [float(v) for v in view.direction[0]],
            "f_mm": float(view.f_mm[0]),
            "d_mm": float(view.d_mm[0]),
            "a_mm": float(view.a_mm[0]),
            "smallest_index": self.nearest.t,
            "binding": self.nearest.binding,
        }


def explain(
    problem: PlanningProblem,
    failed: Attempt,
    *,
    seed: int,
    name_face: FaceName | None = None,
) -> Explanation:
    """Explain an attempt that ended without an admissible view.

    Args:
        problem: what was asked.
        failed: what the search found.
        seed: for the repeated searches.
        name_face: how to call a face id of the occluding scene.

    Raises:
        ValueError: the attempt has an admissible view.
    """
    if failed.solutions and failed.solutions[0].status == "admissible":
        raise ValueError("there is nothing to explain: a view is admissible")
    namer = name_face or (lambda face: f"face {face}")
    searched = (
        f"none found among {failed.screened.tried} candidates and "
        f"{len(failed.solutions)} searches"
    )
    if not failed.solutions:
        return _seen_from_nowhere(problem, searched, namer)
    best = _sensible(problem, failed.solutions)
    conflicts = conflict_set(problem, best)
    cures, no_help = _knob_cures(problem, failed, namer)
    lens = lens_cure(problem, seed)
    if lens is not None:
        cures = [lens, *cures]
    blockers = blocking_faces(problem, best.view, namer)
    return Explanation(
        reason=_reason(best, conflicts, lens is not None),
        nearest=best,
        conflicts=conflicts,
        cures=tuple(cures),
        no_help=tuple(no_help),
        fix=_fix(cures),
        searched=searched,
        blockers=blockers,
    )


def _sensible(problem: PlanningProblem, ends: tuple[Solution, ...]) -> Solution:
    """The best end that is not pressed against the target.

    Right in front of the features every error is large, so that a hopeless view can
    miss by few standard deviations.
    """
    chart = Chart.of(problem)
    for end in ends:
        if chart.target_camera(end.view)[0, 2] > _CLEAR_OF_TARGET * chart.nearest_mm:
            return end
    return ends[0]


def conflict_set(problem: PlanningProblem, best: Solution) -> tuple[Conflict, ...]:
    """Requirements and lens bounds with a dual at the best view, strongest first."""
    table = RowTable.of(problem)
    total = float(best.duals.rows.sum()) or 1.0
    found = []
    for kind in dict.fromkeys(table.kinds):
        mask = table.mask(kind)
        share = float(best.duals.rows[mask].sum()) / total
        if share > _MINOR_DUAL:
            row = int(np.argmax(np.where(mask, best.duals.rows, -1.0)))
            margin = best.margins[kind]
            text = f"{table.labels[row]}: {margin.value:.3g} {margin.unit}"
            found.append(Conflict(kind, share, text))
    bounds = [
        Conflict(name, dual, _bound_words(problem.lens, best.view, name))
        for name, dual in best.duals.bounds.items()
    ]
    rows = sorted(found, key=lambda c: -c.weight)
    return (*sorted(bounds, key=lambda c: -c.weight), *rows)


def _bound_words(lens: LensBounds, view: Views, name: str) -> str:
    low, high = {"d": lens.d_mm, "f": lens.f_mm, "a": lens.a_mm}[name[0]]
    f = float(view.f_mm[0])
    if name == "d_max":
        sharp = float(focus_distance_mm(high, f))
        return f"focus cannot be set closer than d = {high:.3f} mm (sharp at {sharp:.0f} mm)"
    if name == "d_min":
        sharp = float(focus_distance_mm(low, f))
        return (
            f"focus cannot be set farther than d = {low:.3f} mm (sharp at "
            f"{sharp:.0f} mm)"
        )
    what = "focal length" if name[0] == "f" else "aperture"
    side, limit = ("below", low) if name.endswith("min") else ("above", high)
    return f"the {what} cannot be set {side} {limit:.3f} mm"


def _reason(
    best: Solution, conflicts: tuple[Conflict, ...], lens_is_cause: bool
) -> str:
    names = ", ".join(c.name for c in conflicts if not _is_bound(c))
    bounds = "; ".join(c.text for c in conflicts if _is_bound(c))
    text = (
        f"{names} cannot be kept together: the best view misses by {-best.t:.1f} sigma"
    )
    if bounds:
        text += f"; {bounds}"
    return text + ("; the lens range is the cause" if lens_is_cause else "")


def _is_bound(conflict: Conflict) -> bool:
    return conflict.name.endswith(("_min", "_max"))


def _fix(cures: list[Cure]) -> str:
    if not cures:
        return (
            "no single change was found to help; split the features over two views, "
            "or change part, fixture or lens"
        )
    return "; or ".join(cure.text for cure in cures)


def _knob_cures(
    problem: PlanningProblem, failed: Attempt, namer: FaceName
) -> tuple[list[Cure], list[str]]:
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
    table, chart = RowTable.of(problem), Chart.of(problem)
    table = replace(table, fixed_scales=_fixed_scales(problem, knob))
    merit = relax_kinds(table, KINDS_OF[knob])
    starts = _relaxation_starts(problem, table, failed, knob)
    ended = climb(problem, LinearModel(table, chart, merit), starts)
    kept = np.flatnonzero(merit.shortfall(ended.index) <= JUST_INSIDE)
    amounts = [(int(k), needed(problem, ended.views[int(k)], knob)) for k in kept]
    amounts = [(k, a) for k, a in amounts if a.sensible]
    if not amounts:
        return None
    sign = -1.0 if knob == "resolution" else 1.0
    k, amount = min(amounts, key=lambda pair: sign * pair[1].factor)
    return _confirmed(problem, ended.views[k], amount, namer)


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
    """The best ends of the search, and the candidates that miss least elsewhere."""
    ends = concatenated([s.view for s in failed.solutions[:_BEST]])
    others = np.array([kind not in KINDS_OF[knob] for kind in table.kinds])
    candidates = failed.screened.views
    if not len(candidates) or not others.any():
        return ends
    worst = table.index(candidates)[:, others].min(axis=1)
    chosen = np.argsort(-worst, kind="stable")[:_BEST]
    return concatenated([ends, candidates[chosen]])


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


def _seen_from_nowhere(
    problem: PlanningProblem, searched: str, namer: FaceName
) -> Explanation:
    regions = [c.region for c in problem.constraints if isinstance(c, Visibility)]
    words = "; ".join(str(getattr(region, "binding", "")) for region in regions).strip(
        "; "
    )
    reason = "no place in the workspace sees the features whole"
    if problem.accept is not None:
        reason += " and can be reached"
    return Explanation(
        reason=f"{reason}: {words}" if words else reason,
        nearest=None,
        conflicts=(),
        cures=(),
        no_help=(),
        fix=(
            "give a larger workspace, move what is in the way, or split the features "
            "over several views"
        ),
        searched=searched,
        blockers=(),
    )


def blocking_faces(
    problem: PlanningProblem, view: Views, namer: FaceName
) -> tuple[str, ...]:
    """Faces that lie between a view and points of the features, most often first."""
    counts: dict[int, int] = {}
    for constraint in problem.constraints:
        if not isinstance(constraint, Visibility):
            continue
        for binding in getattr(constraint.region, "bindings", ()):
            for face in _first_faces(binding, view.position_mm[0]):
                counts[face] = counts.get(face, 0) + 1
    return tuple(namer(face) for face in sorted(counts, key=lambda f: -counts[f]))


def _first_faces(binding: object, position: FloatArray) -> list[int]:
    """Face ids that a ray from each sample of one feature piece meets first."""
    occluders = getattr(binding, "occluders", None)
    feature = np.asarray(getattr(binding, "feature_mm", np.zeros((0, 3))))
    if occluders is None or not len(feature):
        return []
    share = np.linspace(0.05, 0.95, _SAMPLES)[:, None]
    samples = [a + share * (b - a) for a, b in itertools.pairwise(feature)]
    points = np.concatenate([*samples, feature])
    away = position - points
    length = np.linalg.norm(away, axis=1, keepdims=True)
    gap = 2e-5 * float(occluders.extent_mm)
    start = points + gap * away / np.maximum(length, 1e-300)
    hit = occluders.rays.first_hit(start, np.broadcast_to(position, start.shape))
    return [int(occluders.face_ids[h]) for h in hit if h >= 0]
