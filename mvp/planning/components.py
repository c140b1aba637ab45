"""Which disconnected piece of the visibility region a view lies in."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.constraints import Visibility
from mvp.visibility import Region

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.planning.problem import PlanningProblem

_MOST = 50


def component_numbers(
    problem: PlanningProblem, positions_mm: FloatArray
) -> list[int | None]:
    """Piece number (from 1, largest first) of every position (N, 3).

    None where the region is in one piece, or a position lies outside, or the region
    has more than 50 pieces.
    """
    numbers: list[int | None] = [None] * len(positions_mm)
    for constraint in problem.constraints:
        region = constraint.region if isinstance(constraint, Visibility) else None
        if not isinstance(region, Region) or region.empty:
            continue
        pieces = region.solid.decompose()
        if not 1 < len(pieces) <= _MOST:
            continue
        pieces.sort(key=lambda piece: -piece.volume())
        for number, piece in enumerate(pieces, start=1):
            inside = replace(region, solid=piece).contains(positions_mm)
            for k in np.flatnonzero(inside):
                numbers[int(k)] = number
    return numbers
