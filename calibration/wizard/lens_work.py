"""What a lens table is worth on the work: its errors in mm at the working distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.optics import principal_distance_mm

if TYPE_CHECKING:
    from calibration.lens_table import LensTables
    from mvp.wizard import SessionFacts

_NORMAL_95 = 1.96


@dataclass(frozen=True)
class OnTheWork:
    """Errors of a lens table, in words and mm.

    Attributes:
        distance_mm: from the entrance pupil.
        across_95_mm: of a point in the corner of the picture, by d alone (95 %).
        along_95_mm: of the sharp distance, likewise.
    """

    distance_mm: float
    across_95_mm: float
    along_95_mm: float

    @property
    def words(self) -> str:
        """One line for a person."""
        return (
            f"at {self.distance_mm:.0f} mm a point in the corner of the picture is known "
            f"to {self.across_95_mm:.3f} mm, and the sharp distance to "
            f"{self.along_95_mm:.1f} mm (95 %)"
        )


def working_mm(facts: SessionFacts, tables: LensTables) -> float:
    """The working distance; where none is stated, the middle of the nodes' sharp ones."""
    _, distances, _ = tables.fit.seen.measured("sharp_mm")
    return facts.working_mm or float(np.median(distances))


def on_the_work(facts: SessionFacts, tables: LensTables) -> OnTheWork:
    """At the worst node; the sharp distance at the node that is sharp nearest to it.

    One sigma of d is that of the node and that of the curves where a node was left out.
    A change of d by s moves a point at height h by h s / f_cal, and the sharp distance
    by s / m^2.
    """
    fit, distance = tables.fit, working_mm(facts, tables)
    f = fit.f_mm[fit.seen.zoom_of]
    f_cal = principal_distance_mm(fit.d_mm, f, fit.e_of_node_mm)
    sigma = np.hypot(fit.d_sigma_mm, left_out_mm(tables))
    index, sharp, _ = fit.seen.measured("sharp_mm")
    near = index[np.abs(sharp - distance).argmin()]
    sensor = facts.sensor
    half_mm = np.array(
        [sensor.width_px * sensor.pitch_x_mm, sensor.height_px * sensor.pitch_y_mm]
    )
    corner_mm = np.linalg.norm(half_mm / 2) / f_cal * distance
    along = sigma[near] * (f[near] / (fit.d_mm[near] - f[near])) ** 2
    return OnTheWork(
        distance,
        _NORMAL_95 * float((corner_mm * sigma / f_cal).max()),
        _NORMAL_95 * float(along),
    )


def left_out_mm(tables: LensTables) -> float:
    """Error of the curves of f and x at nodes that were left out."""
    squares = [
        float(np.mean(curve.left_out_mm**2))
        for name, curve in tables.curves.items()
        if name != "iris" and len(curve.left_out_mm)
    ]
    return float(np.sqrt(sum(squares)))
