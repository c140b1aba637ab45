"""How well views cover the picture, the tilts and the distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from calibration.observations import Observations
    from calibration.poses import Poses
    from mvp.geometry import FloatArray, IntArray

ROWS, COLUMNS = 6, 8
_TILT_WANTED_RAD = np.radians(20.0)
_SIZES_WANTED = 1.4


@dataclass(frozen=True, eq=False)
class Coverage:
    """Points by field of the picture, and shares of what is wanted, by name.

    Attributes:
        counts: (ROWS, COLUMNS).
        bars: name and share 0 .. 1: of the fields, of those at the border, of the tilts
            both ways about both axes of the picture, of the range of sizes.
    """

    counts: IntArray
    bars: tuple[tuple[str, float], ...]

    @property
    def grid(self) -> tuple[tuple[int, ...], ...]:
        """The counts, as a step shows them."""
        return tuple(tuple(int(n) for n in row) for row in self.counts)

    @property
    def share(self) -> float:
        """Of the fields that hold a point."""
        return float((self.counts > 0).mean())


def fields_of(pixels: FloatArray, size_px: tuple[int, int]) -> IntArray:
    """Row and column (m, 2) of the field of each point (m, 2)."""
    shares = (pixels[:, ::-1] + 0.5) / np.array(size_px[::-1])
    counts = np.array([ROWS, COLUMNS])
    return np.asarray(np.clip(np.floor(shares * counts), 0, counts - 1), np.int64)


def counts_of(pixels: FloatArray, size_px: tuple[int, int]) -> IntArray:
    """Points (m, 2) in each field (ROWS, COLUMNS)."""
    found = np.zeros((ROWS, COLUMNS), np.int64)
    np.add.at(found, tuple(fields_of(pixels, size_px).T), 1)
    return found


def coverage(seen: Observations, camera_from_target: Poses) -> Coverage:
    """Of views whose poses are known well enough to tell tilt and distance."""
    counts = counts_of(seen.pixels, (seen.width_px, seen.height_px))
    border = np.ones_like(counts, dtype=np.bool_)
    border[1:-1, 1:-1] = False
    normal = camera_from_target.rotation[:, :, 2]
    about_x = np.arctan2(-normal[:, 1], normal[:, 2])
    about_y = np.arctan2(normal[:, 0], normal[:, 2])
    sizes = 1 / camera_from_target.translation_mm[:, 2]
    bars = (
        ("picture", float((counts > 0).mean())),
        ("border", float((counts[border] > 0).mean())),
        ("tilt about x", _both_ways(about_x)),
        ("tilt about y", _both_ways(about_y)),
        ("sizes", _range(sizes)),
    )
    return Coverage(counts, bars)


def _both_ways(tilts_rad: FloatArray) -> float:
    """Share of the wanted tilt, mean of both directions."""
    ends = np.array([tilts_rad.max(initial=0.0), -tilts_rad.min(initial=0.0)])
    return float(np.clip(ends / _TILT_WANTED_RAD, 0, 1).mean())


def _range(sizes: FloatArray) -> float:
    if len(sizes) < 2:
        return 0.0
    ratio = float(sizes.max() / sizes.min())
    return float(np.clip(np.log(ratio) / np.log(_SIZES_WANTED), 0, 1))
