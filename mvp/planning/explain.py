"""Why nothing is admissible, and the least that would change it.

The same search is asked three more questions: which rows and bounds hold the best
view back (duals), which single requirement could give way (the others hard), and
whether the lens range alone is the cause. Every cure is confirmed by planning with it.
The search is local, so "no help" means that none was found.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints import Visibility
from mvp.optics.thick_lens import focus_distance_mm
from mvp.planning.blockers import FaceName, blocking_faces, limiting_faces
from mvp.planning.cures import Cure, knob_cures, lens_cure
from mvp.planning.rows import RowTable
from mvp.visibility import Region

if TYPE_CHECKING:
    from mvp.optics import Views
    from mvp.planning.problem import LensBounds, PlanningProblem
    from mvp.planning.solution import Solution
    from mvp.planning.solve import Attempt

_MINOR_DUAL = 0.01


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
    splittable: bool = True,
) -> Explanation:
    """Explain an attempt that ended without an admissible view.

    Args:
        problem: what was asked.
        failed: what the search found.
        seed: for the repeated searches.
        name_face: how to call a face id of the occluding scene.
        splittable: whether several features are asked for, so that views may share
            them.

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
        return _seen_from_nowhere(problem, searched, namer, splittable=splittable)
    best = failed.solutions[0]
    conflicts = conflict_set(problem, best)
    cures, no_help = knob_cures(problem, failed, namer)
    lens = lens_cure(problem, seed)
    if lens is not None:
        cures = [lens, *cures]
    blockers = blocking_faces(problem, best.view, namer)
    if not blockers and any(c.name == "visibility" for c in conflicts):
        blockers = limiting_faces(problem, best.view, namer)
    return Explanation(
        reason=_reason(best, conflicts, lens is not None),
        nearest=best,
        conflicts=conflicts,
        cures=tuple(cures),
        no_help=tuple(no_help),
        fix=_fix(cures, splittable=splittable),
        searched=searched,
        blockers=blockers,
    )


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
            text = f"{table.labels[row]}: {margin.value:z.3g} {margin.unit}"
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
    names = _in_words([c.name for c in conflicts if not _is_bound(c)])
    bounds = "; ".join(c.text for c in conflicts if _is_bound(c))
    text = f"{names}: the best view misses by {-best.t:.1f} sigma"
    if bounds:
        text += f"; {bounds}"
    return text + ("; the lens range is the cause" if lens_is_cause else "")


def _in_words(kinds: list[str]) -> str:
    """Kinds of requirements that meet, as the start of a sentence."""
    words = [kind.replace("_", " ") for kind in kinds]
    if not words:
        return "no view is admissible"
    if len(words) == 1:
        return f"{words[0]} cannot be kept"
    return f"{', '.join(words[:-1])} and {words[-1]} cannot be kept together"


def _is_bound(conflict: Conflict) -> bool:
    return conflict.name.endswith(("_min", "_max"))


def _fix(cures: list[Cure], *, splittable: bool) -> str:
    if not cures:
        split = "split the features over two views, or " if splittable else ""
        return (
            f"no single change was found to help; {split}change part, fixture or lens"
        )
    return "; or ".join(cure.text for cure in cures)


def _seen_from_nowhere(
    problem: PlanningProblem, searched: str, namer: FaceName, *, splittable: bool
) -> Explanation:
    regions = [c.region for c in problem.constraints if isinstance(c, Visibility)]
    words = "; ".join(
        region.in_the_way(namer) for region in regions if isinstance(region, Region)
    )
    reason = "no place in the workspace sees the features whole"
    if problem.accept is not None:
        reason += " and can be reached"
    move = "give a larger workspace", "move what is in the way"
    options = [*move, "split the features over several views"] if splittable else move
    return Explanation(
        reason=f"{reason}: {words}" if words else reason,
        nearest=None,
        conflicts=(),
        cures=(),
        no_help=(),
        fix=f"{', '.join(options[:-1])} or {options[-1]}",
        searched=searched,
        blockers=(),
    )
