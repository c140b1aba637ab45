"""Evenly spread points of the unit cube: Sobol's sequence, not scrambled.

Direction numbers of S. Joe and F. Y. Kuo, "Constructing Sobol sequences with better
two-dimensional projections", 2008. SciPy has the same points, to the last digit, but
brings all of its statistics along, which takes half a second to import.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry.arrays import FloatArray, IntArray

_BITS = 30
# Inner coefficients of a primitive polynomial, one bit each, and the first numbers.
_POLYNOMIALS = (
    (0, (1,)),
    (1, (1, 3)),
    (1, (1, 3, 1)),
    (2, (1, 1, 1)),
    (1, (1, 1, 3, 3)),
)
MOST_DIMENSIONS = len(_POLYNOMIALS) + 1


def sobol_points(dimensions: int, count: int) -> FloatArray:
    """The first points (count, dimensions) of the sequence, in [0, 1).

    Raises:
        ValueError: more dimensions than there are direction numbers, or more points.
    """
    if not 1 <= dimensions <= MOST_DIMENSIONS or not 0 <= count <= 1 << _BITS:
        raise ValueError(f"no {count} points of {dimensions} dimensions")
    number = np.arange(count)
    gray = number ^ (number >> 1)
    found = np.zeros((count, dimensions), dtype=np.int64)
    for bit, directions in enumerate(_directions()[:, :dimensions]):
        found ^= (gray >> bit & 1)[:, None] * directions
    return np.asarray(found * 2.0**-_BITS)


@lru_cache(maxsize=1)
def _directions() -> IntArray:
    """(bits, dimensions) what every bit of the Gray code adds, without carry."""
    columns = [[1] * _BITS]
    for inner, first in _POLYNOMIALS:
        numbers, degree = list(first), len(first)
        for _ in range(_BITS - degree):
            new = numbers[-degree] ^ numbers[-degree] << degree
            for back in range(1, degree):
                new ^= (inner >> (degree - 1 - back) & 1) * numbers[-back] << back
            numbers.append(new)
        columns.append(numbers)
    shift = np.arange(_BITS - 1, -1, -1)
    return np.array(columns, dtype=np.int64).T << shift[:, None]
