"""The lens can be set: d, f and a stay inside what motors and task allow."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from mvp.constraints.base import A, D, F, Kind, Report, Rows, worst_of
from mvp.constraints.derivatives import empty_gradient

if TYPE_CHECKING:
    from collections.abc import Iterable

    from mvp.geometry import FloatArray
    from mvp.optics import AxisName, LensTable, MotorAxis, Views

Quantity: TypeAlias = Literal["d", "d - f", "f", "a"]

_SLOPES: dict[Quantity, tuple[float, float, float]] = {
    "d": (1.0, 0.0, 0.0),
    "d - f": (1.0, -1.0, 0.0),
    "f": (0.0, 1.0, 0.0),
    "a": (0.0, 0.0, 1.0),
}
_QUANTITY_OF: dict[AxisName, Quantity] = {"zoom": "f", "focus": "d - f", "iris": "a"}
_EVERY_AXIS: tuple[AxisName, ...] = ("zoom", "focus", "iris")


@dataclass(frozen=True)
class LensBound:
    """One end of one range, mm."""

    quantity: Quantity
    end: Literal["min", "max"]
    limit_mm: float

    @property
    def sign(self) -> float:
        """+1 for a lower bound, -1 for an upper one."""
        return 1.0 if self.end == "min" else -1.0

    @property
    def label(self) -> str:
        """The bound in words."""
        relation = ">=" if self.end == "min" else "<="
        return f"{self.quantity} {relation} {self.limit_mm:.4g} mm"


@dataclass(frozen=True, eq=False)
class LensRange:
    """Rows in mm; reported in motor steps where a lens table is given.

    Attributes:
        bounds: one per row.
        table: converts margins into steps; without it the report is in mm.
    """

    bounds: tuple[LensBound, ...]
    table: LensTable | None = None
    kind: Kind = field(default="lens_range", init=False)
    unit: str = field(default="mm", init=False)
    labels: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        if not self.bounds:
            raise ValueError("a lens range needs at least one bound")
        object.__setattr__(self, "labels", tuple(b.label for b in self.bounds))

    @classmethod
    def within(
        cls,
        *,
        table: LensTable | None = None,
        axes: Iterable[AxisName] = _EVERY_AXIS,
        d_mm: tuple[float, float] | None = None,
        f_mm: tuple[float, float] | None = None,
        a_mm: tuple[float, float] | None = None,
    ) -> LensRange:
        """The ranges of a lens (with its tube) and of the task together.

        Args:
            table: the lens; its focus range bounds d - f.
            axes: which of its motors count. Leave out those that the task fixes: a
                value fixed at the end of its range has no margin and needs none.
            d_mm: the task's own range of d, and likewise of f and a.
            f_mm: see ``d_mm``.
            a_mm: see ``d_mm``.
        """
        bounds: list[LensBound] = []
        if table is not None:
            ranges = {
                "zoom": table.f_range_mm,
                "focus": table.extension_range_mm,
                "iris": table.a_range_mm,
            }
            for axis in axes:
                bounds += _both_ends(_QUANTITY_OF[axis], ranges[axis])
        bounds += _both_ends("d", d_mm) + _both_ends("f", f_mm) + _both_ends("a", a_mm)
        return cls(tuple(bounds), table)

    def rows(self, views: Views, *, gradient: bool = True) -> Rows:
        """Distance from every bound, (N, R) mm; linear, no kink."""
        sign = np.array([b.sign for b in self.bounds])
        limit = np.array([b.limit_mm for b in self.bounds])
        slope = np.array([_SLOPES[b.quantity] for b in self.bounds]) * sign[:, None]
        lens = np.stack([views.d_mm, views.f_mm, views.a_mm], axis=1)
        value = lens @ slope.T - sign * limit
        if not gradient:
            return Rows(value, None)
        slopes = empty_gradient(value.shape)
        slopes[..., [D, F, A]] = slope
        return Rows(value, slopes)

    def report(self, views: Views) -> Report:
        """Motor steps (or mm) left before the nearest bound."""
        if self.table is None:
            value = self.rows(views, gradient=False).value
            return worst_of("mm", value, self.labels)
        left = _steps_left(self.bounds, views, self.table)
        return worst_of("steps", left, self.labels)


def _steps_left(
    bounds: tuple[LensBound, ...], views: Views, table: LensTable
) -> FloatArray:
    """(N, R) steps from the views' settings to every bound, positive inside.

    All questions about one motor are asked at once.
    """
    asked = [_motor(bound, views, table) for bound in bounds]
    left = np.empty((len(views), len(bounds)))
    for axis in (table.zoom, table.focus, table.iris):
        own = [k for k, (its, *_) in enumerate(asked) if its is axis]
        if not own:
            continue
        pairs = np.stack([np.broadcast_arrays(*asked[k][1:]) for k in own])
        at, end = np.moveaxis(axis.fractional_steps(pairs), 1, 0)
        sign = np.array([bounds[k].sign for k in own])[:, None]
        left[:, own] = (sign * axis.sense * (at - end)).T
    return left


def _motor(
    bound: LensBound, views: Views, table: LensTable
) -> tuple[MotorAxis, FloatArray, FloatArray]:
    """Whose bound it is, and in that motor's mm the views' values and the limit."""
    if bound.quantity == "f":
        return table.zoom, views.f_mm, np.array(bound.limit_mm)
    if bound.quantity == "a":
        return table.iris, views.a_mm, np.array(bound.limit_mm)
    base = views.f_mm + table.tube_mm
    if bound.quantity == "d":
        return table.focus, views.d_mm - base, bound.limit_mm - base
    return table.focus, views.d_mm - base, np.array(bound.limit_mm - table.tube_mm)


def _both_ends(quantity: Quantity, ends: tuple[float, float] | None) -> list[LensBound]:
    if ends is None:
        return []
    return [LensBound(quantity, "min", ends[0]), LensBound(quantity, "max", ends[1])]
