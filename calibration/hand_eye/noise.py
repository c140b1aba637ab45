"""The refinement together with an honest idea of the noise.

The slack of the views, freed from what the fit took out of it, says how noisy the robot
really is; likewise the pixels. Both are estimated with the transform (variance
components), so that the covariance is neither a wish of the datasheet nor as wide as a
cautious prior. What was stated counts as a fifth of an observation: it decides where the
views say nothing and is outvoted where they do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.estimate import FitOptions, fit

if TYPE_CHECKING:
    from calibration.estimate import Fit
    from calibration.hand_eye.refine import Chain, HandEyeProblem
    from mvp.geometry import FloatArray

_ROUNDS = 10
_STATED_WEIGHT = 0.2
_SETTLED = 0.02
_LEAST_SHARE = 1e-3
_FIT = FitOptions(most_steps=60, tolerance=1e-5)


@dataclass(frozen=True, eq=False)
class Refined:
    """The refinement and the noise that it found.

    Attributes:
        fit: the state and its covariance, with the noise below.
        problem: what was fitted, with the noise below.
        sigma_px: of each coordinate.
        robot_sigmas: (2,) of the robot: position (mm), angle (rad), on each axis.
        freedom: (2,), independent facts about the robot's noise that the views gave.
    """

    fit: Fit[Chain]
    problem: HandEyeProblem
    sigma_px: float
    robot_sigmas: FloatArray
    freedom: FloatArray


def refine(problem: HandEyeProblem, start: Chain) -> Refined:
    """Fit, estimate the noise, fit again until the noise stays.

    Raises:
        ValueError: the start puts a point behind the camera.
    """
    stated = problem
    for _ in range(_ROUNDS):
        found = fit(problem, start, _FIT)
        squares, freedom = _components(problem, found)
        sigmas = _sigmas(problem)
        wanted = np.sqrt(
            (_STATED_WEIGHT * _sigmas(stated) ** 2 + squares * sigmas**2)
            / (_STATED_WEIGHT + freedom)
        ).clip(_LEAST_SHARE * _sigmas(stated))
        if np.abs(np.log(wanted / sigmas)).max() < _SETTLED:
            break
        problem = problem.with_noise(float(wanted[0]), np.repeat(wanted[1:], 3))
        start = found.state
    return Refined(found, problem, float(sigmas[0]), sigmas[1:], freedom[1:])


def _sigmas(problem: HandEyeProblem) -> FloatArray:
    """(3,): of pixels, of the robot's translation and of its rotation."""
    return np.array([problem.data.sigma_px, *problem.slack_sigmas[[0, 3]]])


def _components(
    problem: HandEyeProblem, found: Fit[Chain]
) -> tuple[FloatArray, FloatArray]:
    """Whitened squares of pixels, slack translation and rotation; their freedom."""
    estimate = found.estimate
    covariance = np.diag(estimate.covariance) / (
        estimate.variance_factor if estimate.inflated else 1.0
    )
    residuals = problem.residuals(found.state)
    views = len(problem.data.base_from_tool)
    slack = residuals[-6 * views :].reshape(views, 2, 3)
    taken = covariance[-6 * views :].reshape(views, 2, 3)
    taken = taken / problem.slack_sigmas.reshape(2, 3) ** 2
    free_slack = 3 * views - taken.sum(axis=(0, 2))
    pixels = estimate.residuals
    free_pixels = pixels.size - (len(estimate.names) - taken.sum())
    squares = np.array([(pixels**2).sum(), *(slack**2).sum(axis=(0, 2))])
    return squares, np.array([free_pixels, *free_slack]).clip(0)
