"""Put labels beside their anchors so that none covers another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray

_DIRECTIONS = np.deg2rad(np.arange(0, 360, 30))
_REACHES = (1.1, 1.9, 3.0, 4.5, 6.5)


@dataclass(frozen=True, eq=False)
class Label:
    """A text and the point (2,) that it names, in drawing units."""

    text: str
    anchor: FloatArray
    colour: str


def placed(
    labels: list[Label],
    *,
    width_per_letter: float,
    height: float,
    low: FloatArray,
    high: FloatArray,
) -> list[FloatArray | None]:
    """A centre (2,) for each label, nearest free place first, None where there is none.

    Args:
        labels: the most important first.
        width_per_letter: width of a letter, drawing units.
        height: height of a line, drawing units.
        low: (2,) lower left corner of the drawing.
        high: (2,) upper right corner.
    """
    taken = np.zeros((0, 4))
    centres: list[FloatArray | None] = []
    anchors = np.array([label.anchor for label in labels]).reshape(-1, 2)
    for label in labels:
        half = np.array([width_per_letter * (len(label.text) + 0.6), height * 1.15]) / 2
        candidates = _candidates(label.anchor, half)
        free = _free(candidates, half, taken, anchors, low, high)
        if not free.any():
            centres.append(None)
            continue
        centre = candidates[int(np.argmax(free))]
        centres.append(centre)
        taken = np.vstack([taken, [*(centre - half), *(centre + half)]])
    return centres


def _candidates(anchor: FloatArray, half: FloatArray) -> FloatArray:
    """Places (n, 2) round an anchor, near ones first."""
    ring = np.stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)], axis=1)
    steps = [ring * (half + reach * half[1]) for reach in _REACHES]
    return np.asarray(anchor + np.concatenate(steps))


def _free(
    centres: FloatArray,
    half: FloatArray,
    taken: FloatArray,
    anchors: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> BoolArray:
    """Which places (n,) are inside the drawing and cover no label and no anchor."""
    inside = ((centres - half >= low) & (centres + half <= high)).all(axis=1)
    overlap = (centres[:, None] - half < taken[:, 2:]) & (
        centres[:, None] + half > taken[:, :2]
    )
    covers = np.abs(centres[:, None] - anchors) < 0.8 * half
    hidden = np.all(overlap, axis=2).any(axis=1) | np.all(covers, axis=2).any(axis=1)
    return np.asarray(inside & ~hidden)
