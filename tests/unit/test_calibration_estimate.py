"""Least squares with its covariance, on problems whose answer is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import least_squares

from calibration.estimate import FitOptions, fit, out_of_sample
from calibration.verdict import Cause, Limit, judged


@dataclass(frozen=True, eq=False)
class Decay:
    """y = a exp(-b t) + c, whitened by sigma."""

    t: np.ndarray
    y: np.ndarray
    sigma: float
    as_sparse: bool = False
    names = ("a", "b", "c")
    scales = np.ones(3)
    prior_rows = 0

    def residuals(self, state):
        a, b, c = state
        return (a * np.exp(-b * self.t) + c - self.y) / self.sigma

    def jacobian(self, state):
        a, b, _ = state
        e = np.exp(-b * self.t)
        dense = np.stack([e, -a * self.t * e, np.ones_like(e)], 1) / self.sigma
        return sparse.csr_matrix(dense) if self.as_sparse else dense

    def moved(self, state, step):
        return state + step


def decay(rng, *, sigma=0.02, stated=0.02, **options):
    t = np.linspace(0, 4, 60)
    y = 2 * np.exp(-1.3 * t) + 0.5 + rng.normal(0, sigma, t.size)
    return Decay(t, y, stated, **options)


START = np.array([1.0, 0.5, 0.0])


@pytest.mark.parametrize("as_sparse", [False, True])
def test_the_minimum_and_covariance_are_those_of_scipy(as_sparse):
    problem = decay(np.random.default_rng(1), as_sparse=as_sparse)
    found = fit(problem, START)
    theirs = least_squares(problem.residuals, START, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    np.testing.assert_allclose(found.state, theirs.x, rtol=1e-6)
    expected = np.linalg.inv(theirs.jac.T @ theirs.jac)
    np.testing.assert_allclose(found.estimate.covariance, expected, rtol=1e-4)
    assert found.estimate.converged
    assert not found.estimate.inflated


def test_stated_sigma_covers_the_errors():
    rng = np.random.default_rng(5)
    truth = np.array([2, 1.3, 0.5])
    inside = []
    for _ in range(100):
        found = fit(decay(rng), START)
        inside.append(np.abs(found.state - truth) < found.estimate.sigmas)
    assert 0.6 < np.mean(inside) < 0.76


def test_noise_worse_than_stated_shows_and_widens_the_covariance():
    found = fit(decay(np.random.default_rng(2), sigma=0.06), START).estimate
    assert found.probability < 1e-6
    assert found.inflated
    assert found.variance_factor == pytest.approx(9, rel=0.5)


def test_outliers_move_a_robust_fit_little():
    problem = decay(np.random.default_rng(4))
    problem.y[::12] += 1.0
    plain = fit(problem, START).state
    robust = fit(problem, START, FitOptions(huber=2.0))
    truth = np.array([2, 1.3, 0.5])
    assert np.abs(robust.state - truth).max() < 0.3 * np.abs(plain - truth).max()
    assert robust.estimate.weights.min() < 0.1


def test_parameters_that_only_act_together_are_named():
    @dataclass(frozen=True)
    class Sum:
        names = ("left_mm", "right_mm", "other_mm")
        scales = np.ones(3)
        prior_rows = 0

        def residuals(self, state):
            return np.array([state[0] + state[1] - 3, state[2], state[0] * 1e-4, 0.0])

        def jacobian(self, _state):
            return np.array([[1.0, 1, 0], [0, 0, 1], [1e-4, 0, 0], [0, 0, 0]])

        def moved(self, state, step):
            return state + step

    found = fit(Sum(), np.zeros(3)).estimate
    assert found.condition > 1e3
    assert "left_mm" in found.weakest.words
    assert "right_mm" in found.weakest.words
    assert "other_mm" not in found.weakest.words


def test_too_few_residuals_are_refused():
    problem = Decay(np.zeros(2), np.zeros(2), 1.0)
    with pytest.raises(ValueError, match="3 unknowns from 2"):
        fit(problem, START)


def test_every_view_is_held_out_once():
    seen = []

    def errors(train, held):
        assert not set(train) & set(held)
        seen.extend(held)
        return np.zeros(held.size)

    out_of_sample(7, 3, lambda views: views, errors)
    assert sorted(seen) == list(range(7))


def test_a_verdict_is_as_bad_as_its_worst_cause():
    limit = Limit("tilt", "tilt", "deg", 20, 10, "tilt the target", at_least=True)
    assert limit.check(30) == ()
    verdict = judged(
        limit.check(15), limit.check(5), [Cause("x", "marginal", "m", "do")]
    )
    assert verdict.grade == "no-go"
    assert verdict.next_action == "tilt the target"
    assert verdict.reasons[0] == "tilt is 5 deg, below 10 deg"
    assert limit.check(float("nan"))[0].grade == "no-go"
    assert judged().grade == "go"
