"""Last digits of the weighted sum: SLSQP on the same rows in a re-centred chart.

Linear steps crawl where fewer constraints are active than there are unknowns; a
quadratic model does not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.optics import Views
    from mvp.planning.step import LinearModel

_ROUNDS = 5
_ITERATIONS = 40
_RADIUS = np.array([1.0])
_DIFFERENCE = 1e-4
_GAIN = 1e-9


def polished(model: LinearModel, view: Views) -> Views:
    """A view with a larger merit and no larger violation, or the same view."""
    for _ in range(_ROUNDS):
        moved = _Local(model, view).best()
        before, after = (model.table.index(v) for v in (view, moved))
        gain = float((model.merit.value(after) - model.merit.value(before))[0])
        if gain < _GAIN:
            return view
        view = moved
    return view


class _Local:
    """Rows around one view as functions of u = y / shape; its facets are kept."""

    def __init__(self, model: LinearModel, centre: Views) -> None:
        self._model = model
        self._centre = centre
        self._linear = model.table.linearise(centre, model.chart)
        merit = model.merit
        self._grouped = np.flatnonzero(merit.groups >= 0)
        self._floored = np.flatnonzero(np.isfinite(merit.floors))
        self._groups = len(merit.caps)
        self._n = model.chart.n

    def _values(self, u: FloatArray) -> FloatArray:
        """Rows (N, R) and d (N, 1) at N coordinates (N, n), as (N, R + 1)."""
        chart, table = self._model.chart, self._model.table
        repeated = self._centre[np.zeros(len(u), dtype=np.int64)]
        views = chart.retract(repeated, u * chart.shape, clip=False)
        shift = views.position_mm - self._centre.position_mm
        facets = self._linear.index[0] + shift @ self._linear.shift_slope[0].T
        rows = np.where(table.curved, table.index(views), facets)
        return np.column_stack([rows, views.d_mm])

    def _slopes(self, u: FloatArray) -> FloatArray:
        """Derivative (R + 1, n) by central differences."""
        steps = _DIFFERENCE * np.eye(self._n)
        values = self._values(np.concatenate([u + steps, u - steps]))
        plus, minus = np.split(values, 2)
        return np.asarray((plus - minus).T / (2 * _DIFFERENCE))

    def _constraints(self, x: FloatArray) -> FloatArray:
        """Row - t of its group, row - floor, d within its bounds; all >= 0."""
        values = self._values(x[None, : self._n])[0]
        rows, d = values[:-1], values[-1]
        merit, lens = self._model.merit, self._model.chart.lens
        terms = rows[self._grouped] - x[self._n + merit.groups[self._grouped]]
        floors = (rows - merit.floors)[self._floored]
        return np.concatenate([terms, floors, [d - lens.d_mm[0], lens.d_mm[1] - d]])

    def _constraint_slopes(self, x: FloatArray) -> FloatArray:
        slopes = self._slopes(x[: self._n])
        groups = self._model.merit.groups[self._grouped]
        terms = -np.eye(self._groups)[groups]
        blocks = [
            slopes[self._grouped],
            slopes[self._floored],
            slopes[-1:],
            -slopes[-1:],
        ]
        left = np.concatenate(blocks)
        right = np.zeros((len(left), self._groups))
        right[: len(terms)] = terms
        return np.hstack([left, right])

    def best(self) -> Views:
        """Where SLSQP ends from the centre."""
        from scipy.optimize import minimize

        merit, chart = self._model.merit, self._model.chart
        start = np.zeros(self._n + self._groups)
        start[self._n :] = merit.group_values(self._linear.index)[0]
        low, high = (b[0] / chart.shape for b in chart.box(self._centre, _RADIUS))
        bounds = [*zip(low, high, strict=True), *[(None, None)] * self._groups]
        cost = np.concatenate([np.zeros(self._n), -np.ones(self._groups)])
        result = minimize(
            lambda x: float(cost @ x),
            start,
            jac=lambda x: cost,
            method="SLSQP",
            bounds=bounds,
            constraints=[
                {
                    "type": "ineq",
                    "fun": self._constraints,
                    "jac": self._constraint_slopes,
                }
            ],
            options={"maxiter": _ITERATIONS, "ftol": 1e-12},
        )
        y = np.clip(result.x[: self._n], low, high) * chart.shape
        return chart.retract(self._centre, y[None])
