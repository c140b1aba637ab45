"""The probability that a view keeps each requirement, and all of them at once.

To first order every row of a requirement is a half-space of normal errors. The union of
the half-spaces that fail is measured by sampling them in turn, each as often as it is
probable, and counting every sample once for all half-spaces it lies in (Owen, Maximov
and Chertkov, 2019): exact for one row, unbiased for many, and as good for one failure in
a million as for one in ten. The share of drawn errors that break the true margins stands
beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr, ndtri

from mvp.planning.chance import drawn_errors, held_by_kind, root_of
from mvp.planning.rows import RowTable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mvp.constraints import Kind
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

_SAMPLES = 8_000
_UNMOVED = 1e-12
_LEAST_TAIL = 1e-300


@dataclass(frozen=True)
class Probabilities:
    """Of one view.

    Attributes:
        each: that a requirement holds, by kind.
        together: that all hold at once.
    """

    each: Mapping[Kind, float]
    together: float

    @property
    def weakest(self) -> Kind:
        """The requirement that is the most likely to fail."""
        return min(self.each, key=lambda kind: self.each[kind])


def linearised(
    problem: PlanningProblem,
    view: Views,
    rng: np.random.Generator,
    *,
    samples: int = _SAMPLES,
) -> Probabilities:
    """To first order in the errors of one view (N = 1)."""
    table = RowTable.of(problem)
    rows = table.evaluate(view)
    value, gradient = rows.value[0], rows.gradient[0]
    root = root_of(error_covariance(problem, view))

    def kept(which: BoolArray) -> float:
        lever = gradient[which] @ root
        return 1.0 - union_probability(value[which], lever, rng, samples=samples)

    kinds = [kind for kind in dict.fromkeys(table.kinds) if not _hard(problem, kind)]
    each = {kind: kept(table.mask(kind)) for kind in kinds}
    return Probabilities(each, kept(~table.hard))


def drawn(
    problem: PlanningProblem, view: Views, rng: np.random.Generator, draws: int
) -> Probabilities:
    """Shares of drawn errors with which the true margins hold."""
    errors = drawn_errors(problem, view, rng, draws)
    held = held_by_kind(problem, view, errors)
    together = np.logical_and.reduce(list(held.values()))
    return Probabilities(
        {kind: float(good.mean()) for kind, good in held.items()},
        float(together.mean()),
    )


def error_covariance(problem: PlanningProblem, view: Views) -> FloatArray:
    """Covariance (9, 9) of the error coordinates, as measured or else as stated."""
    if problem.errors is None:
        return np.asarray(np.diag(problem.uncertainty.sigma**2))
    return np.asarray(problem.errors.covariance(view)[0])


def union_probability(
    value: FloatArray,
    lever: FloatArray,
    rng: np.random.Generator,
    *,
    samples: int = _SAMPLES,
) -> float:
    """Probability that value + lever z < 0 in any row, z standard normal.

    Args:
        value: (R,) margins.
        lever: (R, k).
        rng: draws the samples.
        samples: how many.
    """
    size = np.linalg.norm(lever, axis=1)
    moved = size > _UNMOVED * np.maximum(np.abs(value), 1.0)
    if (value[~moved] < 0).any():
        return 1.0
    distance, normal = value[moved] / size[moved], lever[moved] / size[moved, None]
    tail = ndtr(-distance)
    likely = tail > _LEAST_TAIL
    distance, normal, tail = distance[likely], normal[likely], tail[likely]
    if not len(tail):
        return 0.0
    total = float(tail.sum())
    row = rng.choice(len(tail), size=samples, p=tail / total)
    z = rng.normal(size=(samples, normal.shape[1]))
    deep = ndtri(rng.uniform(size=samples) * tail[row])
    along = (z * normal[row]).sum(axis=1)
    z += (deep - along)[:, None] * normal[row]
    failed = distance + z @ normal.T < 0
    failed[np.arange(samples), row] = True
    estimate = total * float((1 / failed.sum(axis=1)).mean())
    return float(np.clip(estimate, tail.max(), min(total, 1.0)))


def _hard(problem: PlanningProblem, kind: Kind) -> bool:
    return kind in problem.hard_kinds
