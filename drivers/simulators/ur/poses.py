"""Poses as URScript writes them: x, y, z in metres and a rotation vector in rad."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

Floats = NDArray[np.float64]
MM_PER_M = 1000.0


def matrix_of(pose: Sequence[float] | Floats) -> Floats:
    """(4, 4) transform, metres, of a pose (6,)."""
    values = np.asarray(pose, dtype=np.float64)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_of(values[3:])
    matrix[:3, 3] = values[:3]
    return matrix


def pose_of(matrix: Floats) -> Floats:
    """Pose (6,) of a transform (4, 4) in metres."""
    return np.concatenate([matrix[:3, 3], rotation_vector(matrix[:3, :3])])


def rotation_of(vector: Floats) -> Floats:
    """(3, 3) rotation about ``vector`` by its length, rad."""
    return np.asarray(rotations_about(vector, np.ones(1))[0])


def rotations_about(vector: Floats, shares: Floats) -> Floats:
    """(n, 3, 3) rotations by shares (n,) of the one about ``vector`` by its length."""
    angle = float(np.sqrt(vector @ vector))
    if angle < 1e-12:
        return np.asarray(np.eye(3) + shares[:, None, None] * _cross(vector))
    k = _cross(vector / angle)
    turned = angle * shares[:, None, None]
    return np.asarray(np.eye(3) + np.sin(turned) * k + (1 - np.cos(turned)) * (k @ k))


def rotation_vector(rotation: Floats) -> Floats:
    """Axis times angle (0 .. pi rad) of a rotation (3, 3)."""
    w, x, y, z = _quaternion(rotation)
    vector = np.array([x, y, z])
    length = float(np.sqrt(vector @ vector))
    if length < 1e-12:
        return 2.0 * vector
    angle = 2.0 * np.arctan2(length, w)
    return np.asarray(vector * (angle / length))


def _quaternion(r: Floats) -> Floats:
    """W >= 0, x, y, z: from the largest of the four, so that nothing cancels."""
    trace = float(np.trace(r))
    squares = np.array([trace, r[0, 0], r[1, 1], r[2, 2]])
    k = int(np.argmax(squares))
    if k == 0:
        q = [1 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
    else:
        i = k - 1
        j, m = (i + 1) % 3, (i + 2) % 3
        q = [r[m, j] - r[j, m], 0.0, 0.0, 0.0]
        q[1 + i] = 1 + r[i, i] - r[j, j] - r[m, m]
        q[1 + j] = r[j, i] + r[i, j]
        q[1 + m] = r[m, i] + r[i, m]
    unit = np.array(q) / np.linalg.norm(q)
    return np.asarray(unit if unit[0] >= 0 else -unit)


def _cross(v: Floats) -> Floats:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
