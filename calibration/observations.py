"""Points of a target and where they were found in pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Observations:
    """All points of all views, one row each.

    Attributes:
        points_target_mm: (m, 3).
        pixels: (m, 2), where each was found.
        view: (m,), the view of each row, 0 .. views - 1, not decreasing.
        names: one for each view, for reports.
        width_px: columns of the pictures.
        height_px: rows of the pictures.
    """

    points_target_mm: FloatArray
    pixels: FloatArray
    view: IntArray
    names: tuple[str, ...]
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        count = len(self.view)
        if self.points_target_mm.shape != (count, 3):
            raise ValueError("points_target_mm must have shape (m, 3)")
        if self.pixels.shape != (count, 2):
            raise ValueError("pixels must have shape (m, 2)")
        numbers = np.unique(self.view)
        if not np.array_equal(numbers, np.arange(len(self.names))):
            raise ValueError("every view must have a name and at least one point")
        if (np.diff(self.view) < 0).any():
            raise ValueError("the rows must be sorted by view")
        if not (
            np.isfinite(self.points_target_mm).all() and np.isfinite(self.pixels).all()
        ):
            raise ValueError("points and pixels must be finite")

    @classmethod
    def from_views(
        cls,
        points_target_mm: Sequence[FloatArray],
        pixels: Sequence[FloatArray],
        *,
        size_px: tuple[int, int],
        names: Sequence[str] = (),
    ) -> Observations:
        """From one array of points and one of pixels per view.

        Args:
            points_target_mm: (m_v, 3) each.
            pixels: (m_v, 2) each.
            size_px: columns and rows of the pictures.
            names: of the views; numbered when empty.

        Raises:
            ValueError: no views, or arrays that do not fit together.
        """
        if not len(pixels):
            raise ValueError("there are no views")
        return cls(
            np.concatenate([np.asarray(p, dtype=np.float64) for p in points_target_mm]),
            np.concatenate([np.asarray(p, dtype=np.float64) for p in pixels]),
            np.repeat(np.arange(len(pixels)), [len(p) for p in pixels]),
            tuple(names) or tuple(f"view {i + 1}" for i in range(len(pixels))),
            *size_px,
        )

    @property
    def views(self) -> int:
        """How many views there are."""
        return len(self.names)

    def of_views(self, numbers: Sequence[int] | IntArray) -> Observations:
        """Only these views, renumbered in the order given."""
        wanted = [int(number) for number in numbers]
        rows = [np.flatnonzero(self.view == number) for number in wanted]
        return Observations.from_views(
            [self.points_target_mm[r] for r in rows],
            [self.pixels[r] for r in rows],
            size_px=(self.width_px, self.height_px),
            names=[self.names[number] for number in wanted],
        )

    def of_view(self, number: int) -> tuple[FloatArray, FloatArray]:
        """Points (m_v, 3) and pixels (m_v, 2) of one view."""
        rows = self.view == number
        return self.points_target_mm[rows], self.pixels[rows]

    def planar(self) -> bool:
        """All points of every view have z = 0."""
        return not self.points_target_mm[:, 2].any()
