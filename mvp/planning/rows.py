"""All constraints of a problem as one table of rows, in standard deviations.

The index of a row is margin / standard deviation of that margin under the cell's
errors (first order). Rows of hard kinds keep their own unit; they only must not be
negative.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints import Visibility
from mvp.constraints.base import N_COORDINATES, SHIFT
from mvp.constraints.sigma import (
    correlated_deviation,
    margin_deviation,
    worst_deviation,
)
from mvp.optics.views import concatenated

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mvp.constraints.base import Constraint, Kind
    from mvp.constraints.sigma import ErrorModel
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Views
    from mvp.planning.chart import Chart
    from mvp.planning.problem import PlanningProblem

# Distances: their gradient is a unit vector, so the scale does not move with the view.
_CONSTANT_SCALE: frozenset[Kind] = frozenset(
    {"visibility", "workspace", "lens_range", "reach", "clearance"}
)
_INDEX_LIMIT = 1e6
_SCALE_FLOOR = 1e-9
_DIFFERENCE = 1e-3
_HARD_SLACK = 1e-6


@dataclass(frozen=True, eq=False)
class Evaluated:
    """Rows of N views.

    Attributes:
        value: (N, R) margins in their own units.
        gradient: (N, R, 9) by the error coordinates.
        scale: (N, R) standard deviation of each margin; 1 for hard rows.
    """

    value: FloatArray
    gradient: FloatArray
    scale: FloatArray

    @property
    def index(self) -> FloatArray:
        """(N, R) margin over standard deviation, kept finite."""
        ratio = self.value / np.maximum(self.scale, _SCALE_FLOOR)
        return np.asarray(np.clip(ratio, -_INDEX_LIMIT, _INDEX_LIMIT))


@dataclass(frozen=True, eq=False)
class Linearised:
    """First-order model of the indices of N views in chart coordinates.

    Attributes:
        index: (N, R).
        slope: (N, R, n) derivative of the index by y.
        jacobian: (N, 9, n) error coordinates by y.
        shift_slope: (N, R, 3) derivative of the index by the pupil's shift at a
            fixed scale: what corrects the distance rows for a curved step.
    """

    index: FloatArray
    slope: FloatArray
    jacobian: FloatArray
    shift_slope: FloatArray

    def of(self, which: int) -> Linearised:
        """The model of one view, kept as N = 1."""
        keep = slice(which, which + 1)
        return Linearised(
            self.index[keep],
            self.slope[keep],
            self.jacobian[keep],
            self.shift_slope[keep],
        )


@dataclass(frozen=True, eq=False)
class RowTable:
    """Evaluates every constraint of a problem in one go.

    Attributes:
        constraints: whose rows follow each other.
        sigma: (9,) standard deviations of the error coordinates.
        hard_kinds: kinds that must hold but have no index.
        fixed_scales: kinds that are measured against a fixed scale, in their own unit,
            instead of their standard deviation.
        errors: used instead of ``sigma`` where given. Distances are then measured
            against the worst direction of a shift, whichever way the facet lies.
    """

    constraints: tuple[Constraint, ...]
    sigma: FloatArray
    hard_kinds: frozenset[Kind]
    fixed_scales: Mapping[Kind, float] = field(default_factory=dict)
    errors: ErrorModel | None = None

    @classmethod
    def of(cls, problem: PlanningProblem) -> RowTable:
        """The table of one problem."""
        return cls(
            problem.constraints,
            problem.uncertainty.sigma,
            problem.hard_kinds,
            errors=problem.errors,
        )

    @cached_property
    def kinds(self) -> tuple[Kind, ...]:
        """Requirement of each row, (R,)."""
        return tuple(c.kind for c in self.constraints for _ in c.labels)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """What each row is about, (R,)."""
        return tuple(label for c in self.constraints for label in c.labels)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Unit of each row, (R,)."""
        return tuple(c.unit for c in self.constraints for _ in c.labels)

    @cached_property
    def hard(self) -> BoolArray:
        """Which rows only must not be negative, (R,)."""
        return np.array([kind in self.hard_kinds for kind in self.kinds])

    @cached_property
    def curved(self) -> BoolArray:
        """Rows whose scale moves with the view, (R,)."""
        return np.array([kind not in _CONSTANT_SCALE for kind in self.kinds])

    def mask(self, kind: Kind) -> BoolArray:
        """Rows of one requirement, (R,)."""
        return np.array([k == kind for k in self.kinds])

    @cached_property
    def _optical(self) -> RowTable:
        """The rows whose scale moves with the view, as a table of their own."""
        return self._of([c for c in self.constraints if c.kind not in _CONSTANT_SCALE])

    @cached_property
    def _distances(self) -> RowTable:
        """The other rows, as a table of their own."""
        return self._of([c for c in self.constraints if c.kind in _CONSTANT_SCALE])

    @cached_property
    def _single(self) -> tuple[RowTable, ...]:
        """One table per constraint."""
        return tuple(self._of([c]) for c in self.constraints)

    def _of(self, constraints: list[Constraint]) -> RowTable:
        return replace(self, constraints=tuple(constraints))

    def evaluate(self, views: Views) -> Evaluated:
        """Margins, gradients and scales of N views."""
        values, gradients = [], []
        for constraint in self.constraints:
            rows = constraint.rows(views, gradient=True)
            if rows.gradient is None:
                raise ValueError(f"{constraint.kind} rows came without a gradient")
            values.append(rows.value)
            gradients.append(rows.gradient)
        if not values:
            empty = np.zeros((len(views), 0))
            return Evaluated(empty, np.zeros((*empty.shape, N_COORDINATES)), empty)
        value = np.concatenate(values, axis=1)
        gradient = np.concatenate(gradients, axis=1)
        scale = self._deviation(views, gradient)
        scale[:, self.hard] = 1.0
        for kind, fixed in self.fixed_scales.items():
            scale[:, self.mask(kind)] = fixed
        return Evaluated(value, gradient, scale)

    def _deviation(self, views: Views, gradient: FloatArray) -> FloatArray:
        """Standard deviation (N, R) of rows with gradients (N, R, 9)."""
        if self.errors is None:
            return margin_deviation(gradient, self.sigma)
        covariance = self.errors.covariance(views)
        scale = correlated_deviation(gradient, covariance)
        if not self.curved.all():
            shift = worst_deviation(covariance[:, SHIFT, SHIFT])[:, None]
            slope = np.linalg.norm(gradient[:, ~self.curved, SHIFT], axis=-1)
            scale[:, ~self.curved] = shift * slope
        return scale

    def _shift_deviation(self, views: Views) -> FloatArray:
        """Of a shift in its worst direction, (N, 1) or (1, 1)."""
        if self.errors is None:
            return np.array([[self.sigma[SHIFT].max()]])
        covariance = self.errors.covariance(views)
        return worst_deviation(covariance[:, SHIFT, SHIFT])[:, None]

    def index(self, views: Views) -> FloatArray:
        """Indices (N, R); all rows of a visibility constraint have its smallest one.

        Much cheaper than ``evaluate`` and the same in every minimum: one distance to
        the boundary instead of one per facet.
        """
        return self.completed(views, self.curved_index(views))

    def curved_index(self, views: Views) -> FloatArray:
        """Indices of the rows that are no distance, (N, R_curved)."""
        return self._optical.evaluate(views).index

    def completed(self, views: Views, curved: FloatArray) -> FloatArray:
        """``index``, with those of the curved rows (N, R_curved) known."""
        index = np.empty((len(views), len(self.kinds)))
        index[:, self.curved] = curved
        start = 0
        for alone in self._single:
            part = slice(start, start + len(alone.kinds))
            start = part.stop
            if alone.constraints[0].kind in _CONSTANT_SCALE:
                index[:, part] = alone.plain_index(views)
        return index

    def plain_index(self, views: Views) -> FloatArray:
        """Indices of one distance constraint's rows, (N, rows) or (N, 1)."""
        constraint = self.constraints[0]
        if isinstance(constraint, Visibility):
            fixed = self.fixed_scales.get(constraint.kind)
            scale = fixed or self._shift_deviation(views)
            ratio = constraint.margin(views)[:, None] / scale
            return np.asarray(np.clip(ratio, -_INDEX_LIMIT, _INDEX_LIMIT))
        return self.evaluate(views).index

    def worst(self, index: FloatArray) -> FloatArray:
        """Smallest index (N,) over the rows that have one; -inf if a hard row fails."""
        soft = index[:, ~self.hard].min(axis=1)
        failed = (index[:, self.hard] < -_HARD_SLACK).any(axis=1)
        return np.asarray(np.where(failed, np.minimum(soft, -_INDEX_LIMIT), soft))

    def linearise(self, views: Views, chart: Chart) -> Linearised:
        """Indices and their slopes; 2 n displaced views give the scale's slope.

        They are evaluated together with the views themselves: for a few views a second
        call costs more than more views in the first.
        """
        count, rows = len(views), len(self._optical.kinds)
        step = _DIFFERENCE * chart.shape
        offsets = np.concatenate([np.diag(step), -np.diag(step)])
        around = chart.retract(
            views.repeated(len(offsets)), np.repeat(offsets, count, axis=0), clip=False
        )
        curved = self._optical.evaluate(concatenated([views, around]))
        here = self._with_distances(views, curved)
        jacobian = chart.jacobian(views)
        scale = np.maximum(here.scale, _SCALE_FLOOR)
        slope = np.einsum("nrk,nkj->nrj", here.gradient, jacobian) / scale[..., None]
        plus, minus = curved.scale[count:].reshape(2, chart.n, count, rows)
        change = np.moveaxis((plus - minus) / (2 * step[:, None, None]), 0, 2)
        relative = change / scale[:, self.curved, None]
        slope[:, self.curved] -= here.index[:, self.curved, None] * relative
        np.clip(slope, -_INDEX_LIMIT, _INDEX_LIMIT, out=slope)
        shift_slope = here.gradient[:, :, SHIFT] / scale[..., None]
        return Linearised(here.index, slope, jacobian, shift_slope)

    def _with_distances(self, views: Views, curved: Evaluated) -> Evaluated:
        """All rows of N views whose curved ones are the first N of ``curved``."""
        shape = (len(views), len(self.kinds))
        distances = self._distances.evaluate(views)
        value, scale = np.empty(shape), np.empty(shape)
        gradient = np.empty((*shape, N_COORDINATES))
        for mask, part in ((self.curved, curved), (~self.curved, distances)):
            value[:, mask] = part.value[: len(views)]
            scale[:, mask] = part.scale[: len(views)]
            gradient[:, mask] = part.gradient[: len(views)]
        return Evaluated(value, gradient, scale)
