"""Small dense linear programmes: maximise cost . x with rows x >= low, x in a box.

One HiGHS instance is kept and reused (0.3 ms a solve); without ``highspy``
scipy's front end to the same solver does it, ten times slower.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mvp.geometry import FloatArray


@dataclass(frozen=True, eq=False)
class Programme:
    """Maximise ``cost . x`` with ``rows x >= rows_low`` and ``low <= x <= high``.

    Attributes:
        cost: (n,).
        rows: (m, n).
        rows_low: (m,).
        low: (n,).
        high: (n,).
    """

    cost: FloatArray
    rows: FloatArray
    rows_low: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """x (n,), duals of the rows (m,) and of the box (n,); all duals of rows >= 0."""

    x: FloatArray
    row_duals: FloatArray
    box_duals: FloatArray


class LinearSolver(Protocol):
    """Solves one programme after the other."""

    def maximise(self, programme: Programme) -> LinearSolution | None:
        """The optimum, or None when there is none."""
        ...


@cache
def _dense_pattern(
    count: int, width: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Row starts and column numbers of a full matrix stored by rows."""
    columns = np.tile(np.arange(width, dtype=np.int32), count)
    return np.arange(count + 1, dtype=np.int32) * width, columns


class HighsSolver:
    """HiGHS through its own bindings."""

    def __init__(self) -> None:
        import highspy

        self._highs = highspy
        self._solver = highspy.Highs()
        self._solver.setOptionValue("output_flag", False)
        self._solver.setOptionValue("presolve", "off")
        self._solver.setOptionValue("threads", 1)

    def maximise(self, programme: Programme) -> LinearSolution | None:
        """See the protocol."""
        count, width = programme.rows.shape
        highs = self._highs
        model = highs.HighsLp()
        model.num_col_, model.num_row_ = width, count
        model.col_cost_ = -programme.cost
        model.col_lower_, model.col_upper_ = programme.low, programme.high
        model.row_lower_ = programme.rows_low
        model.row_upper_ = np.full(count, highs.kHighsInf)
        matrix = model.a_matrix_
        matrix.format_ = highs.MatrixFormat.kRowwise
        matrix.start_, matrix.index_ = _dense_pattern(count, width)
        matrix.value_ = programme.rows.ravel()
        self._solver.passModel(model)
        self._solver.run()
        if self._solver.getModelStatus() != highs.HighsModelStatus.kOptimal:
            return None
        solution = self._solver.getSolution()
        return LinearSolution(
            np.array(solution.col_value),
            np.array(solution.row_dual),
            np.array(solution.col_dual),
        )


class ScipySolver:
    """``scipy.optimize.linprog``."""

    def maximise(self, programme: Programme) -> LinearSolution | None:
        """See the protocol."""
        from scipy.optimize import linprog

        result = linprog(
            -programme.cost,
            A_ub=-programme.rows,
            b_ub=-programme.rows_low,
            bounds=np.column_stack([programme.low, programme.high]),
            method="highs",
        )
        if result.status != 0:
            return None
        box = result.lower.marginals + result.upper.marginals
        return LinearSolution(result.x, -result.ineqlin.marginals, box)


def linear_solver() -> LinearSolver:
    """The fastest one installed."""
    return HighsSolver() if find_spec("highspy") else ScipySolver()
