"""Lower bounds of every margin over a whole box of errors, from monotonicity.

A box: pupil anywhere in a ball of radius p, rotation by at most th about any axis,
d, f and a anywhere in an interval. B boxes are bounded at once; a bound that is not
negative proves that the constraint holds everywhere in its box. mm and rad.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.optics.thick_lens import principal_distance_mm

if TYPE_CHECKING:
    from mvp.constraints import (
        FieldOfViewCircle,
        FieldOfViewRectangle,
        FocusFar,
        FocusNear,
        Resolution,
    )
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Views

_CELLS = 64
_REFUSED = -1.0


@dataclass(frozen=True, eq=False)
class Boxes:
    """B boxes of errors around one view; every array (B,).

    Attributes:
        position_mm: radius of the ball the pupil lies in.
        angle_rad: largest rotation, about any axis.
        d_mm: half width of d. ``f_mm``: of f. ``a_mm``: of a.
    """

    position_mm: FloatArray
    angle_rad: FloatArray
    d_mm: FloatArray
    f_mm: FloatArray
    a_mm: FloatArray

    def principal_distances_mm(self, view: Views) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest f_cal in each box, (B,)."""
        d, f, e = view.d_mm[0], view.f_mm[0], view.e_mm[0]
        slope = np.sign(e)
        low = principal_distance_mm(d - self.d_mm, f - slope * self.f_mm, e)
        high = principal_distance_mm(d + self.d_mm, f + slope * self.f_mm, e)
        return low, high


@dataclass(frozen=True, eq=False)
class _Points:
    """Points seen from the nominal view: distance (k,), angle to the axis (k,)."""

    distance_mm: FloatArray
    off_axis_rad: FloatArray

    @classmethod
    def of(cls, view: Views, points: FloatArray) -> _Points:
        q = view.camera_points(points.reshape(-1, 3))[0]
        off_axis = np.arctan2(np.hypot(q[:, 0], q[:, 1]), q[:, 2])
        return cls(np.linalg.norm(q, axis=1), off_axis)

    def nearest_mm(self, boxes: Boxes) -> FloatArray:
        """Smallest depth over each box, (B, k); exact."""
        angle = np.minimum(self.off_axis_rad + boxes.angle_rad[:, None], np.pi)
        return np.asarray(self.distance_mm * np.cos(angle) - boxes.position_mm[:, None])

    def farthest_mm(self, boxes: Boxes) -> FloatArray:
        """Largest depth over each box, (B, k); exact."""
        angle = np.maximum(self.off_axis_rad - boxes.angle_rad[:, None], 0.0)
        return np.asarray(self.distance_mm * np.cos(angle) + boxes.position_mm[:, None])


def _least_blur(
    view: Views, boxes: Boxes, z: FloatArray, sign: float
) -> tuple[FloatArray, BoolArray]:
    """Blur per aperture at depth z and the lens' worst end, and where that is valid.

    ``sign`` -1 gives the least b (d low, f high), +1 the largest.
    """
    f = (view.f_mm[0] - sign * boxes.f_mm)[:, None]
    d = (view.d_mm[0] + sign * boxes.d_mm)[:, None]
    e = view.e_mm[0]
    valid = (z > f) & (z > f - e) & (z > -e) & (f > 0)
    safe = np.where(valid, z, 1.0)
    f_safe = np.where(f > 0, f, 1.0)
    f_cal = principal_distance_mm(d, f_safe, e)
    return np.asarray((d - f_safe) / f_safe - f_cal / safe), np.asarray(valid)


def near_focus(focus: FocusNear, view: Views, boxes: Boxes) -> FloatArray:
    """Least c + b over each box, (B,) mm of blur; exact: b rises with z and d."""
    z = _Points.of(view, focus.points_mm).nearest_mm(boxes)
    per_aperture, valid = _least_blur(view, boxes, z, -1.0)
    a_low, a_high = _apertures(view, boxes)
    least = np.minimum(a_low * per_aperture, a_high * per_aperture)
    return np.asarray(_refused(focus.c_mm + least, valid).min(axis=1))


def far_focus(focus: FocusFar, view: Views, boxes: Boxes) -> FloatArray:
    """Least c - b over each box, (B,) mm of blur; exact."""
    points = _Points.of(view, focus.points_mm)
    per_aperture, valid = _least_blur(view, boxes, points.farthest_mm(boxes), 1.0)
    in_front = points.nearest_mm(boxes) > view.f_mm[0] + boxes.f_mm[:, None]
    a_low, a_high = _apertures(view, boxes)
    largest = np.maximum(a_low * per_aperture, a_high * per_aperture)
    return np.asarray(_refused(focus.c_mm - largest, valid & in_front).min(axis=1))


def _apertures(view: Views, boxes: Boxes) -> tuple[FloatArray, FloatArray]:
    a = view.a_mm[0]
    return np.maximum(a - boxes.a_mm, 0.0)[:, None], (a + boxes.a_mm)[:, None]


def circle(field: FieldOfViewCircle, view: Views, boxes: Boxes) -> FloatArray:
    """Least distance of the sphere from the cone over each box, (B,) mm; exact."""
    _, f_cal = boxes.principal_distances_mm(view)
    centre = _Points.of(view, field.centre_mm)
    half = np.arctan2(field.image_radius_mm, f_cal)
    inward = half - centre.off_axis_rad[0] - boxes.angle_rad
    distance = centre.distance_mm[0] * np.sin(np.maximum(inward, -np.pi / 2))
    return np.asarray(distance - boxes.position_mm - field.radius_mm)


def rectangle(field: FieldOfViewRectangle, view: Views, boxes: Boxes) -> FloatArray:
    """Least distance from a side of the pyramid over each box, (B,) mm; exact."""
    both = np.stack(boxes.principal_distances_mm(view))[:, :, None]
    extents = field.extents_mm
    root = np.sqrt(extents**2 + both**2)
    normals = np.zeros((*root.shape, 3))
    normals[..., 2] = extents / root
    for side, (axis, sign) in enumerate(((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0))):
        normals[..., side, axis] = sign * (both[..., 0] / root[..., side])
    q = view.camera_points(field.points_mm)[0]
    length = np.linalg.norm(q, axis=1)
    sine = np.einsum("sbij,kj->sbik", normals, q) / length
    inward = np.arcsin(np.clip(sine, -1.0, 1.0)) - boxes.angle_rad[:, None, None]
    distance = length * np.sin(np.maximum(inward, -np.pi / 2))
    return np.asarray(distance.min(axis=(0, 2, 3)) - boxes.position_mm)


def resolution(rows: Resolution, view: Views, boxes: Boxes) -> FloatArray:
    """A lower bound of pixels covered minus required over each box, (B,) px.

    The shift is bounded first (over cells of its depth part), then the turn. Rows that
    count along columns or rows cover at least as many as the diagonal count bounded
    here.
    """
    a, b = (view.camera_points(p)[0] for p in (rows.starts_mm, rows.ends_mm))
    length = np.linalg.norm(b - a, axis=1)
    shifted = _shifted_image(a, b, length, boxes.position_mm)
    turned = shifted * _turned_factor(a, b, length, boxes)
    f_cal, _ = boxes.principal_distances_mm(view)
    pixels = f_cal[:, None] * length * turned / rows.diagonal_pitch_mm
    return np.asarray((pixels - rows.required_px).min(axis=1))


def _shifted_image(
    a: FloatArray, b: FloatArray, length: FloatArray, p: FloatArray
) -> FloatArray:
    """Least |N| / (z_A z_B) over shifts in a ball, (B, R); 0 where none is proven."""
    u = (b - a) / length[:, None]
    across = u[:, :2] * a[:, 2:] - a[:, :2] * u[:, 2:]
    size = np.linalg.norm(across, axis=1)
    along = (u[:, :2] * across).sum(axis=1) / np.where(size > 0, size, 1.0)
    edges = np.linspace(-1.0, 1.0, _CELLS + 1) * p[:, None]
    low, high = edges[:, None, :-1], edges[:, None, 1:]
    least_square = np.where(low * high <= 0, 0.0, np.minimum(low**2, high**2))
    rim = np.sqrt(np.maximum(p[:, None, None] ** 2 - least_square, 0.0))
    pull = np.maximum(along[:, None] * low, along[:, None] * high)
    top = size[:, None] - pull - np.abs(u[:, 2:]) * rim
    depth = (a[:, 2:] - low) * (b[:, 2:] - low)
    in_front = (a[:, 2:] - high > 0) & (b[:, 2:] - high > 0)
    ratio = np.where(in_front, top / np.where(in_front, depth, 1.0), 0.0)
    return np.asarray(np.maximum(ratio.min(axis=2), 0.0))


def _turned_factor(
    a: FloatArray, b: FloatArray, length: FloatArray, boxes: Boxes
) -> FloatArray:
    """Least factor of the image length by turning, after any shift, (B, R)."""
    th, p = boxes.angle_rad[:, None], boxes.position_mm[:, None]
    normal = np.cross(a, (b - a) / length[:, None])
    gap = np.linalg.norm(normal, axis=1)
    tilt = np.arctan2(np.hypot(normal[:, 0], normal[:, 1]), np.abs(normal[:, 2]))
    tilt = tilt - _asin_ratio(p, gap)
    proven = tilt > th
    factor = np.sin(tilt - th) / np.where(proven, np.sin(tilt), 1.0)
    for end in (a, b):
        off = np.arctan2(np.hypot(end[:, 0], end[:, 1]), end[:, 2])
        off = off + _asin_ratio(p, np.linalg.norm(end, axis=1))
        proven &= off + th < np.pi / 2
        factor = factor * np.cos(off) / np.cos(np.maximum(off - th, 0.0))
    return np.where(proven, factor, 0.0)


def _asin_ratio(p: FloatArray, distance: FloatArray) -> FloatArray:
    ratio = p / np.where(distance > 0, distance, 1.0)
    return np.asarray(np.arcsin(np.minimum(np.where(distance > 0, ratio, 1.0), 1.0)))


def _refused(value: FloatArray, valid: BoolArray) -> FloatArray:
    return np.where(valid, value, _REFUSED)
