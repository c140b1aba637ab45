"""An axis-aligned box, mm: the workspace, a bounding box, a keep-out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry.arrays import BoolArray, FloatArray, as_points

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Box:
    """All points between two corners (3,), mm."""

    low_mm: FloatArray
    high_mm: FloatArray

    def __post_init__(self) -> None:
        low = np.array(as_points(self.low_mm, name="low_mm"))
        high = np.array(as_points(self.high_mm, name="high_mm"))
        if low.shape != (3,) or high.shape != (3,) or (low > high).any():
            raise ValueError(f"a box needs low <= high, got {low} and {high}")
        object.__setattr__(self, "low_mm", low)
        object.__setattr__(self, "high_mm", high)

    @classmethod
    def around(cls, points: ArrayLike, *, grow_mm: float = 0.0) -> Box:
        """The bounding box of points (n, 3), grown on every side."""
        array = as_points(points).reshape(-1, 3)
        return cls(array.min(axis=0) - grow_mm, array.max(axis=0) + grow_mm)

    @property
    def size_mm(self) -> FloatArray:
        """Edge lengths (3,), mm."""
        return self.high_mm - self.low_mm

    @property
    def diagonal_mm(self) -> float:
        """Length of the space diagonal, mm."""
        return float(np.linalg.norm(self.size_mm))

    @property
    def centre_mm(self) -> FloatArray:
        """Midpoint (3,), mm."""
        return np.asarray((self.low_mm + self.high_mm) / 2)

    def contains(self, points: ArrayLike) -> BoolArray:
        """Which of the points (..., 3) lie inside or on the box."""
        array = as_points(points)
        inside = (array >= self.low_mm) & (array <= self.high_mm)
        return np.asarray(inside.all(axis=-1))

    def corners(self) -> FloatArray:
        """The eight corners (8, 3), mm."""
        grid = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"))
        return np.asarray(self.low_mm + grid.reshape(3, 8).T * self.size_mm)
