"""The paper's own constraint functions (1)-(14), (18), as vector formulas.

They describe the same sets as the smooth rows and share no code with them, so that
one checks the other. All arrays broadcast over leading axes; points are (..., 3) in one
frame, mm; nu is the unit viewing direction. ``e`` is the pupil offset: positions count
from the entrance pupil, D1 and D2 from the front nodal point, and the principal distance
f_cal = d - e d / D_f takes the place of d in (1) and (6). e = 0 is the paper.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from mvp.geometry import BoolArray, FloatArray


def _f64(values: ArrayLike) -> FloatArray:
    return np.asarray(values, np.float64)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray((a * b).sum(axis=-1))


def principal_distance(d: ArrayLike, f: ArrayLike, e: ArrayLike = 0.0) -> FloatArray:
    """f_cal = d - e d / D_f with 1 / D_f = 1 / f - 1 / d, mm."""
    d, f, e = _f64(d), _f64(f), _f64(e)
    return np.asarray(d - e * d * (1 / f - 1 / d))


def g1(
    r_v: ArrayLike,
    nu: ArrayLike,
    r_a: ArrayLike,
    r_b: ArrayLike,
    w: ArrayLike,
    f_cal: ArrayLike,
) -> FloatArray:
    """Eq. (1), 1/mm: image length per f_cal and object length, minus w / (d l).

    Both depths must be positive, not only their product; elsewhere the piece has no
    image and the result is -w / (d l).
    """
    r_v, nu, r_a, r_b = _f64(r_v), _f64(nu), _f64(r_a), _f64(r_b)
    along = r_b - r_a
    length = np.linalg.norm(along, axis=-1)
    cross = np.cross(np.cross(r_a - r_v, along / length[..., None]), nu)
    depth_a, depth_b = _dot(r_a - r_v, nu), _dot(r_b - r_v, nu)
    seen = (depth_a > 0) & (depth_b > 0)
    product = np.where(seen, depth_a * depth_b, 1.0)
    image = np.where(seen, np.linalg.norm(cross, axis=-1) / product, 0.0)
    return np.asarray(image - _f64(w) / (_f64(f_cal) * length))


def g1_image(
    r_v: ArrayLike,
    nu: ArrayLike,
    r_a: ArrayLike,
    r_b: ArrayLike,
    w: ArrayLike,
    f_cal: ArrayLike,
) -> FloatArray:
    """Eq. (7), mm of image, with (r_A - r_V) . nu where a norm is printed."""
    r_v, nu, r_a, r_b = _f64(r_v), _f64(nu), _f64(r_a), _f64(r_b)
    moment = np.cross(np.cross(r_a - r_v, r_b - r_a), nu)
    depths = np.stack([_dot(r_a - r_v, nu), _dot(r_b - r_v, nu)], axis=-1)
    seen = (depths > 0).all(axis=-1)
    product = np.where(seen, depths.prod(axis=-1), 1.0)
    size = _f64(f_cal) * np.linalg.norm(moment, axis=-1) / product
    return np.asarray(np.where(seen, size, 0.0) - _f64(w))


def farthest_piece(
    r_v: ArrayLike, nu: ArrayLike, r_a: ArrayLike, r_b: ArrayLike, length: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """The piece of one length at the deeper end of an edge AB: the worst one for g1."""
    r_v, nu, r_a, r_b = _f64(r_v), _f64(nu), _f64(r_a), _f64(r_b)
    u = (r_b - r_a) / np.linalg.norm(r_b - r_a, axis=-1, keepdims=True)
    deeper_b = (_dot(r_b - r_v, nu) >= _dot(r_a - r_v, nu))[..., None]
    start = np.where(deeper_b, r_b, r_a)
    return start, np.asarray(
        start + np.where(deeper_b, -u, u) * _f64(length)[..., None]
    )


def far_limit(
    d: ArrayLike, f: ArrayLike, a: ArrayLike, c: ArrayLike, e: ArrayLike = 0.0
) -> FloatArray:
    """D1 of eq. (4) with pupil offset, from the front nodal point; inf beyond hyperfocal.

    D1 = D_f (a d - c e) / (a d - c D_f).
    """
    d, f, a, c, e = np.broadcast_arrays(*map(_f64, (d, f, a, c, e)))
    vergence = 1 / f - 1 / d
    gap = a * d * vergence - c
    safe = np.where(gap > 0, gap, 1.0)
    return np.asarray(np.where(gap > 0, (a * d - c * e) / safe, np.inf))


def near_limit(
    d: ArrayLike, f: ArrayLike, a: ArrayLike, c: ArrayLike, e: ArrayLike = 0.0
) -> FloatArray:
    """D2 of eq. (5) with pupil offset, from the front nodal point, mm.

    D2 = D_f (a d + c e) / (a d + c D_f); inf when nothing is sharp at any distance.
    """
    d, f, a, c, e = np.broadcast_arrays(*map(_f64, (d, f, a, c, e)))
    gap = a * d * (1 / f - 1 / d) + c
    safe = np.where(gap > 0, gap, 1.0)
    return np.asarray(np.where(gap > 0, (a * d + c * e) / safe, np.inf))


def g2a(
    r_v: ArrayLike, nu: ArrayLike, points: ArrayLike, d2: ArrayLike, e: ArrayLike = 0.0
) -> FloatArray:
    """Eqs. (2), (8), mm: depth of the closest of points (..., k, 3) minus D2 - e."""
    depth = _depths(r_v, nu, points)
    return np.asarray(depth.min(axis=-1) - (_f64(d2) - _f64(e)))


def g2b(
    r_v: ArrayLike, nu: ArrayLike, points: ArrayLike, d1: ArrayLike, e: ArrayLike = 0.0
) -> FloatArray:
    """Eqs. (3), (9), mm: D1 - e minus the depth of the farthest of the points.

    A point behind the camera makes the result negative: it is nowhere in focus.
    """
    depth = _depths(r_v, nu, points)
    slack = (_f64(d1) - _f64(e)) - depth.max(axis=-1)
    return np.asarray(np.where(depth.min(axis=-1) > 0, slack, -np.inf))


def _depths(r_v: ArrayLike, nu: ArrayLike, points: ArrayLike) -> FloatArray:
    offset = _f64(points) - _f64(r_v)[..., None, :]
    return _dot(offset, _f64(nu)[..., None, :])


def field_of_view_angle(i_min: ArrayLike, f_cal: ArrayLike) -> FloatArray:
    """Alpha = 2 atan(I_min / (2 f_cal)), rad."""
    return np.asarray(2 * np.arctan(_f64(i_min) / (2 * _f64(f_cal))))


def g3(
    r_v: ArrayLike,
    nu: ArrayLike,
    r_c: ArrayLike,
    radius: ArrayLike,
    alpha: ArrayLike,
) -> FloatArray:
    """Eq. (6), mm: (r_K - r_V) . nu - |r_K - r_V| cos(alpha / 2).

    r_K = r_C - nu R_f / sin(alpha / 2) is the apex of the cone of admissible pupils.
    """
    to_apex, half = _to_apex(r_v, nu, r_c, radius, alpha)
    distance = np.linalg.norm(to_apex, axis=-1)
    return np.asarray(_dot(to_apex, _f64(nu)) - distance * np.cos(half))


def g3_cosine(
    r_v: ArrayLike,
    nu: ArrayLike,
    r_c: ArrayLike,
    radius: ArrayLike,
    alpha: ArrayLike,
) -> FloatArray:
    """Eq. (10), no unit: the difference of cosines; 0 at the apex itself, as in (6)."""
    to_apex, half = _to_apex(r_v, nu, r_c, radius, alpha)
    distance = np.linalg.norm(to_apex, axis=-1)
    safe = np.where(distance > 0, distance, 1.0)
    cosine = _dot(to_apex, _f64(nu)) / safe
    return np.asarray(np.where(distance > 0, cosine - np.cos(half), 0.0))


def _to_apex(
    r_v: ArrayLike, nu: ArrayLike, r_c: ArrayLike, radius: ArrayLike, alpha: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    half = _f64(alpha) / 2
    back = (_f64(radius) / np.sin(half))[..., None] * _f64(nu)
    return np.asarray(_f64(r_c) - back - _f64(r_v)), half


def g4(distance: ArrayLike, inside: ArrayLike) -> FloatArray:
    """Eqs. (12), (13), mm: distance to the region's boundary, negative outside."""
    return np.asarray(np.where(np.asarray(inside, bool), 1.0, -1.0) * _f64(distance))


def g4_rays(
    ray_lengths: ArrayLike, inside: BoolArray, *, on_boundary: BoolArray | None = None
) -> FloatArray:
    """Eq. (14), mm: k times the shortest ray to the boundary, k = 1, -1 or 0.

    Never smaller in size than the exact distance.

    Args:
        ray_lengths: (..., r) along each ray; inf where a ray meets nothing.
        inside: (...,) classification of the viewpoint.
        on_boundary: (...,) or None: where k is 0.
    """
    k = np.where(inside, 1.0, -1.0)
    shortest = _f64(ray_lengths).min(axis=-1)
    if on_boundary is None:
        return np.asarray(k * shortest)
    return np.asarray(np.where(on_boundary, 0.0, k * shortest))


def g5(nu: ArrayLike) -> FloatArray:
    """Eq. (11), no unit: |nu|^2 - 1, zero for a unit viewing direction."""
    return np.asarray(_dot(_f64(nu), _f64(nu)) - 1)


def required_length(
    pitch_x: float, pitch_y: float, pixels: ArrayLike = 1.0
) -> FloatArray:
    """W of eq. (18), mm: pixels along the diagonal, where they are farthest apart."""
    return np.asarray(_f64(pixels) * np.hypot(pitch_x, pitch_y))


def required_length_along(
    direction: ArrayLike, pitch_x: float, pitch_y: float, pixels: ArrayLike = 1.0
) -> FloatArray:
    """W for one direction in the image, mm: columns or rows, whichever count more.

    Args:
        direction: (..., 2) in the image, any length but 0.
        pitch_x: distance of two columns, mm.
        pitch_y: distance of two rows, mm.
        pixels: pixels that must be covered.

    Returns:
        At most ``required_length``, which it reaches on the pixel diagonal.
    """
    vector = _f64(direction)
    counts = np.abs(vector) / np.array([pitch_x, pitch_y])
    per_pixel = np.linalg.norm(vector, axis=-1) / counts.max(axis=-1)
    return np.asarray(_f64(pixels) * per_pixel)
