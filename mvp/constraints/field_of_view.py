"""g3: everything of interest falls on the sensor, eqs. (6), (10) in distance form.

Round image: distance of the features' sphere from the wall of the viewing cone.
Rectangular image: distance of every key point from every side of the viewing pyramid.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints.base import Kind, Report, Rows, worst_of
from mvp.constraints.derivatives import (
    add_pose_gradient,
    add_principal_distance_gradient,
    empty_gradient,
)
from mvp.geometry import FloatArray, as_points

if TYPE_CHECKING:
    from mvp.optics import Intrinsics, Views

_FIXED_DIRECTIONS = 8
_ANGLES_RAD = 2 * np.pi * np.arange(_FIXED_DIRECTIONS) / _FIXED_DIRECTIONS
_FIXED = np.stack([np.cos(_ANGLES_RAD), np.sin(_ANGLES_RAD)], axis=1)
_BORDER_SAMPLES = 65
_SIDES = ("left", "right", "top", "bottom")
_SIDE_AXIS = np.array([0, 0, 1, 1])
_SIDE_SIGN = np.array([1.0, -1.0, 1.0, -1.0])


def half_extents_mm(
    intrinsics: Intrinsics, *, guard_px: float = 0.0, f_cal_mm: float | None = None
) -> FloatArray:
    """From the principal point to the outermost pixel centres, (4,) mm.

    Args:
        intrinsics: sensor, principal point and distortion.
        guard_px: a band along every border that must stay free.
        f_cal_mm: principal distance at which distortion is allowed for; the smallest
            one in question is the safe choice. None: distortion is left out.

    Returns:
        left, right, top, bottom of the largest such rectangle whose undistorted points
        all fall on the sensor; negative where the guard band reaches the centre.
    """
    sensor = intrinsics.sensor
    pitch = np.repeat([sensor.pitch_x_mm, sensor.pitch_y_mm], 2)
    x, y = intrinsics.centre_x_px, intrinsics.centre_y_px
    reach = np.array([x, sensor.width_px - 1 - x, y, sensor.height_px - 1 - y])
    plain = (reach - guard_px) * pitch
    if f_cal_mm is None or not intrinsics.distortion.any():
        return np.asarray(plain)
    share = np.linspace(0, 1, _BORDER_SAMPLES)
    columns, rows = share * (sensor.width_px - 1), share * (sensor.height_px - 1)
    sides = (
        np.stack([np.full_like(rows, guard_px), rows], axis=1),
        np.stack([np.full_like(rows, sensor.width_px - 1 - guard_px), rows], axis=1),
        np.stack([columns, np.full_like(columns, guard_px)], axis=1),
        np.stack([columns, np.full_like(columns, sensor.height_px - 1 - guard_px)], 1),
    )
    ideal = intrinsics.to_normalised(np.stack(sides), f_cal_mm) * f_cal_mm
    across = ideal[range(4), :, _SIDE_AXIS] * -_SIDE_SIGN[:, None]
    return np.asarray(across.min(axis=1))


@dataclass(frozen=True, eq=False)
class FieldOfViewCircle:
    """Rows in mm: the sphere around the features stays inside the viewing cone.

    The first row points from the optical axis to the sphere's centre and has a kink
    where the centre is on the axis; eight fixed directions, each smooth, carry the
    gradient there and never exceed it, so the least row is exact.

    Attributes:
        centre_mm: (3,) of the sphere, part frame.
        radius_mm: of the sphere.
        image_radius_mm: I_min / 2.
    """

    centre_mm: FloatArray
    radius_mm: float
    image_radius_mm: float
    kind: Kind = field(default="field_of_view", init=False)
    unit: str = field(default="mm", init=False)
    labels: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre_mm", as_points(self.centre_mm).reshape(3))
        if self.radius_mm < 0 or self.image_radius_mm <= 0:
            raise ValueError("a circular image and a sphere need positive radii")
        fixed = tuple(
            f"image circle at {360 * j // _FIXED_DIRECTIONS} deg"
            for j in range(_FIXED_DIRECTIONS)
        )
        object.__setattr__(self, "labels", ("image circle", *fixed))

    @classmethod
    def for_sensor(
        cls,
        centre_mm: FloatArray,
        radius_mm: float,
        intrinsics: Intrinsics,
        *,
        guard_px: float = 0.0,
        f_cal_mm: float | None = None,
    ) -> FieldOfViewCircle:
        """The largest circle about the principal point that fits on the sensor."""
        extents = half_extents_mm(intrinsics, guard_px=guard_px, f_cal_mm=f_cal_mm)
        return cls(centre_mm, radius_mm, float(extents.min()))

    def rows(self, views: Views, *, gradient: bool = True) -> Rows:
        """Z sin h - (t . (X, Y)) cos h - R_f for nine directions t, (N, 9) mm."""
        q = views.camera_points(self.centre_mm[None])
        half = np.arctan2(self.image_radius_mm, views.f_cal_mm)[:, None]
        directions = _directions(q[:, 0, :2])
        off_axis = np.matmul(directions, q[:, 0, :2, None])[..., 0]
        sin, cos = np.sin(half), np.cos(half)
        value = q[..., 2] * sin - off_axis * cos - self.radius_mm
        if not gradient:
            return Rows(value, None)
        slopes = empty_gradient(value.shape)
        by_q = np.empty((*value.shape, 3))
        by_q[..., :2] = -directions * cos[..., None]
        by_q[..., 2] = sin
        add_pose_gradient(slopes, views, q, by_q)
        square = self.image_radius_mm**2 + views.f_cal_mm[:, None] ** 2
        by_f_cal = -(q[..., 2] * cos + off_axis * sin) * self.image_radius_mm / square
        add_principal_distance_gradient(slopes, views, by_f_cal)
        return Rows(value, slopes)

    def report(self, views: Views) -> Report:
        """Angle by which the camera may turn before the sphere is cut, deg."""
        q = views.camera_points(self.centre_mm[None])[:, 0]
        half = np.arctan2(self.image_radius_mm, views.f_cal_mm)
        distance = np.linalg.norm(q, axis=1)
        safe = np.maximum(distance, max(self.radius_mm, np.finfo(float).tiny))
        off_axis = np.arctan2(np.hypot(q[:, 0], q[:, 1]), q[:, 2])
        slack = np.rad2deg(half - off_axis - np.arcsin(self.radius_mm / safe))
        return worst_of("deg", slack[:, None], self.labels[:1])


@dataclass(frozen=True, eq=False)
class FieldOfViewRectangle:
    """Rows in mm: every point stays inside every side of the viewing pyramid.

    Attributes:
        points_mm: (k, 3) key points, part frame.
        extents_mm: (4,) left, right, top, bottom of the principal point on the sensor.
        names: one per point.
    """

    points_mm: FloatArray
    extents_mm: FloatArray
    names: tuple[str, ...] = ()
    kind: Kind = field(default="field_of_view", init=False)
    unit: str = field(default="mm", init=False)
    labels: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        points = as_points(self.points_mm).reshape(-1, 3)
        extents = np.array(self.extents_mm, np.float64).reshape(4)
        names = self.names or tuple(f"point {i + 1}" for i in range(len(points)))
        if len(names) != len(points):
            raise ValueError("names needs one entry per point")
        object.__setattr__(self, "points_mm", points)
        object.__setattr__(self, "extents_mm", extents)
        object.__setattr__(self, "names", names)
        labels = tuple(f"{name}, {side}" for name in names for side in _SIDES)
        object.__setattr__(self, "labels", labels)

    @classmethod
    def for_sensor(
        cls,
        points_mm: FloatArray,
        intrinsics: Intrinsics,
        *,
        guard_px: float = 0.0,
        f_cal_mm: float | None = None,
        names: tuple[str, ...] = (),
    ) -> FieldOfViewRectangle:
        """The whole sensor less a guard band, see ``half_extents_mm``."""
        extents = half_extents_mm(intrinsics, guard_px=guard_px, f_cal_mm=f_cal_mm)
        return cls(points_mm, extents, names)

    def rows(self, views: Views, *, gradient: bool = True) -> Rows:
        """(i z -+ f_cal X) / sqrt(i^2 + f_cal^2), sides within points, (N, 4 k) mm."""
        q = views.camera_points(self.points_mm)
        f_cal = views.f_cal_mm[:, None, None]
        extents = self.extents_mm
        root = np.sqrt(extents**2 + f_cal**2)
        across = q[..., _SIDE_AXIS] * _SIDE_SIGN
        value = (extents * q[..., 2:] + f_cal * across) / root
        flat = value.reshape(len(views), -1)
        if not gradient:
            return Rows(flat, None)
        slopes = empty_gradient(flat.shape)
        by_q = np.zeros((*value.shape, 3))
        by_q[..., 2] = extents / root
        by_q[:, :, range(4), _SIDE_AXIS] = _SIDE_SIGN * f_cal / root
        spread = np.broadcast_to(q[:, :, None, :], by_q.shape).reshape(*flat.shape, 3)
        add_pose_gradient(slopes, views, spread, by_q.reshape(*flat.shape, 3))
        by_f_cal = (across / root - value * f_cal / root**2).reshape(flat.shape)
        add_principal_distance_gradient(slopes, views, by_f_cal)
        return Rows(flat, slopes)

    def report(self, views: Views) -> Report:
        """Smallest angle between a point's ray and a side of the pyramid, deg."""
        q = views.camera_points(self.points_mm)
        distance = np.repeat(np.linalg.norm(q, axis=-1), 4, axis=1)
        value = self.rows(views, gradient=False).value
        safe = np.where(distance > 0, distance, 1.0)
        angle = np.arcsin(np.clip(value / safe, -1.0, 1.0))
        return worst_of("deg", np.rad2deg(angle), self.labels)


def _directions(off_axis: FloatArray) -> FloatArray:
    """The true direction (0 on the axis) and the fixed ones, (N, 9, 2)."""
    rho = np.sqrt((off_axis**2).sum(axis=1, keepdims=True))
    directions = np.empty((len(off_axis), 1 + _FIXED_DIRECTIONS, 2))
    directions[:, 0] = off_axis / np.where(rho > 0, rho, 1.0)
    directions[:, 1:] = _FIXED
    return directions
