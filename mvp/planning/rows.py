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
from mvp.constraints.base import SHIFT
from mvp.constraints.sigma import margin_deviation

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mvp.constraints.base import Constraint, Kind
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
    """

    constraints: tuple[Constraint, ...]
    sigma: FloatArray
    hard_kinds: frozenset[Kind]
    fixed_scales: Mapping[Kind, float] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: PlanningProblem) -> RowTable:
        """The table of one problem."""
        return cls(problem.constraints, problem.uncertainty.sigma, problem.hard_kinds)

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

    def evaluate(self, views: Views, *, curved_only: bool = False) -> Evaluated:
        """Margins, gradients and scales of N views."""
        values, gradients = [], []
        for constraint in self.constraints:
            if curved_only and constraint.kind in _CONSTANT_SCALE:
                continue
            rows = constraint.rows(views, gradient=True)
            if rows.gradient is None:
                raise ValueError(f"{constraint.kind} rows came without a gradient")
            values.append(rows.value)
            gradients.append(rows.gradient)
        if not values:
            empty = np.zeros((len(views), 0))
            return Evaluated(empty, empty[:, :, None], empty)
        value = np.concatenate(values, axis=1)
        gradient = np.concatenate(gradients, axis=1)
        hard = self.hard[self.curved] if curved_only else self.hard
        scale = margin_deviation(gradient, self.sigma)
        scale[:, hard] = 1.0
        for kind, fixed in self.fixed_scales.items():
            mask = self.mask(kind)
            scale[:, mask[self.curved] if curved_only else mask] = fixed
        return Evaluated(value, gradient, scale)

    def index(self, views: Views) -> FloatArray:
        """Indices (N, R); all rows of a visibility constraint have its smallest one.

        Much cheaper than ``evaluate`` and the same in every minimum: one distance to
        the boundary instead of one per facet.
        """
        curved = self.evaluate(views, curved_only=True).index
        index = np.empty((len(views), len(self.kinds)))
        index[:, self.curved] = curved
        start = 0
        for constraint in self.constraints:
            part = slice(start, start + len(constraint.labels))
            start = part.stop
            if constraint.kind in _CONSTANT_SCALE:
                index[:, part] = self._plain_index(constraint, views)
        return index

    def _plain_index(self, constraint: Constraint, views: Views) -> FloatArray:
        """Indices of rows whose scale does not move, (N, rows) or (N, 1)."""
        if isinstance(constraint, Visibility):
            fixed = self.fixed_scales.get(constraint.kind)
            scale = fixed or float(self.sigma[SHIFT].max())
            ratio = constraint.margin(views)[:, None] / scale
            return np.asarray(np.clip(ratio, -_INDEX_LIMIT, _INDEX_LIMIT))
        alone = replace(self, constraints=(constraint,))
        return np.asarray(alone.evaluate(views).index)

    def worst(self, index: FloatArray) -> FloatArray:
        """Smallest index (N,) over the rows that have one; -inf if a hard row fails."""
        soft = index[:, ~self.hard].min(axis=1)
        failed = (index[:, self.hard] < -_HARD_SLACK).any(axis=1)
        return np.asarray(np.where(failed, np.minimum(soft, -_INDEX_LIMIT), soft))

    def linearise(self, views: Views, chart: Chart) -> Linearised:
        """Indices and their slopes; 2 n displaced views give the scale's slope."""
        here = self.evaluate(views)
        jacobian = chart.jacobian(views)
        scale = np.maximum(here.scale, _SCALE_FLOOR)
        slope = np.einsum("nrk,nkj->nrj", here.gradient, jacobian) / scale[..., None]
        curved = self.curved & ~self.hard
        if curved.any():
            change = self._scale_slope(views, chart)
            relative = change / scale[:, self.curved, None]
            slope[:, self.curved] -= here.index[:, self.curved, None] * relative
        np.clip(slope, -_INDEX_LIMIT, _INDEX_LIMIT, out=slope)
        shift_slope = here.gradient[:, :, SHIFT] / scale[..., None]
        return Linearised(here.index, slope, jacobian, shift_slope)

    def _scale_slope(self, views: Views, chart: Chart) -> FloatArray:
        """Derivative of the curved rows' scale by y, (N, R_curved, n)."""
        step = _DIFFERENCE * chart.shape
        count = len(views)
        offsets = np.concatenate([np.diag(step), -np.diag(step)])
        repeated = views.repeated(len(offsets))
        y = np.repeat(offsets, count, axis=0)
        displaced = chart.retract(repeated, y, clip=False)
        scales = self.evaluate(displaced, curved_only=True).scale
        plus, minus = scales.reshape(2, chart.n, count, -1)
        slope = (plus - minus) / (2 * step[:, None, None])
        return np.asarray(np.moveaxis(slope, 0, 2))
