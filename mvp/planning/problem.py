"""What is asked of the planner, as plain data. mm and rad, part frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mvp.constraints.sigma import ErrorModel, Uncertainty, worst_spread
from mvp.geometry import as_points
from mvp.optics import Views

if TYPE_CHECKING:
    from mvp.constraints.base import Constraint, Kind
    from mvp.geometry import BoolArray, Box, FloatArray

Accept: TypeAlias = Callable[[Views], "BoolArray"]
Progress: TypeAlias = Callable[[str, float], None]

DEFAULT_STARTS = 24
DEFAULT_CANDIDATES = 40_000


@dataclass(frozen=True)
class LensBounds:
    """Bounds of the lens setting, mm; equal ends fix a value.

    Attributes:
        f_mm: focal length. ``d_mm``: image distance. ``a_mm``: pupil diameter.
        e_mm: entrance pupil in front of the front nodal point.
    """

    f_mm: tuple[float, float]
    d_mm: tuple[float, float]
    a_mm: tuple[float, float]
    e_mm: float = 0.0

    def __post_init__(self) -> None:
        for name in ("f_mm", "d_mm", "a_mm"):
            low, high = getattr(self, name)
            if not (0 < low <= high < np.inf):
                raise ValueError(f"{name} needs 0 < low <= high, got {low}, {high}")
        if self.d_mm[1] <= self.f_mm[0]:
            raise ValueError("d must be able to exceed f, or nothing is in focus")

    @classmethod
    def of(
        cls,
        *,
        f_mm: float | tuple[float, float],
        d_mm: float | tuple[float, float],
        a_mm: float | tuple[float, float],
        e_mm: float = 0.0,
    ) -> LensBounds:
        """From fixed values or (low, high) pairs."""
        pairs = [
            (float(v), float(v)) if isinstance(v, int | float) else v
            for v in (f_mm, d_mm, a_mm)
        ]
        return cls(pairs[0], pairs[1], pairs[2], e_mm)

    @property
    def f_free(self) -> bool:
        """Whether f is planned."""
        return self.f_mm[1] > self.f_mm[0]

    @property
    def d_free(self) -> bool:
        """Whether d is planned."""
        return self.d_mm[1] > self.d_mm[0]

    @property
    def a_free(self) -> bool:
        """Whether a is planned."""
        return self.a_mm[1] > self.a_mm[0]

    def clipped(self, views: Views) -> Views:
        """The same views with every lens value inside its bounds and d > f."""
        f = np.clip(views.f_mm, *self.f_mm)
        d = np.clip(views.d_mm, *self.d_mm)
        return replace(
            views,
            f_mm=f,
            d_mm=np.maximum(d, f * (1 + 1e-6)),
            a_mm=np.clip(views.a_mm, *self.a_mm),
            e_mm=np.full(len(views), self.e_mm),
        )


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """Everything the search needs, and nothing about where it came from.

    Attributes:
        constraints: what a view must satisfy; their rows are indexed in this order.
        key_points_mm: (k, 3) points that must be in focus and inside the picture.
        target_centre_mm: (3,) centre of the smallest sphere around them.
        target_radius_mm: its radius.
        lens: bounds of f, d, a and the pupil offset.
        workspace: part-frame box within which the pupil is searched; a narrower or
            turned workspace is a constraint of its own.
        roll_free: whether roll is planned (rectangular sensor).
        uncertainty: the cell's stated errors, which scale every margin.
        errors: the same from what was measured, where that is known; used instead.
        accept: further filter of views (reach, clearance), (N,) bool.
        starts: how many distinct starts are searched from.
        candidates: how many views are tried to find them.
        user_starts: starts that a person gave, searched as well.
        hard_kinds: kinds that must hold but whose margin is no index.
    """

    constraints: tuple[Constraint, ...]
    key_points_mm: FloatArray
    target_centre_mm: FloatArray
    target_radius_mm: float
    lens: LensBounds
    workspace: Box
    roll_free: bool = False
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    errors: ErrorModel | None = None
    accept: Accept | None = None
    starts: int = DEFAULT_STARTS
    candidates: int = DEFAULT_CANDIDATES
    user_starts: Views | None = None
    hard_kinds: frozenset[Kind] = frozenset({"lens_range"})

    def __post_init__(self) -> None:
        points = as_points(self.key_points_mm, name="key_points_mm").reshape(-1, 3)
        centre = as_points(self.target_centre_mm, name="target_centre_mm")
        object.__setattr__(self, "key_points_mm", points)
        object.__setattr__(self, "target_centre_mm", centre.reshape(3))
        if not self.constraints or not len(points):
            raise ValueError("a problem needs constraints and key points")
        if not 0 <= self.target_radius_mm < np.inf:
            raise ValueError("target_radius_mm must be finite and not negative")

    @cached_property
    def farthest_mm(self) -> float:
        """Distance from the target to the workspace's farthest corner, mm."""
        reach = self.workspace.corners() - self.target_centre_mm
        return float(np.linalg.norm(reach, axis=1).max())

    def uncertainty_at(self, view: Views) -> Uncertainty:
        """Independent errors at one view (N = 1), each as in its worst direction."""
        if self.errors is None:
            return self.uncertainty
        return worst_spread(self.errors.covariance(view)[0])

    def accepted(self, views: Views) -> BoolArray:
        """Which views pass the further filter, (N,)."""
        if self.accept is None:
            return np.ones(len(views), dtype=bool)
        return np.asarray(self.accept(views), dtype=bool)
