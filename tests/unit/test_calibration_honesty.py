"""Every estimator against the bound of its own model: spread, and stated sigmas."""

from __future__ import annotations

import numpy as np
import pytest

from tools.bench_calibration_honesty import ESTIMATORS, spread_and_share


@pytest.mark.full
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", ESTIMATORS)
def test_errors_are_as_large_as_stated_and_no_larger_than_the_bound_allows(name):
    spread, share = spread_and_share(*ESTIMATORS[name])
    assert spread <= 1.15
    assert 0.55 <= share <= 0.80


def test_the_measure_itself_is_one_for_errors_as_stated():
    covariance = np.array([[4.0, 1.9], [1.9, 1.0]])

    def drawn(rng):
        return rng.multivariate_normal(np.zeros(2), covariance), covariance

    spread, share = spread_and_share(400, drawn)
    assert spread == pytest.approx(1.0, abs=0.08)
    assert share == pytest.approx(0.683, abs=0.05)
