"""Certified tolerance: how far everything may be off with every requirement kept.

Closed-form bounds (``bounds``) are scaled up until one is no longer proven. What is
returned was itself proven; nothing is sampled.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvp.constraints import (
    FieldOfViewCircle,
    FieldOfViewRectangle,
    FocusFar,
    FocusNear,
    Kind,
    Resolution,
    Visibility,
    Workspace,
)
from mvp.planning.bounds import (
    Boxes,
    circle,
    far_focus,
    near_focus,
    rectangle,
    resolution,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.constraints import Constraint, Uncertainty
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

MESH_PRECISION_MM = 1e-3
_BISECTIONS = 40
_DOUBLINGS = 24
_LANES = ("all", "position", "angle", "d")


@dataclass(frozen=True)
class ToleranceBox:
    """Proportions of what is certified: one unit of scale.

    Attributes:
        position_mm: radius of the ball the pupil lies in; a cube of half width h
            needs sqrt(3) h.
        angle_rad: largest rotation, about any axis.
        d_mm, f_mm, a_mm: half widths of the lens values.
    """

    position_mm: float
    angle_rad: float
    d_mm: float
    f_mm: float = 0.0
    a_mm: float = 0.0

    @classmethod
    def of(cls, uncertainty: Uncertainty) -> ToleranceBox:
        """One standard deviation of everything."""
        return cls(
            uncertainty.position_mm,
            uncertainty.angle_rad,
            uncertainty.d_mm,
            uncertainty.f_mm,
            uncertainty.a_mm,
        )


@dataclass(frozen=True)
class Certificate:
    """What was proven of one view.

    Attributes:
        scale: every constraint holds while everything is off by at most ``scale`` of
            the box at once.
        position_mm, angle_rad, d_mm, f_mm, a_mm: the box at that scale.
        position_alone_mm, angle_alone_rad, d_alone_mm: when only that one is off.
        binding: requirement whose bound stops the scale; None if nothing is proven.
        not_covered: requirements that have no closed-form bound.
        method: how it was found.
    """

    scale: float
    position_mm: float
    angle_rad: float
    d_mm: float
    f_mm: float
    a_mm: float
    position_alone_mm: float
    angle_alone_rad: float
    d_alone_mm: float
    binding: Kind | None
    not_covered: tuple[Kind, ...]
    method: Literal["certified"] = "certified"


def certify(
    problem: PlanningProblem,
    view: Views,
    *,
    box: ToleranceBox | None = None,
    mesh_precision_mm: float = MESH_PRECISION_MM,
) -> Certificate:
    """Largest proven scale of a box of errors around one view (N = 1).

    Args:
        problem: whose constraints must hold.
        view: the nominal view.
        box: proportions; by default one standard deviation of the errors at the view.
        mesh_precision_mm: taken off the distance to the visibility region's boundary.
    """
    box = box or ToleranceBox.of(problem.uncertainty_at(view))
    distances = _distances(problem, view, mesh_precision_mm)

    def margins(scale: FloatArray) -> dict[Kind, FloatArray]:
        return _margins(problem, view, _lanes(box, scale), distances)

    low = _largest(lambda scale: _proven(margins(scale)))
    stopped = margins(np.where(low > 0, low * (1 + 1e-6), 1e-9))
    failed = [kind for kind, margin in stopped.items() if margin[0] < 0]
    return Certificate(
        scale=float(low[0]),
        position_mm=float(low[0] * box.position_mm),
        angle_rad=float(low[0] * box.angle_rad),
        d_mm=float(low[0] * box.d_mm),
        f_mm=float(low[0] * box.f_mm),
        a_mm=float(low[0] * box.a_mm),
        position_alone_mm=float(low[1] * box.position_mm),
        angle_alone_rad=float(low[2] * box.angle_rad),
        d_alone_mm=float(low[3] * box.d_mm),
        binding=failed[0] if failed else None,
        not_covered=tuple(
            dict.fromkeys(c.kind for c in problem.constraints if not _covered(c))
        ),
    )


def proven(
    problem: PlanningProblem,
    view: Views,
    box: ToleranceBox,
    *,
    mesh_precision_mm: float = MESH_PRECISION_MM,
) -> bool:
    """Whether every constraint provably holds everywhere in one box."""
    boxes = Boxes(
        *(
            np.array([value])
            for value in (
                box.position_mm,
                box.angle_rad,
                box.d_mm,
                box.f_mm,
                box.a_mm,
            )
        )
    )
    distances = _distances(problem, view, mesh_precision_mm)
    return bool(_proven(_margins(problem, view, boxes, distances))[0])


def _lanes(box: ToleranceBox, scale: FloatArray) -> Boxes:
    """Everything at once, then position, angle and d each alone; scale (4,)."""

    def lane(value: float, *names: str) -> FloatArray:
        used = np.array([name in names for name in _LANES])
        return np.where(used, scale * value, 0.0)

    return Boxes(
        position_mm=lane(box.position_mm, "all", "position"),
        angle_rad=lane(box.angle_rad, "all", "angle"),
        d_mm=lane(box.d_mm, "all", "d"),
        f_mm=lane(box.f_mm, "all"),
        a_mm=lane(box.a_mm, "all"),
    )


def _largest(holds: Callable[[FloatArray], BoolArray]) -> FloatArray:
    """Largest proven scale of every lane, by doubling and bisection; 0 if none."""
    low = np.zeros(len(_LANES))
    high = np.ones(len(_LANES))
    growing = np.ones(len(_LANES), dtype=bool)
    for _ in range(_DOUBLINGS):
        growing &= holds(high)
        if not growing.any():
            break
        low = np.where(growing, high, low)
        high = np.where(growing, 2 * high, high)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        good = holds(middle)
        low, high = np.where(good, middle, low), np.where(good, high, middle)
    return low


def _proven(margins: dict[Kind, FloatArray]) -> BoolArray:
    kept = [value >= 0 for value in margins.values()]
    return np.asarray(np.logical_and.reduce(kept), dtype=bool)


def _distances(
    problem: PlanningProblem, view: Views, mesh_precision_mm: float
) -> dict[Kind, float]:
    """Distances that only the position changes, by at most its own size, mm."""
    found: dict[Kind, float] = {}
    for constraint in problem.constraints:
        if isinstance(constraint, Visibility):
            margin = float(constraint.margin(view)[0]) - mesh_precision_mm
        elif isinstance(constraint, Workspace):
            margin = float(constraint.rows(view, gradient=False).value.min())
        else:
            continue
        found[constraint.kind] = min(margin, found.get(constraint.kind, np.inf))
    return found


def _margins(
    problem: PlanningProblem, view: Views, boxes: Boxes, distances: dict[Kind, float]
) -> dict[Kind, FloatArray]:
    """Lower bound of every requirement's margin over every box, (B,)."""
    found = {kind: value - boxes.position_mm for kind, value in distances.items()}
    for constraint in problem.constraints:
        bound = _bound(constraint, view, boxes)
        if bound is not None:
            known = found.get(constraint.kind)
            found[constraint.kind] = (
                bound if known is None else np.minimum(bound, known)
            )
    return found


def _bound(constraint: Constraint, view: Views, boxes: Boxes) -> FloatArray | None:
    match constraint:
        case FocusNear():
            return near_focus(constraint, view, boxes)
        case FocusFar():
            return far_focus(constraint, view, boxes)
        case FieldOfViewCircle():
            return circle(constraint, view, boxes)
        case FieldOfViewRectangle():
            return rectangle(constraint, view, boxes)
        case Resolution():
            return resolution(constraint, view, boxes)
        case _:
            return None


def _covered(constraint: Constraint) -> bool:
    return isinstance(
        constraint,
        FocusNear
        | FocusFar
        | FieldOfViewCircle
        | FieldOfViewRectangle
        | Resolution
        | Visibility
        | Workspace,
    )
