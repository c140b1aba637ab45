"""What a small error costs: loss of the smallest index, in standard deviations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints import SHIFT, TURN
from mvp.constraints.base import A, D, F
from mvp.planning.rows import RowTable

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.optics import Views
    from mvp.planning.problem import PlanningProblem

_STEPS: dict[str, tuple[slice, float]] = {
    "position_1_mm": (SHIFT, 1.0),
    "angle_1_deg": (TURN, float(np.deg2rad(1.0))),
    "d_10_um": (slice(D, D + 1), 0.010),
    "f_10_um": (slice(F, F + 1), 0.010),
    "a_10_um": (slice(A, A + 1), 0.010),
}


def sensitivity(problem: PlanningProblem, view: Views) -> dict[str, float]:
    """Loss of the smallest index by 1 mm, 1 deg and 10 um in the worst direction.

    First order in the error; a row that is not the smallest now but loses faster is
    counted. All values are >= 0.
    """
    table = RowTable.of(problem)
    rows = table.evaluate(view)
    soft = ~table.hard
    index = rows.index[0, soft]
    slope = rows.gradient[0, soft] / np.maximum(rows.scale[0, soft, None], 1e-9)
    return {
        name: _loss(index, np.linalg.norm(slope[:, part], axis=1) * step)
        for name, (part, step) in _STEPS.items()
    }


def _loss(index: FloatArray, worst_step: FloatArray) -> float:
    return float(index.min() - (index - worst_step).min())
