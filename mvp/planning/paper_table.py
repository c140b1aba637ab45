"""The paper's own constraint functions (1)-(6), (12) as rows of a search, weighted.

Every term of the weighted sum is a minimum of smooth rows: an edge's two end pieces,
every key point, every facet. Slopes are central differences of the vector formulas.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints import (
    FieldOfViewCircle,
    FocusFar,
    FocusNear,
    Resolution,
    Visibility,
    paper_forms,
)
from mvp.constraints.base import SHIFT
from mvp.planning.rows import Linearised

if TYPE_CHECKING:
    from mvp.constraints import Constraint, Kind
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.optics import Views
    from mvp.planning.chart import Chart
    from mvp.planning.problem import PlanningProblem

_DIFFERENCE = 1e-4
_FARTHEST_SHARE = 10.0


@dataclass(frozen=True)
class PaperWeights:
    """Weights of the sum (15); lengths in mm, forms (1)-(6).

    Attributes:
        resolution: of g1, per edge. ``near``: of g2a. ``far``: of g2b.
        field: of g3. ``visibility``: of g4; 0 leaves it out of the optimisation.
    """

    resolution: float
    near: float
    far: float
    field: float
    visibility: float

    def of(self, kind: Kind) -> float:
        """The weight of one requirement; 1 for those that the paper has not."""
        return {
            "resolution": self.resolution,
            "focus_near": self.near,
            "focus_far": self.far,
            "field_of_view": self.field,
            "visibility": self.visibility,
        }.get(kind, 1.0)


@dataclass(frozen=True, eq=False)
class PaperTable:
    """Weighted rows of the paper's forms; a weight of 0 still leaves the constraint.

    Attributes:
        constraints: whose geometry is used.
        weights: of the sum.
        cap_mm: D1 counts up to here, the farthest point of the workspace.
    """

    constraints: tuple[Constraint, ...]
    weights: PaperWeights
    cap_mm: float

    @classmethod
    def of(cls, problem: PlanningProblem, weights: PaperWeights) -> PaperTable:
        """The table of one problem."""
        soft = tuple(c for c in problem.constraints if c.kind not in problem.hard_kinds)
        return cls(soft, weights, problem.farthest_mm)

    @cached_property
    def kinds(self) -> tuple[Kind, ...]:
        """Requirement of each row, (R,)."""
        return tuple(
            c.kind for c in self.constraints for _ in range(len(self._terms(c)))
        )

    @cached_property
    def curved(self) -> BoolArray:
        """Rows that are no distance to a facet, (R,)."""
        return np.array([kind != "visibility" for kind in self.kinds])

    @cached_property
    def groups(self) -> IntArray:
        """Term of the sum that each row belongs to; -1 for none, (R,)."""
        groups: list[int] = []
        for c in self.constraints:
            terms = self._terms(c)
            used = self.weights.of(c.kind) > 0 and _in_paper(c)
            start = max(groups, default=-1) + 1
            groups += [start + t if used else -1 for t in terms]
        return np.array(groups)

    def _terms(self, constraint: Constraint) -> list[int]:
        """Term number of every row of one constraint."""
        rows = len(constraint.labels)
        match constraint:
            case Resolution():
                owners = [label.rsplit(",", 1)[0] for label in constraint.labels]
                order = list(dict.fromkeys(owners))
                return [order.index(owner) for owner in owners]
            case FocusFar():
                return [0] * (rows + len(constraint.points_mm))
            case FieldOfViewCircle():
                return [0]
            case _:
                return [0] * rows

    def index(self, views: Views) -> FloatArray:
        """Weighted values (N, R)."""
        columns = []
        for constraint in self.constraints:
            if isinstance(constraint, Visibility):
                margin = constraint.margin(views)[:, None]
                value = np.repeat(margin, len(constraint.labels), axis=1)
            else:
                value = self._values(constraint, views)
            columns.append(value * self._scale(constraint))
        return np.concatenate(columns, axis=1)

    def _scale(self, constraint: Constraint) -> float:
        return self.weights.of(constraint.kind) or 1.0

    def _values(self, constraint: Constraint, views: Views) -> FloatArray:
        """Rows (N, rows) in the paper's units."""
        r, nu = views.position_mm[:, None], views.direction[:, None]
        d, f, a, e = views.d_mm, views.f_mm, views.a_mm, views.e_mm
        f_cal = paper_forms.principal_distance(d, f, e)
        match constraint:
            case Resolution():
                w = constraint.required_px * constraint.diagonal_pitch_mm
                starts, ends = constraint.starts_mm, constraint.ends_mm
                return paper_forms.g1(r, nu, starts, ends, w, f_cal[:, None])
            case FocusNear():
                limit = paper_forms.near_limit(d, f, a, constraint.c_mm, e)
                limit = np.minimum(limit, _FARTHEST_SHARE * self.cap_mm)
                depth = _depth(constraint.points_mm, views)
                return np.asarray(depth - (limit - e)[:, None])
            case FocusFar():
                return self._far(constraint, views)
            case FieldOfViewCircle():
                alpha = paper_forms.field_of_view_angle(
                    2 * constraint.image_radius_mm, f_cal
                )
                centre, radius = constraint.centre_mm, constraint.radius_mm
                g3 = paper_forms.g3(
                    views.position_mm, views.direction, centre, radius, alpha
                )
                return np.asarray(g3[:, None])
            case _:
                return constraint.rows(views, gradient=False).value

    def _far(self, focus: FocusFar, views: Views) -> FloatArray:
        """D1 - z and the cap - z of every point: the smaller one is the capped g2b."""
        limit = paper_forms.far_limit(
            views.d_mm, views.f_mm, views.a_mm, focus.c_mm, views.e_mm
        )
        limit = np.minimum(limit, _FARTHEST_SHARE * self.cap_mm) - views.e_mm
        depth = _depth(focus.points_mm, views)
        return np.concatenate([limit[:, None] - depth, self.cap_mm - depth], axis=1)

    def linearise(self, views: Views, chart: Chart) -> Linearised:
        """Weighted values and slopes; facet rows exactly, the rest by differences."""
        value = self.index(views)
        jacobian = chart.jacobian(views)
        slope = self._differences(views, chart)
        shift_slope = np.zeros((*value.shape, 3))
        start = 0
        for constraint in self.constraints:
            part = slice(start, start + len(self._terms(constraint)))
            start = part.stop
            if isinstance(constraint, Visibility):
                rows = constraint.rows(views, gradient=True)
                if rows.gradient is None:
                    raise ValueError("visibility rows came without a gradient")
                scale = self._scale(constraint)
                value[:, part] = rows.value * scale
                shift_slope[:, part] = rows.gradient[..., SHIFT] * scale
                slope[:, part] = shift_slope[:, part] @ jacobian[:, SHIFT]
        return Linearised(value, slope, jacobian, shift_slope)

    def _differences(self, views: Views, chart: Chart) -> FloatArray:
        """(N, R, n); distances are left at 0."""
        step = _DIFFERENCE * chart.shape
        count = len(views)
        offsets = np.concatenate([np.diag(step), -np.diag(step)])
        repeated = views[np.tile(np.arange(count), len(offsets))]
        y = np.repeat(offsets, count, axis=0)
        displaced = chart.retract(repeated, y, clip=False)
        columns = [
            np.zeros((len(displaced), len(self._terms(c))))
            if isinstance(c, Visibility)
            else self._values(c, displaced) * self._scale(c)
            for c in self.constraints
        ]
        value = np.concatenate(columns, axis=1).reshape(2, chart.n, count, -1)
        slope = (value[0] - value[1]) / (2 * step[:, None, None])
        return np.asarray(np.moveaxis(slope, 0, 2))


def _depth(points: FloatArray, views: Views) -> FloatArray:
    offset = points - views.position_mm[:, None]
    return np.asarray((offset * views.direction[:, None]).sum(axis=-1))


def _in_paper(constraint: Constraint) -> bool:
    return isinstance(
        constraint, Resolution | FocusNear | FocusFar | FieldOfViewCircle | Visibility
    )
