"""What stands between a view and the features."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mvp.constraints import Visibility

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

FaceName: TypeAlias = Callable[[int], str]
"""How to call a face id of the occluding scene."""

_SAMPLES = 5


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
