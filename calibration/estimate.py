"""Least squares that says how good its result is.

A problem gives whitened residuals (each divided by its standard deviation) and their
derivatives for small steps of its state, which need not be a vector: ``moved`` applies a
step. The minimum is found by Levenberg-Marquardt on the normal equations, scaled by
their diagonal; a sparse Jacobian (shared intrinsics, one pose per view) keeps its
structure up to the small dense system. Priors are residual rows like any other and come
last, so that they count in the cost but not in the goodness of fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeAlias, TypeVar

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from mvp.geometry import FloatArray

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mvp.geometry import IntArray

State = TypeVar("State")
Jacobian: TypeAlias = FloatArray | sparse.csr_matrix

IMPROBABLE = 1e-3
_FLOOR = 1e-15
_FIRST_DAMPING = 1e-4
_DAMPING_LIMIT = 1e12
_NAMED_SHARE = 0.3


class Problem(Protocol[State]):
    """What ``fit`` needs to know."""

    @property
    def names(self) -> tuple[str, ...]:
        """One name, with its unit, for each component of a step."""

    @property
    def scales(self) -> FloatArray:
        """(n,): steps of these sizes matter equally; used only to name directions."""

    @property
    def prior_rows(self) -> int:
        """How many of the last residuals are priors."""

    def residuals(self, state: State) -> FloatArray:
        """(m,), whitened; not finite where the state makes no sense."""

    def jacobian(self, state: State) -> Jacobian:
        """(m, n): derivative of the residuals for a step at this state."""

    def moved(self, state: State, step: FloatArray) -> State:
        """The state after a step (n,)."""


@dataclass(frozen=True)
class WeakDirection:
    """The combination of parameters that the data determine worst.

    Attributes:
        words: such as "fx_px +3.1 with tz_mm +0.9 (one sigma)".
        step: (n,), one standard deviation along it, in the units of the names.
        sigma: its length in units of the problem's scales.
    """

    words: str
    step: FloatArray
    sigma: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """How good a least-squares result is; pure data.

    Attributes:
        names: one for each row of the covariance.
        covariance: (n, n) of a step at the result, in the units of the names; multiplied
            by the variance factor when the residuals do not fit the assumed noise.
        condition: of the information matrix after scaling its diagonal to 1 (square root:
            as of the Jacobian). Large: parameters cannot be told apart.
        weakest: the worst determined combination.
        residuals: (m,), whitened, without priors.
        chi_square: their sum of squares.
        degrees_of_freedom: residuals (priors included) less parameters.
        probability: of a chi-square at least as large if model and noise are right.
        variance_factor: chi-square by degrees of freedom, priors included.
        inflated: the covariance was multiplied by the variance factor.
        converged: no further step lowers the cost.
        iterations: accepted steps.
        weights: (m,) of a robust fit, 1 where a residual counts in full.
    """

    names: tuple[str, ...]
    covariance: FloatArray
    condition: float
    weakest: WeakDirection
    residuals: FloatArray
    chi_square: float
    degrees_of_freedom: int
    probability: float
    variance_factor: float
    inflated: bool
    converged: bool
    iterations: int
    weights: FloatArray

    @property
    def sigmas(self) -> FloatArray:
        """(n,): one standard deviation of each parameter."""
        return np.sqrt(np.diag(self.covariance))

    def sigma_of(self, name: str) -> float:
        """One standard deviation of a named parameter."""
        return float(self.sigmas[self.names.index(name)])

    def block(self, names: Sequence[str]) -> FloatArray:
        """The covariance of some parameters."""
        index = [self.names.index(name) for name in names]
        return self.covariance[np.ix_(index, index)]


@dataclass(frozen=True, eq=False)
class Fit(Generic[State]):
    """The best state and how good it is."""

    state: State
    estimate: Estimate


@dataclass(frozen=True)
class FitOptions:
    """How a fit is run.

    Attributes:
        huber: residuals beyond this many standard deviations count linearly; None: all
            count as squares.
        noise_known: the standard deviations are facts. Then the covariance is enlarged
            only when the residuals contradict them (probability below 0.1 %); otherwise
            it always takes its scale from the residuals.
        most_steps: give up after so many trial steps.
        tolerance: relative length of the last step, in standard deviations.
    """

    huber: float | None = None
    noise_known: bool = True
    most_steps: int = 200
    tolerance: float = 1e-9


def fit(
    problem: Problem[State], start: State, options: FitOptions | None = None
) -> Fit[State]:
    """The state that minimises the (robust) sum of squared residuals.

    Raises:
        ValueError: the start gives residuals that are not finite, or the problem has
            fewer residuals than parameters.
    """
    options = options or FitOptions()
    residuals = problem.residuals(start)
    if not np.isfinite(residuals).all():
        raise ValueError("the start does not project: a point is behind the camera")
    if residuals.size < len(problem.names):
        raise ValueError(
            f"{len(problem.names)} unknowns from {residuals.size} residuals"
        )
    state, steps, converged = _minimised(problem, start, options)
    estimate = describe(problem, state, options, steps=steps, converged=converged)
    return Fit(state, estimate)


def describe(
    problem: Problem[State],
    state: State,
    options: FitOptions | None = None,
    *,
    steps: int = 0,
    converged: bool = True,
) -> Estimate:
    """How good a state is, taken as the minimum that it should be."""
    options = options or FitOptions()
    residuals = problem.residuals(state)
    weights = _weights(residuals, problem.prior_rows, options.huber)
    information = _information(problem.jacobian(state), weights)
    measured = residuals.size - problem.prior_rows
    chi_square = float((weights[:measured] * residuals[:measured] ** 2).sum())
    freedom = residuals.size - len(problem.names)
    total = float((weights * residuals**2).sum())
    factor = total / freedom if freedom > 0 else 1.0
    probability = float(chi2.sf(total, freedom)) if freedom > 0 else 1.0
    inflated = not options.noise_known or (probability < IMPROBABLE)
    covariance, condition = _inverse(information)
    covariance = covariance * (factor if inflated else 1.0)
    return Estimate(
        problem.names,
        covariance,
        condition,
        weakest_direction(problem.names, covariance, problem.scales),
        residuals[:measured],
        chi_square,
        freedom,
        probability,
        factor,
        inflated,
        converged,
        steps,
        weights[:measured],
    )


def weakest_direction(
    names: tuple[str, ...], covariance: FloatArray, scales: FloatArray
) -> WeakDirection:
    """The direction in which a covariance is longest, measured in ``scales``."""
    values, vectors = np.linalg.eigh(covariance / np.outer(scales, scales))
    direction = vectors[:, -1] * np.sign(vectors[np.abs(vectors[:, -1]).argmax(), -1])
    sigma = float(np.sqrt(max(values[-1], 0.0)))
    step = direction * sigma * scales
    order = np.argsort(-np.abs(direction))
    named = [
        f"{names[index]} {step[index]:+.3g}"
        for index in order[:4]
        if abs(direction[index]) >= _NAMED_SHARE * abs(direction[order[0]])
    ]
    return WeakDirection(" with ".join(named) + " (one sigma)", step, sigma)


def fold_numbers(count: int, folds: int) -> IntArray:
    """The fold (0 .. folds - 1) of each of ``count`` views, dealt like cards.

    Raises:
        ValueError: fewer views than folds, or fewer than two folds.
    """
    if not 2 <= folds <= count:
        raise ValueError(f"{count} views cannot make {folds} folds")
    return np.arange(count) % folds


def out_of_sample(
    count: int,
    folds: int,
    fitted_on: Callable[[IntArray], State],
    errors_of: Callable[[State, IntArray], FloatArray],
) -> FloatArray:
    """Errors on views that took no part in the fit that is tested.

    Args:
        count: number of views.
        folds: number of fits.
        fitted_on: fits on the views of these numbers.
        errors_of: errors (any shape) of a fit on the views of these numbers.

    Returns:
        All errors, in the order of the folds, flat.
    """
    fold = fold_numbers(count, folds)
    views = np.arange(count)
    return np.concatenate(
        [
            errors_of(fitted_on(views[fold != held]), views[fold == held]).ravel()
            for held in range(folds)
        ]
    )


def _minimised(
    problem: Problem[State], state: State, options: FitOptions
) -> tuple[State, int, bool]:
    """Levenberg-Marquardt; returns the state, accepted steps, and whether it ended."""
    damping, accepted = _FIRST_DAMPING, 0
    residuals = problem.residuals(state)
    cost = _cost(residuals, problem.prior_rows, options.huber)
    normal = gradient = None
    for _ in range(options.most_steps):
        if normal is None or gradient is None:
            weights = _weights(residuals, problem.prior_rows, options.huber)
            jacobian = problem.jacobian(state)
            normal = _information(jacobian, weights)
            gradient = np.asarray(jacobian.T @ (weights * residuals)).ravel()
        step = _step(normal, gradient, damping)
        length = max(float(step @ normal @ step), 0.0) ** 0.5
        trial = problem.moved(state, step)
        trial_residuals = problem.residuals(trial)
        trial_cost = _cost(trial_residuals, problem.prior_rows, options.huber)
        if trial_cost <= cost:
            state, residuals, cost, normal = trial, trial_residuals, trial_cost, None
            damping, accepted = max(damping / 10, 1e-12), accepted + 1
        else:
            damping *= 10
        if length < options.tolerance or damping > _DAMPING_LIMIT:
            return state, accepted, True
    return state, accepted, False


def _step(normal: FloatArray, gradient: FloatArray, damping: float) -> FloatArray:
    scale = _column_scale(normal)
    scaled = normal / np.outer(scale, scale) + damping * np.eye(len(normal))
    right = -gradient / scale
    try:
        step = cho_solve(cho_factor(scaled, lower=True), right)
    except np.linalg.LinAlgError:
        step = np.linalg.lstsq(scaled, right, rcond=None)[0]
    return np.asarray(step / scale)


def _information(jacobian: Jacobian, weights: FloatArray) -> FloatArray:
    if isinstance(jacobian, np.ndarray):
        return np.asarray(jacobian.T @ (jacobian * weights[:, None]))
    weighted = sparse.csr_matrix(jacobian).multiply(weights[:, None])
    return np.asarray((weighted.T @ jacobian).toarray())


def _inverse(information: FloatArray) -> tuple[FloatArray, float]:
    """Covariance and condition; an undetermined direction gets a huge variance."""
    scale = _column_scale(information)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    values = np.maximum(values, _FLOOR * values[-1])
    covariance = (vectors / values) @ vectors.T / np.outer(scale, scale)
    return covariance, float(np.sqrt(values[-1] / values[0]))


def _column_scale(information: FloatArray) -> FloatArray:
    scale = np.sqrt(np.diag(information))
    return np.where(scale > 0, scale, 1.0)


def _weights(residuals: FloatArray, prior_rows: int, huber: float | None) -> FloatArray:
    weights = np.ones_like(residuals)
    if huber is not None:
        weights = huber / np.maximum(np.abs(residuals), huber)
        weights[residuals.size - prior_rows :] = 1.0
    return weights


def _cost(residuals: FloatArray, prior_rows: int, huber: float | None) -> float:
    if not np.isfinite(residuals).all():
        return float("inf")
    squares = residuals**2
    if huber is not None:
        size = np.abs(residuals)
        robust = np.where(size > huber, 2 * huber * size - huber**2, squares)
        measured = residuals.size - prior_rows
        squares = np.concatenate([robust[:measured], squares[measured:]])
    return float(squares.sum())
