"""g2a, g2b: every key point is blurred less than c, eqs. (2)-(5) in blur form.

With b = a (m - f_cal / z) the signed blur on the sensor, near focus is c + b >= 0 and
far focus is c - b >= 0: the set of (2)-(5), smooth also at the hyperfocal setting. The
report gives the same margins as depths from the limits D2 - e and D1 - e.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints.base import A, D, F, Kind, Report, Rows, worst_of
from mvp.constraints.derivatives import (
    IN_FRONT_MM,
    add_depth_gradient,
    empty_gradient,
    replace_behind,
)
from mvp.optics.thick_lens import depth_limits_mm

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.optics import Views

_UNREACHABLE_MM = 1e6


@dataclass(frozen=True, eq=False)
class _Focus:
    """Rows in mm of blur on the sensor; reported in mm of depth.

    Attributes:
        points_mm: (R, 3) key points, part frame.
        c_mm: largest acceptable diameter of the circle of confusion.
        labels: one per point.
    """

    points_mm: FloatArray
    c_mm: float
    labels: tuple[str, ...] = ()
    unit: str = field(default="mm", init=False)

    def __post_init__(self) -> None:
        points = np.asarray(self.points_mm, np.float64).reshape(-1, 3)
        object.__setattr__(self, "points_mm", points)
        if self.c_mm <= 0:
            raise ValueError("the circle of confusion must be positive")
        if not self.labels:
            names = tuple(f"point {i + 1}" for i in range(len(points)))
            object.__setattr__(self, "labels", names)

    def _depth_limits_mm(self, views: Views) -> tuple[FloatArray, FloatArray]:
        """Nearest and farthest depth (N, 1) in focus, mm from the pupil."""
        near, far = depth_limits_mm(
            views.d_mm, views.f_mm, views.a_mm, self.c_mm, views.e_mm
        )
        return (near - views.e_mm)[:, None], (far - views.e_mm)[:, None]


@dataclass(frozen=True, eq=False)
class FocusNear(_Focus):
    """Not nearer than the near limit of focus."""

    kind: Kind = field(default="focus_near", init=False)

    def rows(self, views: Views, *, gradient: bool = True) -> Rows:
        """C + b, (N, R) mm of blur."""
        return _blur_rows(views, self.points_mm, self.c_mm, +1, gradient)

    def report(self, views: Views) -> Report:
        """Depth of the nearest point minus D2 - e, mm of depth."""
        limit, _ = self._depth_limits_mm(views)
        depth = views.camera_points(self.points_mm)[..., 2]
        return worst_of("mm", depth - np.minimum(limit, _UNREACHABLE_MM), self.labels)


@dataclass(frozen=True, eq=False)
class FocusFar(_Focus):
    """Not farther than the far limit of focus."""

    kind: Kind = field(default="focus_far", init=False)

    def rows(self, views: Views, *, gradient: bool = True) -> Rows:
        """C - b, (N, R) mm of blur."""
        return _blur_rows(views, self.points_mm, self.c_mm, -1, gradient)

    def report(self, views: Views) -> Report:
        """D1 - e minus the depth of the farthest point, mm; inf beyond hyperfocal."""
        _, limit = self._depth_limits_mm(views)
        depth = views.camera_points(self.points_mm)[..., 2]
        behind = np.minimum(depth, 0.0) - 1.0
        value = np.where(depth > IN_FRONT_MM, limit - depth, behind)
        return worst_of("mm", value, self.labels)


def _blur_rows(
    views: Views, points: FloatArray, c_mm: float, sign: int, gradient: bool
) -> Rows:
    """C + sign b with its gradient."""
    q = views.camera_points(points)
    behind = q[..., 2] <= IN_FRONT_MM
    z = np.where(behind, 1.0, q[..., 2])
    d, f, a = (v[:, None] for v in (views.d_mm, views.f_mm, views.a_mm))
    per_a = (d - f) / f - views.f_cal_mm[:, None] / z
    value = c_mm + sign * a * per_a
    slopes = _blur_gradient(views, q, z, sign * per_a, sign) if gradient else None
    replace_behind(value, slopes, views, q[..., 2], behind)
    return Rows(value, slopes)


def _blur_gradient(
    views: Views, q: FloatArray, z: FloatArray, by_a: FloatArray, sign: int
) -> FloatArray:
    """(N, R, 9) gradient of sign b."""
    d, f, e = (v[:, None] for v in (views.d_mm, views.f_mm, views.e_mm))
    slopes = empty_gradient(z.shape)
    a = sign * views.a_mm[:, None]
    add_depth_gradient(slopes, views, q, a * views.f_cal_mm[:, None] / z**2)
    slopes[..., D] = a * (1 / f - (1 - e / f) / z)
    slopes[..., F] = -a * (d / f**2 + e * d / (f**2 * z))
    slopes[..., A] = by_a
    return slopes
