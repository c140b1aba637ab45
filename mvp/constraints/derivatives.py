"""Chain rule from camera coordinates and principal distance to the error coordinates.

A part point P has camera coordinates q = R^T (P - r). A shift dr and a turn w change
it by dq = -R^T dr + q x w.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints.base import N_COORDINATES, SHIFT, TURN, D, F

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Views

IN_FRONT_MM = 1e-6
"""A depth that is not larger counts as behind the camera."""


def empty_gradient(shape: tuple[int, ...]) -> FloatArray:
    """Zeros of shape (*shape, 9)."""
    return np.zeros((*shape, N_COORDINATES))


def add_pose_gradient(
    gradient: FloatArray, views: Views, q: FloatArray, slope: FloatArray
) -> None:
    """Add what shift and turn do through one camera point.

    Args:
        gradient: (N, R, 9), changed in place.
        views: N views.
        q: camera coordinates (N, R, 3) or (N, 1, 3), mm.
        slope: derivative of the row by q, (N, R, 3).
    """
    gradient[..., SHIFT] -= np.matmul(slope, np.swapaxes(views.rotation, 1, 2))
    # Written out: numpy.cross costs more than all the rest for a few views.
    sx, sy, sz = slope[..., 0], slope[..., 1], slope[..., 2]
    x, y, z = q[..., 0], q[..., 1], q[..., 2]
    turn = gradient[..., TURN]
    turn[..., 0] += sy * z - sz * y
    turn[..., 1] += sz * x - sx * z
    turn[..., 2] += sx * y - sy * x


def add_depth_gradient(
    gradient: FloatArray, views: Views, q: FloatArray, slope: FloatArray
) -> None:
    """``add_pose_gradient`` for rows that depend on the depth z alone.

    Args:
        gradient: (N, R, 9), changed in place.
        views: N views.
        q: camera coordinates (N, R, 3), mm.
        slope: derivative of the row by z, (N, R).
    """
    gradient[..., SHIFT] -= slope[..., None] * views.direction[:, None]
    gradient[..., TURN.start] -= slope * q[..., 1]
    gradient[..., TURN.start + 1] += slope * q[..., 0]


def add_principal_distance_gradient(
    gradient: FloatArray, views: Views, slope: FloatArray
) -> None:
    """Add what d and f do through f_cal = d - e (d - f) / f.

    Args:
        gradient: (N, R, 9), changed in place.
        views: N views.
        slope: derivative of the row by f_cal, (N, R).
    """
    by_d = 1 - views.e_mm / views.f_mm
    by_f = views.e_mm * views.d_mm / views.f_mm**2
    gradient[..., D] += slope * by_d[:, None]
    gradient[..., F] += slope * by_f[:, None]


def replace_behind(
    value: FloatArray,
    gradient: FloatArray | None,
    views: Views,
    depth: FloatArray,
    behind: BoolArray,
) -> None:
    """Give rows behind the camera the value min(z, 0) - 1 and the slope of z.

    Args:
        value: (N, R), changed in place.
        gradient: (N, R, 9) or None, changed in place.
        views: N views.
        depth: (N, R) the depth that decides, mm.
        behind: (N, R) which rows to replace.
    """
    if not behind.any():
        return
    value[behind] = np.minimum(depth[behind], 0.0) - 1.0
    if gradient is not None:
        view_of = np.nonzero(behind)[0]
        gradient[behind] = 0.0
        block = np.zeros((len(view_of), N_COORDINATES))
        block[:, SHIFT] = -views.direction[view_of]
        gradient[behind] = block
