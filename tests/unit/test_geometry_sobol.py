"""Evenly spread points, beside those of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from mvp.geometry import sobol_points


@pytest.mark.parametrize("dimensions", range(1, 7))
def test_points_are_scipys_to_the_last_digit(dimensions: int) -> None:
    theirs = qmc.Sobol(dimensions, scramble=False).random(4096)
    assert np.array_equal(sobol_points(dimensions, 4096), theirs)


def test_every_power_of_two_has_one_point_in_every_slice() -> None:
    points = sobol_points(6, 256)
    assert np.array_equal(
        np.sort(points, axis=0), np.tile(np.arange(256)[:, None] / 256, (1, 6))
    )


def test_no_points_are_none_and_a_seventh_dimension_is_refused() -> None:
    assert sobol_points(3, 0).shape == (0, 3)
    with pytest.raises(ValueError, match="7 dimensions"):
        sobol_points(7, 8)
