"""The one shape that every constraint has: margins and gradients of a batch of views.

A row is one smooth function (one vertex, end piece, side or facet). The nine error
coordinates of a view, in this order: shift of the pupil dr in part axes (3, mm),
rotation vector w in camera axes (3, rad, R <- R exp([w]x)), d, f, a (mm each).
The pupil offset e is a constant of the view in every derivative.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.optics.views import Views

N_COORDINATES = 9
SHIFT = slice(0, 3)
TURN = slice(3, 6)
D, F, A = 6, 7, 8

Kind: TypeAlias = Literal[
    "resolution",
    "focus_near",
    "focus_far",
    "field_of_view",
    "visibility",
    "workspace",
    "lens_range",
    "reach",
    "clearance",
]


@dataclass(frozen=True, eq=False)
class Rows:
    """Margins of N views in R rows; >= 0 is satisfied.

    Attributes:
        value: (N, R), in the constraint's own unit, always finite.
        gradient: (N, R, 9) with respect to the error coordinates, or None if not asked.
    """

    value: FloatArray
    gradient: FloatArray | None


@dataclass(frozen=True, eq=False)
class Report:
    """The worst margin of each of N views, in the unit a plan promises.

    Attributes:
        unit: px, mm, deg or steps.
        value: (N,); inf where ``unbounded``, finite elsewhere.
        unbounded: (N,) no limit exists (far focus beyond the hyperfocal setting).
        worst_row: (N,) index into ``labels``.
        labels: what each row is about.
    """

    unit: str
    value: FloatArray
    unbounded: BoolArray
    worst_row: IntArray
    labels: tuple[str, ...]

    def label(self, index: int = 0) -> str:
        """What the worst row of one view is about."""
        return self.labels[int(self.worst_row[index])]


class Constraint(Protocol):
    """One file, one constraint."""

    @property
    def kind(self) -> Kind:
        """Which requirement of the plan it belongs to."""
        ...

    @property
    def unit(self) -> str:
        """Unit of the row values."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """What each row is about, in the user's words (feature, end, side)."""
        ...

    def rows(self, views: Views, *, gradient: bool = True) -> Rows:
        """Evaluate every row at every view."""
        ...


@runtime_checkable
class Reporting(Protocol):
    """A constraint whose plan margin is not simply its worst row."""

    def report(self, views: Views) -> Report:
        """The worst margin of every view in the plan's unit."""
        ...


def worst_of(
    unit: str,
    value: FloatArray,
    labels: tuple[str, ...],
    *,
    unbounded: BoolArray | None = None,
) -> Report:
    """The worst of margins (N, R) per view; rows of R may be infinite.

    Args:
        unit: unit of ``value``.
        value: (N, R) margins, inf where a row has no limit.
        labels: R texts.
        unbounded: (N,) or None: where the worst row is infinite.

    Returns:
        The worst rows; unbounded where there are no rows at all.
    """
    if value.shape[1] == 0:
        nothing = np.full((len(value), 1), np.inf)
        return worst_of(unit, nothing, ("nothing asked",))
    worst = np.argmin(value, axis=1)
    least = np.take_along_axis(value, worst[:, None], axis=1)[:, 0]
    free = np.isposinf(least) if unbounded is None else unbounded
    return Report(unit, least, free, worst.astype(np.int64), labels)


def margin_report(constraint: Constraint, views: Views) -> Report:
    """The worst margin per view of any constraint, by its own report if it has one."""
    if isinstance(constraint, Reporting):
        return constraint.report(views)
    rows = constraint.rows(views, gradient=False)
    return worst_of(constraint.unit, rows.value, constraint.labels)
