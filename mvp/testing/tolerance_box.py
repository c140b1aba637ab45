"""Random errors on the surface of a tolerance box, to try a certificate with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.planning.chance import holds

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.optics import Views
    from mvp.planning import PlanningProblem, ToleranceBox


def scaled_box(box: ToleranceBox, k: float) -> ToleranceBox:
    """All of a box's limits, k times as large."""
    return type(box)(
        k * box.position_mm,
        k * box.angle_rad,
        k * box.d_mm,
        k * box.f_mm,
        k * box.a_mm,
    )


def surface_errors(
    box: ToleranceBox, count: int, rng: np.random.Generator
) -> FloatArray:
    """Errors (count, 9) with every limit of the box reached at once.

    Columns: position (3) mm, rotation vector (3) rad, d, f, a in mm.
    """
    errors = np.zeros((count, 9))
    for part, size in ((slice(0, 3), box.position_mm), (slice(3, 6), box.angle_rad)):
        direction = rng.normal(size=(count, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        errors[:, part] = size * direction
    ends = rng.choice([-1.0, 1.0], size=(count, 3))
    errors[:, 6:] = ends * np.array([box.d_mm, box.f_mm, box.a_mm])
    return errors


def failures_on_surface(
    problem: PlanningProblem, view: Views, box: ToleranceBox, draws: int
) -> int:
    """How many of ``draws`` views with such errors break a requirement."""
    rng = np.random.default_rng(11)
    return int((~holds(problem, view, surface_errors(box, draws, rng))).sum())
