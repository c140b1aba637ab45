"""The orbit chart: the coordinates in which the search moves a view.

y = (orbit of the rig about the target's centre C: 2 angles, 3 with roll; where C is
seen, as tangents: 2; log depth of C; log of focus distance over depth; log f; log a).
The margins are nearly separable along these motions, so a linear model of them holds
over long steps; in plain x, y, z the search crawls along a curved ridge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from mvp.constraints.base import N_COORDINATES, SHIFT, TURN, A, D, F

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import LensBounds, PlanningProblem

_ORBIT_RAD, _AIM, _DEPTH, _FOCUS, _FOCAL, _APERTURE = 0.06, 0.06, 0.15, 0.15, 0.05, 0.15
_DEPTH_FLOOR_MM = 1e-6


@dataclass(frozen=True, eq=False)
class Chart:
    """Local coordinates y (n,) of views around their current state (y = 0).

    Attributes:
        centre_mm: (3,) C, the target's centre in the part frame.
        lens: bounds; a fixed d, f or a has no coordinate.
        roll_free: whether the orbit turns about the viewing direction as well.
        nearest_mm: C never comes nearer to the pupil than this along the axis.
    """

    centre_mm: FloatArray
    lens: LensBounds
    roll_free: bool
    nearest_mm: float = 0.0

    @classmethod
    def of(cls, problem: PlanningProblem) -> Chart:
        """The chart of one problem."""
        return cls(
            problem.target_centre_mm,
            problem.lens,
            problem.roll_free,
            problem.target_radius_mm + problem.lens.f_mm[0],
        )

    @cached_property
    def n_orbit(self) -> int:
        """Number of orbit angles."""
        return 3 if self.roll_free else 2

    @cached_property
    def shape(self) -> FloatArray:
        """(n,) step per unit of trust radius: rad, tangents, logarithms."""
        orbit = [_ORBIT_RAD] * self.n_orbit
        lens = [
            size
            for size, free in (
                (_FOCUS, self.lens.d_free),
                (_FOCAL, self.lens.f_free),
                (_APERTURE, self.lens.a_free),
            )
            if free
        ]
        return np.array([*orbit, _AIM, _AIM, _DEPTH, *lens])

    @cached_property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.shape)

    def _split(self, y: FloatArray) -> tuple[FloatArray, ...]:
        """Orbit (N, 3), aim (N, 2), then depth, focus, focal, aperture (N,) each."""
        y = np.atleast_2d(y)
        k = self.n_orbit
        orbit = np.zeros((len(y), 3))
        orbit[:, :k] = y[:, :k]
        parts = [orbit, y[:, k : k + 2], y[:, k + 2]]
        column = k + 3
        for free in (self.lens.d_free, self.lens.f_free, self.lens.a_free):
            parts.append(y[:, column] if free else np.zeros(len(y)))
            column += int(free)
        return tuple(parts)

    def target_camera(self, views: Views) -> FloatArray:
        """The target's centre in camera coordinates, (N, 3) mm."""
        return views.camera_points(self.centre_mm[None])[:, 0]

    def retract(self, views: Views, y: FloatArray, *, clip: bool = True) -> Views:
        """Move each view (N) by its own y (N, n); lens values end inside their bounds.

        ``clip=False`` leaves them, for derivatives at a bound.
        """
        orbit, aim, depth, focus, focal, aperture = self._split(y)
        q = self.target_camera(views)
        z = np.maximum(q[:, 2], _DEPTH_FLOOR_MM)
        tangents = q[:, :2] / z[:, None] + aim
        q_new = (z * np.exp(depth))[:, None] * np.column_stack(
            [tangents, np.ones(len(z))]
        )
        rotation = views.rotation @ Rotation.from_rotvec(orbit).as_matrix()
        f = views.f_mm * np.exp(focal)
        moved = replace(
            views,
            rotation=rotation,
            position_mm=self.centre_mm - np.einsum("nij,nj->ni", rotation, q_new),
            d_mm=self._image_distance(views, f, depth + focus),
            f_mm=f,
            a_mm=views.a_mm * np.exp(aperture),
        )
        return self.lens.clipped(moved) if clip else moved

    def _image_distance(
        self, views: Views, f: FloatArray, log_ratio: FloatArray
    ) -> FloatArray:
        if not self.lens.d_free:
            return views.d_mm
        distance = views.focus_distance_mm * np.exp(log_ratio)
        distance = np.maximum(distance, f * (1 + 1e-6))
        return np.asarray(f * distance / (distance - f))

    def jacobian(self, views: Views) -> FloatArray:
        """Error coordinates by chart coordinates at y = 0, (N, 9, n)."""
        n_views = len(views)
        q = self.target_camera(views)
        jacobian = np.zeros((n_views, N_COORDINATES, self.n))
        for j in range(self.n_orbit):
            turned = _turned_about(j, q)
            jacobian[:, SHIFT, j] = -np.einsum("nij,nj->ni", views.rotation, turned)
            jacobian[:, TURN.start + j, j] = 1.0
        column = self.n_orbit
        for j in range(2):
            jacobian[:, SHIFT, column + j] = -q[:, 2:] * views.rotation[:, :, j]
        depth = column + 2
        jacobian[:, SHIFT, depth] = -np.einsum("nij,nj->ni", views.rotation, q)
        self._lens_columns(jacobian, views, depth)
        return jacobian

    def _lens_columns(self, jacobian: FloatArray, views: Views, depth: int) -> None:
        column = depth + 1
        if self.lens.d_free:
            slope = -(views.d_mm**2) / views.focus_distance_mm
            jacobian[:, D, depth] = slope
            jacobian[:, D, column] = slope
            column += 1
        if self.lens.f_free:
            jacobian[:, F, column] = views.f_mm
            if self.lens.d_free:
                jacobian[:, D, column] = views.d_mm**2 / views.f_mm
            column += 1
        if self.lens.a_free:
            jacobian[:, A, column] = views.a_mm

    def box(self, views: Views, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounds (N, n) of y: trust radius (N,), nearest depth, range of f and a."""
        high = radius[:, None] * self.shape
        low = -high
        depth = self.n_orbit + 2
        if self.nearest_mm > 0:
            z = np.maximum(self.target_camera(views)[:, 2], _DEPTH_FLOOR_MM)
            least = np.minimum(np.log(self.nearest_mm / z), 0.0)
            low[:, depth] = np.maximum(low[:, depth], least)
        column = depth + 1 + int(self.lens.d_free)
        for free, value, bounds in (
            (self.lens.f_free, views.f_mm, self.lens.f_mm),
            (self.lens.a_free, views.a_mm, self.lens.a_mm),
        ):
            if free:
                least = np.minimum(np.log(bounds[0] / value), 0.0)
                most = np.maximum(np.log(bounds[1] / value), 0.0)
                low[:, column] = np.maximum(low[:, column], least)
                high[:, column] = np.minimum(high[:, column], most)
                column += 1
        return low, high


def _turned_about(axis: int, q: FloatArray) -> FloatArray:
    """Cross product (N, 3) of a unit vector of the frame with points (N, 3)."""
    turned = np.zeros_like(q)
    after, last = (axis + 1) % 3, (axis + 2) % 3
    turned[:, after] = -q[:, last]
    turned[:, last] = q[:, after]
    return turned
