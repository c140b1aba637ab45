"""The sensor: how many pixels, how large."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sensor:
    """A rectangular array of pixels.

    Attributes:
        width_px: columns.
        height_px: rows.
        pitch_x_mm: distance of two columns.
        pitch_y_mm: distance of two rows.
    """

    width_px: int
    height_px: int
    pitch_x_mm: float
    pitch_y_mm: float

    def __post_init__(self) -> None:
        if self.width_px < 2 or self.height_px < 2:
            raise ValueError("a sensor has at least 2 x 2 pixels")
        if not (self.pitch_x_mm > 0 and self.pitch_y_mm > 0):
            raise ValueError("pixel pitches must be positive")

    @property
    def span_x_mm(self) -> float:
        """First to last column centre (the paper's 383 x 23 um)."""
        return (self.width_px - 1) * self.pitch_x_mm

    @property
    def span_y_mm(self) -> float:
        """First to last row centre (the paper's 479 x 13.5 um)."""
        return (self.height_px - 1) * self.pitch_y_mm

    @property
    def i_min_mm(self) -> float:
        """I_min of the field-of-view constraint: the smaller span, mm."""
        return min(self.span_x_mm, self.span_y_mm)

    @property
    def diagonal_pitch_mm(self) -> float:
        """W of eq. (18): the largest pixel spacing, along the diagonal, mm."""
        return float(np.hypot(self.pitch_x_mm, self.pitch_y_mm))
