"""What the zoom changes of a camera beside its focal length: curves over zoom steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from mvp.calibrated import ZoomTable
    from mvp.geometry import FloatArray


@dataclass(frozen=True)
class ZoomOptics:
    """At one zoom.

    Attributes:
        pupil_offset_mm: e; None: as at every zoom.
        focus_shift_mm: what the extension is more than the focus axis says.
        centre_px: principal point; None: the camera's own.
        k1: OpenCV's; None: the camera's own.
        pupil_shift_mm: how far the entrance pupil stands towards the object beyond what
            d says, from the origin of the table.
    """

    pupil_offset_mm: float | None = None
    focus_shift_mm: float = 0.0
    centre_px: tuple[float, float] | None = None
    k1: float | None = None
    pupil_shift_mm: float = 0.0


@dataclass(frozen=True, eq=False)
class ZoomCurves:
    """Monotone cubics between the nodes, the nearest end beyond them.

    Attributes:
        steps: (k,) of the zoom, rising.
        values: (k,) by the names of ``ZoomTable``; only what changes.
    """

    steps: FloatArray
    values: Mapping[str, FloatArray]

    @classmethod
    def from_table(cls, table: ZoomTable) -> ZoomCurves:
        """From the calibration file's model."""
        values = {name: np.array(listed) for name, listed in table.lists.items()}
        return cls(np.array(table.steps, np.float64), values)

    def value(self, name: str, steps: ArrayLike) -> FloatArray | None:
        """One quantity at steps (also fractions); None when it does not change."""
        known = self.values.get(name)
        if known is None:
            return None
        asked = np.clip(np.asarray(steps, np.float64), self.steps[0], self.steps[-1])
        if len(self.steps) == 1:
            return np.full(asked.shape, known[0])
        from scipy.interpolate import PchipInterpolator

        return np.asarray(PchipInterpolator(self.steps, known)(asked))

    def at(self, steps: float) -> ZoomOptics:
        """All of them at one zoom."""

        def one(name: str) -> float | None:
            found = self.value(name, steps)
            return None if found is None else float(found)

        across, down = one("centre_x_px"), one("centre_y_px")
        return ZoomOptics(
            one("pupil_offset_mm"),
            one("focus_shift_mm") or 0.0,
            None if across is None or down is None else (across, down),
            one("k1"),
            one("pupil_shift_mm") or 0.0,
        )
