"""The one shape that every constraint has: margins and gradients of a batch of views.

A row is one smooth function (one vertex, end piece, side or facet). The nine error
coordinates of a view, in this order: shift of the pupil dr in part axes (3, mm),
rotation vector w in camera axes (3, rad, R <- R exp([w]x)), d, f, a (mm each).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
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
