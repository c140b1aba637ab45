"""A focal length for a group where the zoom changes more than that.

The planner takes pupil offset, principal point and the range of focus as they are at one
zoom; where f is free it must be known before these are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from mvp.cell.objectives import searched

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.plan_problem import ProblemFactory
    from mvp.planning import LensBounds
    from mvp.scene import Feature
    from mvp.visibility import Region

_STARTS, _CANDIDATES = 8, 8_000


def settled_zoom(
    factory: ProblemFactory,
    features: Sequence[Feature],
    region: Region,
    lens: LensBounds,
    tube_mm: float,
    seed: int,
) -> LensBounds:
    """The bounds with f as a first search finds it best, at a whole zoom step.

    Unchanged where f is not free, the zoom changes nothing else, or nothing is found.
    """
    if factory.table.by_zoom is None or not lens.f_free:
        return lens
    problem = replace(
        factory.problem(features, region, lens, tube_mm),
        starts=_STARTS,
        candidates=_CANDIDATES,
    )
    found = searched(problem, factory.task.config.planning.objective, seed)
    if not found.solutions:
        return lens
    f_mm = float(found.solutions[0].view.f_mm[0])
    return factory.lens_bounds(tube_mm, f_mm=f_mm) or lens
