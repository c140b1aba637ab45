"""What stands between a view and the features."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from mvp import visibility as sight
from mvp.constraints import Visibility

if TYPE_CHECKING:
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

FaceName: TypeAlias = Callable[[int], str]
"""How to call a face id of the occluding scene."""

_OWN = "the feature's own faces"


def blocking_faces(
    problem: PlanningProblem, view: Views, namer: FaceName
) -> tuple[str, ...]:
    """Faces that lie between a view and the features, most often first."""
    counts: dict[int, int] = {}
    for region in _regions(problem):
        for binding in region.bindings:
            found = sight.blocking_faces(
                binding.occluders, [binding.piece], view.position_mm[:1]
            )
            face = int(found[0])
            counts[face] = counts.get(face, 0) + 1
    return _named(sorted(counts, key=lambda face: -counts[face]), namer)


def limiting_faces(
    problem: PlanningProblem, view: Views, namer: FaceName
) -> tuple[str, ...]:
    """Faces that would hide a feature first if the view moved."""
    faces = [
        int(sight.limiting_faces(region, view.position_mm[:1])[0])
        for region in _regions(problem)
    ]
    return _named(faces, namer)


def _regions(problem: PlanningProblem) -> list[sight.Region]:
    regions = [c.region for c in problem.constraints if isinstance(c, Visibility)]
    return [region for region in regions if isinstance(region, sight.Region)]


def _named(faces: list[int], namer: FaceName) -> tuple[str, ...]:
    """Distinct names, in order; nothing in the way has none."""
    names = [
        _OWN if face == sight.OWN_FACES else namer(face)
        for face in faces
        if face != sight.NOTHING
    ]
    return tuple(dict.fromkeys(names))
