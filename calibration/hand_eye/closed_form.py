"""Hand-eye transforms in closed form: Tsai-Lenz 1989, Park-Martin 1994, Daniilidis 1999.

All take every pair of views. The rotations (and all of Daniilidis) do not depend on the
order of the views; the translations of the other two do by a tenth of their error, since
a pair counts one way only, as usual for these methods. They give a first guess and an
independent opinion; they know no covariance, and answer even when the motions do not
determine an answer: see ``observability``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.hand_eye.motions import all_pairs, usable
from calibration.poses import Poses, mean_pose
from calibration.projection import skew

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibration.hand_eye.motions import Motions
    from mvp.geometry import FloatArray

Method = Literal["tsai-lenz", "park", "daniilidis"]

# Turning X by half a turn first keeps its own angle away from 180 degrees, where
# Tsai-Lenz's parameters are infinite.
_HALF_TURNS = np.array(
    [np.eye(3), np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1])]
)


def closed_form(
    fixed_from_moving: Poses, camera_from_target: Poses, method: Method = "tsai-lenz"
) -> Poses:
    """X of A X = X B from all pairs of views, as a set of one.

    Args:
        fixed_from_moving: n robot poses, see ``motions``.
        camera_from_target: n target poses, mm.
        method: whose formulas.

    Raises:
        ValueError: fewer than three views.
    """
    if len(fixed_from_moving) < 3:
        raise ValueError("a hand-eye transform needs three views at least")
    motions = usable(all_pairs(fixed_from_moving, camera_from_target))
    if method == "daniilidis":
        return _daniilidis(motions)
    solvers: dict[str, Callable[[Motions], FloatArray]] = {
        "tsai-lenz": _tsai_lenz_rotation,
        "park": _park_rotation,
    }
    rotation = solvers[method](motions)
    return Poses(rotation[None], _translation(motions, rotation)[None])


def target_in_fixed(
    fixed_from_moving: Poses, moving_from_camera: Poses, camera_from_target: Poses
) -> Poses:
    """Z, the mean of where each view puts the target, as a set of one."""
    return mean_pose(fixed_from_moving @ moving_from_camera @ camera_from_target)


def _tsai_lenz_rotation(motions: Motions) -> FloatArray:
    """Rotation of X by modified Rodrigues parameters, Tsai-Lenz (12)-(14)."""
    camera = _half_sine_axes(motions.camera)
    starts = [
        (_half_sine_axes(motions.moving) @ turn, camera, turn) for turn in _HALF_TURNS
    ]
    moving, camera, turn = max(starts, key=lambda start: _firmness(start[0], start[1]))
    left = skew(moving + camera).reshape(-1, 3)
    prime = np.linalg.lstsq(left, (camera - moving).ravel(), rcond=None)[0]
    # |P'| = tan(angle / 2), P' along the axis
    half = np.arctan(np.linalg.norm(prime))
    axis = prime / max(float(np.linalg.norm(prime)), np.finfo(float).tiny)
    return np.asarray(turn @ Rotation.from_rotvec(2 * half * axis).as_matrix())


def _half_sine_axes(motion: Poses) -> FloatArray:
    """(m, 3): 2 sin(angle / 2) times the axis."""
    quaternion = Rotation.from_matrix(motion.rotation).as_quat(canonical=True)
    return np.asarray(2 * quaternion[:, :3])


def _firmness(moving: FloatArray, camera: FloatArray) -> float:
    left = skew(moving + camera).reshape(-1, 3)
    return float(np.linalg.svd(left, compute_uv=False)[-1])


def _park_rotation(motions: Motions) -> FloatArray:
    """The rotation that best turns all axes of B into those of A, Park-Martin (17)."""
    correlation = motions.moving.rotvec_rad.T @ motions.camera.rotvec_rad
    u, _, vt = np.linalg.svd(correlation)
    sign = np.sign(np.linalg.det(u @ vt))
    return np.asarray(u @ np.diag([1.0, 1.0, sign]) @ vt)


def _translation(motions: Motions, rotation: FloatArray) -> FloatArray:
    """(R_A - 1) t_X = R_X t_B - t_A over all motions, each of them one way."""
    left = (motions.moving.rotation - np.eye(3)).reshape(-1, 3)
    right = motions.camera.translation_mm @ rotation.T - motions.moving.translation_mm
    return np.asarray(np.linalg.lstsq(left, right.ravel(), rcond=None)[0])


def _daniilidis(motions: Motions) -> Poses:
    """Rotation and translation together by dual quaternions, Daniilidis (31)-(35)."""
    scale_mm = float(
        np.sqrt((motions.moving.translation_mm**2).sum(axis=1).mean()) or 1.0
    )
    a, a_dual = _dual_quaternions(motions.moving, scale_mm)
    b, b_dual = _dual_quaternions(motions.camera, scale_mm)
    rows = np.zeros((len(a), 6, 8))
    rows[:, :3, 0] = rows[:, 3:, 4] = a[:, 1:] - b[:, 1:]
    rows[:, :3, 1:4] = rows[:, 3:, 5:] = skew(a[:, 1:] + b[:, 1:])
    rows[:, 3:, 0] = a_dual[:, 1:] - b_dual[:, 1:]
    rows[:, 3:, 1:4] = skew(a_dual[:, 1:] + b_dual[:, 1:])
    vectors = np.linalg.svd(rows.reshape(-1, 8))[2][-2:]
    real, dual = _unit_dual(vectors[0], vectors[1])
    rotation = Rotation.from_quat(real, scalar_first=True)
    translation = 2 * _product(dual, real * np.array([1, -1, -1, -1]))[1:] * scale_mm
    return Poses(rotation.as_matrix()[None], translation[None])


def _dual_quaternions(motion: Poses, scale_mm: float) -> tuple[FloatArray, FloatArray]:
    """Real and dual parts (m, 4), scalar first and not negative."""
    real = Rotation.from_matrix(motion.rotation).as_quat(
        canonical=True, scalar_first=True
    )
    shift = np.pad(motion.translation_mm / scale_mm, ((0, 0), (1, 0)))
    return real, 0.5 * _product(shift, real)


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Hamilton's product of quaternions (..., 4), scalar first."""
    scalar = left[..., :1] * right[..., :1] - (left[..., 1:] * right[..., 1:]).sum(
        axis=-1, keepdims=True
    )
    vector = (
        left[..., :1] * right[..., 1:]
        + right[..., :1] * left[..., 1:]
        + np.cross(left[..., 1:], right[..., 1:])
    )
    return np.concatenate([scalar, vector], axis=-1)


def _unit_dual(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The combination of the two null vectors that is a unit dual quaternion."""
    u1, v1, u2, v2 = first[:4], first[4:], second[:4], second[4:]
    a, b, c = float(u1 @ v1), float(u1 @ v2 + u2 @ v1), float(u2 @ v2)
    root = np.sqrt(max(b * b - 4 * a * c, 0.0))
    # both roots of a s^2 + b s + c as directions (s, 1), so that a = 0 is no special case
    candidates = [(-b - root, 2 * a), (-b + root, 2 * a), (2 * c, -b + root)]
    best = max(candidates, key=lambda pair: _length(u1 * pair[0] + u2 * pair[1], pair))
    combined = first * best[0] + second * best[1]
    combined = combined / np.linalg.norm(combined[:4])
    return combined[:4], combined[4:]


def _length(real: FloatArray, pair: tuple[float, float]) -> float:
    """Length of the real part for a combination of length one."""
    size = float(np.hypot(*pair))
    return float(np.linalg.norm(real)) / size if size > 0 else -1.0
