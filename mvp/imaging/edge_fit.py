"""Least squares of a blurred step on raw pixels, by variable projection.

The grey of a sample is B lo (1 - E) + B hi E (+ shading), E the edge spread function
at t - H p. Levels are linear and projected out (Kaufman's form of variable
projection), place p and blur q = b^2 are found by damped Gauss-Newton steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.esf import BLUR_MAX_PX, Optics, SpreadValues, spread_at

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray

_ITERATIONS = 14
_LARGEST_STEP_PX = 1.5
_Q_LOW = -1.5
_RIDGE = 1e-10
_NEGLIGIBLE = 1e-6


@dataclass(frozen=True, eq=False)
class StepSamples:
    """Pixels near one edge.

    Attributes:
        t_px: (n,) signed distance from the reference curve.
        shape: (n, K) how each place parameter moves the edge at this pixel.
        levels: (n, L) basis of each of the two levels along the edge.
        grey: (n,) fractions of full scale.
        bins: (n,) orientation index of the spread tables.
    """

    t_px: FloatArray
    shape: FloatArray
    levels: FloatArray
    grey: FloatArray
    bins: IntArray

    def only(self, keep: FloatArray) -> StepSamples:
        """The samples named by a mask or by indices."""
        return StepSamples(
            self.t_px[keep],
            self.shape[keep],
            self.levels[keep],
            self.grey[keep],
            self.bins[keep],
        )


@dataclass(frozen=True, eq=False)
class StepFit:
    """Result of one fit.

    Attributes:
        place: (K,) place parameters, px.
        q_px2: square of the blur diameter, may be slightly negative.
        covariance: (K + 1, K + 1) of place and q.
        low, high: (L,) coefficients of the two levels.
        noise: residual standard deviation, fraction of full scale.
        residual: (n,).
        spread: the spread function at the solution.
        converged: the last step was negligible.
    """

    place: FloatArray
    q_px2: float
    covariance: FloatArray
    low: FloatArray
    high: FloatArray
    noise: float
    residual: FloatArray
    spread: SpreadValues
    converged: bool


@dataclass(frozen=True, eq=False)
class _State:
    place: FloatArray
    q_px2: float
    cost: float
    columns: FloatArray
    linear: FloatArray
    residual: FloatArray
    spread: SpreadValues


def fit_step(
    samples: StepSamples,
    optics: Optics,
    *,
    place: FloatArray,
    q_px2: float,
    shading: bool,
) -> StepFit:
    """Fit place, blur and levels from a start within about one spread.

    Args:
        samples: at least a few more pixels than unknowns.
        optics: pixel aperture and diffraction.
        place: (K,) start, px.
        q_px2: start of the squared blur diameter.
        shading: free slopes across the edge on both sides.
    """
    state = _state(samples, optics, place, q_px2, shading)
    damping, converged = 1e-3, False
    for _ in range(_ITERATIONS):
        jacobian = _projected_jacobian(samples, state)
        step = _damped(jacobian, state.residual, damping)
        trial = _state(
            samples, optics, state.place + step[:-1], _bounded(state, step), shading
        )
        small = bool(np.abs(step).max() < 1e-4)
        if trial.cost <= state.cost:
            small |= state.cost - trial.cost < _NEGLIGIBLE * state.cost
            state, damping = trial, max(damping / 10, 1e-7)
            if small:
                converged = True
                break
        else:
            damping *= 10
            if small or damping > 1e6:
                converged = small
                break
    return _result(samples, state, converged)


def _bounded(state: _State, step: FloatArray) -> float:
    return float(np.clip(state.q_px2 + step[-1], _Q_LOW, (BLUR_MAX_PX - 0.2) ** 2))


def _state(
    samples: StepSamples,
    optics: Optics,
    place: FloatArray,
    q_px2: float,
    shading: bool,
) -> _State:
    spread = spread_at(
        optics, samples.t_px - samples.shape @ place, q_px2, samples.bins
    )
    edge = spread.edge[:, None]
    parts = [samples.levels * (1 - edge), samples.levels * edge]
    if shading:
        across = samples.t_px[:, None] / 5.0
        parts += [across * (1 - edge), across * edge]
    columns = np.concatenate(parts, axis=1)
    gram = columns.T @ columns
    gram.flat[:: len(gram) + 1] += _RIDGE * len(columns)
    linear = np.linalg.solve(gram, columns.T @ samples.grey)
    residual = np.asarray(samples.grey - columns @ linear, np.float64)
    cost = float(residual @ residual)
    return _State(
        place, q_px2, cost, columns, np.asarray(linear, np.float64), residual, spread
    )


def _contrast(samples: StepSamples, state: _State) -> FloatArray:
    """Local height of the step at every sample, (n,)."""
    count = samples.levels.shape[1]
    difference = state.linear[count : 2 * count] - state.linear[:count]
    contrast = samples.levels @ difference
    if len(state.linear) > 2 * count:
        slope = state.linear[2 * count + 1] - state.linear[2 * count]
        contrast = contrast + samples.t_px / 5.0 * slope
    return np.asarray(contrast)


def _projected_jacobian(samples: StepSamples, state: _State) -> FloatArray:
    contrast = _contrast(samples, state)
    by_place = -(contrast * state.spread.by_t)[:, None] * samples.shape
    by_q = (contrast * state.spread.by_q)[:, None]
    jacobian = np.concatenate([by_place, by_q], axis=1)
    gram = state.columns.T @ state.columns
    gram.flat[:: len(gram) + 1] += _RIDGE * len(jacobian)
    inside = np.linalg.solve(gram, state.columns.T @ jacobian)
    return np.asarray(jacobian - state.columns @ inside)


def _damped(jacobian: FloatArray, residual: FloatArray, damping: float) -> FloatArray:
    gram = jacobian.T @ jacobian
    scale = np.maximum(np.diag(gram), 1e-12)
    step = np.linalg.solve(gram + np.diag(damping * scale), jacobian.T @ residual)
    limit = _LARGEST_STEP_PX / max(float(np.abs(step[:-1]).max()), _LARGEST_STEP_PX)
    step = step * limit
    # One step may not jump across blurs: the model is far from linear in q there.
    step[-1] = np.clip(step[-1], -20.0, 20.0)
    return np.asarray(step)


def _result(samples: StepSamples, state: _State, converged: bool) -> StepFit:
    count = samples.levels.shape[1]
    jacobian = _projected_jacobian(samples, state)
    unknowns = state.columns.shape[1] + jacobian.shape[1]
    freedom = max(len(samples.grey) - unknowns, 1)
    variance = state.cost / freedom
    gram = jacobian.T @ jacobian
    gram.flat[:: len(gram) + 1] += 1e-12
    return StepFit(
        place=state.place,
        q_px2=state.q_px2,
        covariance=variance * np.linalg.inv(gram),
        low=state.linear[:count],
        high=state.linear[count : 2 * count],
        noise=float(np.sqrt(variance)),
        residual=state.residual,
        spread=state.spread,
        converged=converged,
    )


def rescaled(fit: StepFit, noise: float) -> StepFit:
    """The same fit with its covariance for at least this noise."""
    if fit.noise >= noise or fit.noise <= 0:
        return fit
    return replace(fit, covariance=fit.covariance * (noise / fit.noise) ** 2)
