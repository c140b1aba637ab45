"""The thick lens: what f, d, a and the pupil offset e do to focus and perspective.

Distances D count from the front nodal point, z from the entrance pupil (z = D - e).
All functions broadcast; mm throughout. Sources: the paper's (4), (5), extended by the
pupil offset (docs/explanation, thick lens); e = 0 gives the paper's forms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from mvp.geometry import FloatArray


def focus_distance_mm(d_mm: ArrayLike, f_mm: ArrayLike) -> FloatArray:
    """D_f = f d / (d - f), the distance in perfect focus; inf for d <= f."""
    d, f = np.broadcast_arrays(
        np.asarray(d_mm, np.float64), np.asarray(f_mm, np.float64)
    )
    gap = d - f
    safe = np.where(gap > 0, gap, 1.0)
    return np.asarray(np.where(gap > 0, f * d / safe, np.inf))


def image_distance_mm(focus_distance: ArrayLike, f_mm: ArrayLike) -> FloatArray:
    """D = f D_f / (D_f - f): the d that focuses at D_f > f."""
    distance = np.asarray(focus_distance, np.float64)
    f = np.asarray(f_mm, np.float64)
    return np.asarray(f * distance / (distance - f))


def principal_distance_mm(
    d_mm: ArrayLike, f_mm: ArrayLike, e_mm: ArrayLike
) -> FloatArray:
    """f_cal = d - e m with m = (d - f) / f: what a calibration measures."""
    d, f, e = (np.asarray(v, np.float64) for v in (d_mm, f_mm, e_mm))
    return np.asarray(d - e * (d - f) / f)


def signed_blur_mm(
    z_mm: ArrayLike, d_mm: ArrayLike, f_mm: ArrayLike, a_mm: ArrayLike, e_mm: ArrayLike
) -> FloatArray:
    """Signed diameter of the blur circle in the image, b = a (m - f_cal / z).

    Zero in perfect focus, negative nearer than it, positive beyond. The absolute
    value is the diameter of the circle of confusion on the sensor. z > 0.
    """
    d, f, a = (np.asarray(v, np.float64) for v in (d_mm, f_mm, a_mm))
    f_cal = principal_distance_mm(d, f, e_mm)
    return np.asarray(a * ((d - f) / f - f_cal / np.asarray(z_mm, np.float64)))


def depth_limits_mm(
    d_mm: ArrayLike, f_mm: ArrayLike, a_mm: ArrayLike, c_mm: ArrayLike, e_mm: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Near and far limit (D2, D1) of the depth of field from the front nodal point.

    Eq. (5) and (4) with pupil offset: D = f (a d -+ k c e) / (a (d - f) -+ k c f).
    D1 is inf from the hyperfocal setting on (a (d - f) <= c f).
    """
    d, f, a, c, e = np.broadcast_arrays(
        *(np.asarray(v, np.float64) for v in (d_mm, f_mm, a_mm, c_mm, e_mm))
    )
    near_gap = a * (d - f) + c * f
    far_gap = a * (d - f) - c * f
    near_safe = np.where(near_gap > 0, near_gap, 1.0)
    far_safe = np.where(far_gap > 0, far_gap, 1.0)
    near = np.where(near_gap > 0, f * (a * d + c * e) / near_safe, np.inf)
    far = np.where(far_gap > 0, f * (a * d - c * e) / far_safe, np.inf)
    return np.asarray(near), np.asarray(far)


def equal_blur_image_distance_mm(
    z_near_mm: ArrayLike, z_far_mm: ArrayLike, f_mm: ArrayLike, e_mm: ArrayLike
) -> FloatArray:
    """The d with the same blur at both depths (from the pupil): sharpest in common."""
    h = (1 / np.asarray(z_near_mm, np.float64) + 1 / np.asarray(z_far_mm)) / 2
    f, e = np.asarray(f_mm, np.float64), np.asarray(e_mm, np.float64)
    m = h * f / (1 - h * (f - e))
    return np.asarray(f * (1 + m))
