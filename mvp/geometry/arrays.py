"""Array types, and the one place where shapes are checked."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]


def as_points(values: ArrayLike, *, name: str = "points") -> FloatArray:
    """Return ``values`` as a finite float64 array of shape (..., 3).

    Raises:
        ValueError: the last axis is not 3 long, or a value is not finite.
    """
    points = np.asarray(values, dtype=np.float64)
    if points.ndim == 0 or points.shape[-1] != 3:
        raise ValueError(f"{name} must have shape (..., 3), got {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError(f"{name} must be finite")
    return points


def unit(vectors: ArrayLike) -> FloatArray:
    """Scale vectors, shape (..., n), to length 1.

    Raises:
        ValueError: a vector has no length.
    """
    array = np.asarray(vectors, dtype=np.float64)
    length = np.linalg.norm(array, axis=-1, keepdims=True)
    if not (length > 0).all():
        raise ValueError("a vector of length zero has no direction")
    return np.asarray(array / length, dtype=np.float64)


def plane_axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that make a right-handed frame with a unit normal (3,)."""
    least_along = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(least_along, normal)
    first = first / np.linalg.norm(first)
    return first, np.asarray(np.cross(normal, first))
