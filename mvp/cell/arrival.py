"""How far from its target an arm may stand and still count as being there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray

_RAD = 2e-3
_MM = 0.1  # steppers stand on whole steps, often 0.0125 mm apart


def arrival_tolerance(units: Sequence[str]) -> FloatArray:
    """Per axis, (dof,) rad or mm; the clearance asked of a path has to absorb it."""
    return np.array([_RAD if unit == "rad" else _MM for unit in units])
