"""A person's starts: used as given where possible, repaired and named where not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints import Visibility
from mvp.planning.candidates import (
    Screened,
    focused,
    in_region,
    looking_at,
)

if TYPE_CHECKING:
    from mvp.constraints import Kind
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

_BEST = 100


@dataclass(frozen=True, eq=False)
class Start:
    """One view to search from, where it comes from and what was repaired."""

    view: Views
    name: str
    notes: tuple[str, ...] = ()


def user_starts(problem: PlanningProblem, screened: Screened) -> list[Start]:
    """Every start a person gave, repaired in this order: place, aim, focus."""
    given = problem.user_starts
    if given is None:
        return []
    return [
        repaired(problem, given[i], f"start {i + 1}", screened)
        for i in range(len(given))
    ]


def repaired(
    problem: PlanningProblem, view: Views, name: str, screened: Screened
) -> Start:
    """One start, with a note for every repair."""
    notes: list[str] = []
    view = problem.lens.clipped(view)
    outside = _place(problem, view)
    if outside and len(screened.views):
        view = _nearest(view, screened)
        place = ", ".join(f"{v:.1f}" for v in view.position_mm[0])
        notes.append(
            f"{name} {outside}; replaced by the nearest of the best candidates, "
            f"at ({place}) mm"
        )
        return Start(view, name, tuple(notes))
    if _behind(problem, view) or _violated(problem, view, ("field_of_view",)):
        rotation = looking_at(problem.target_centre_mm, view.position_mm)
        view = replace(view, rotation=rotation)
        notes.append(f"{name} had the features outside its picture; aimed at them")
    if problem.lens.d_free and _violated(problem, view, ("focus_near", "focus_far")):
        view = focused(problem, view)
        notes.append(f"{name} was out of focus; d set to {view.d_mm[0]:.3f} mm")
    return Start(view, name, tuple(notes))


def _place(problem: PlanningProblem, view: Views) -> str:
    """What is wrong with the pupil's place; empty if nothing."""
    if not problem.workspace.contains(view.position_mm)[0]:
        return "lies outside the workspace"
    for constraint in problem.constraints:
        if not isinstance(constraint, Visibility):
            continue
        if not in_region(constraint, view.position_mm)[0]:
            depth = -float(constraint.margin(view)[0])
            return f"lies {depth:.1f} mm outside the visibility region"
    return ""


def _nearest(view: Views, screened: Screened) -> Views:
    best = screened.views[: min(_BEST, len(screened.views))]
    gap = np.linalg.norm(best.position_mm - view.position_mm, axis=1)
    return best[int(np.argmin(gap))]


def _behind(problem: PlanningProblem, view: Views) -> bool:
    depth = view.camera_points(problem.target_centre_mm[None])[0, 0, 2]
    return bool(depth <= problem.target_radius_mm)


def _violated(problem: PlanningProblem, view: Views, kinds: tuple[Kind, ...]) -> bool:
    return any(
        float(c.rows(view, gradient=False).value.min()) < 0
        for c in problem.constraints
        if c.kind in kinds
    )
