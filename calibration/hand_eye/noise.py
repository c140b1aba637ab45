"""The refinement together with an honest idea of the noise.

The slack of the views, freed from what the fit took out of it, says how noisy the robot
really is; likewise the pixels. Both are estimated with the transform (variance
components), so that the covariance is neither a wish of the datasheet nor as wide as a
cautious prior. What was stated of the pixels counts as a fifth of an observation. What
was stated of the robot is where a gamma density of shape 2 has its peak: it decides where
the views say nothing, is outvoted where they do, and keeps a robot that errs less than
the pictures can show from being taken for one that does not err at all, without making it
out to be much worse than them.
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

_ROUNDS = 6
_STEPS = 100
_STATED_WEIGHT = 0.2
_SETTLED, _STILL = 0.02, 0.002
_LEAST_SHARE = 1e-3
_MOST_CHANGE = float(np.log(4))
_OVER = 1.5
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
    stated = _sigmas(problem)
    for _ in range(_ROUNDS):
        found = fit(problem, start, _FIT)
        sigmas = _sigmas(problem)
        wanted, freedom = _Near.of(problem, found.state).settled(sigmas, stated)
        if np.abs(np.log(wanted / sigmas)).max() < _SETTLED:
            break
        problem = problem.with_noise(float(wanted[0]), np.repeat(wanted[1:], 3))
        start = found.state
    return Refined(found, problem, float(sigmas[0]), sigmas[1:], freedom[1:])


def _sigmas(problem: HandEyeProblem) -> FloatArray:
    """(3,): of pixels, of the robot's translation and of its rotation."""
    return np.array([problem.data.sigma_px, *problem.slack_sigmas[[0, 3]]])


@dataclass(frozen=True, eq=False)
class _Near:
    """The problem as it is near a state: linear, for any noise of pixels and robot.

    Attributes:
        pixels: (n, n), (n,) and number: squares of the pixels' residuals (px) as a
            quadratic form of a step: matrix, slope, value.
        prior: (n, n) and (n,): information of the camera's prior, and its slope.
        slack: (6 views,), of the state, mm and rad.
        count: of pixel residuals.
    """

    pixels: tuple[FloatArray, FloatArray, float]
    prior: tuple[FloatArray, FloatArray]
    slack: FloatArray
    count: int

    @classmethod
    def of(cls, problem: HandEyeProblem, state: Chain) -> _Near:
        """At a state."""
        residuals, jacobian = problem.residuals(state), problem.jacobian(state)
        count = len(residuals) - problem.prior_rows
        sigma = problem.data.sigma_px
        seen, rest = jacobian[:count] * sigma, residuals[:count] * sigma
        views = 6 * len(problem.data.base_from_tool)
        held, off = jacobian[count:-views], residuals[count:-views]
        return cls(
            ((seen.T @ seen).toarray(), seen.T @ rest, float(rest @ rest)),
            ((held.T @ held).toarray(), held.T @ off),
            residuals[-views:] * np.tile(problem.slack_sigmas, views // 6),
            count,
        )

    def settled(
        self, sigmas: FloatArray, stated: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(3,) the noise that explains what is left over, and its freedom (3,)."""
        freedom = np.zeros(3)
        for _ in range(_STEPS):
            squares, freedom = self._components(sigmas)
            change = np.log(_most_likely(squares, freedom, stated) / sigmas)
            change = np.clip(_OVER * change, -_MOST_CHANGE, _MOST_CHANGE)
            sigmas = np.maximum(sigmas * np.exp(change), _LEAST_SHARE * stated)
            if np.abs(change).max() < _STILL:
                break
        return sigmas, freedom

    def _components(self, sigmas: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Squares of pixels (px2), slack translation and rotation; their freedom."""
        matrix, slope, value = self.pixels
        held, pull = self.prior
        own = np.tile(np.repeat(sigmas[1:] ** -2, 3), len(self.slack) // 6)
        information = matrix / sigmas[0] ** 2 + held
        gradient = slope / sigmas[0] ** 2 + pull
        last = np.arange(len(gradient) - len(own), len(gradient))
        information[last, last] += own
        gradient[last] += own * self.slack
        scale = 1 / np.sqrt(np.diag(information))
        covariance = np.linalg.pinv(
            information * np.outer(scale, scale), hermitian=True
        )
        covariance *= np.outer(scale, scale)
        step = -covariance @ gradient
        slack = (self.slack + step[last]).reshape(-1, 2, 3)
        taken = (np.diag(covariance)[last] * own).reshape(-1, 2, 3).sum(axis=(0, 2))
        free = len(self.slack) / 2 - taken
        seen = value + 2 * slope @ step + step @ matrix @ step
        used = float((covariance * matrix).sum()) / sigmas[0] ** 2
        return (
            np.array([seen, *(slack**2).sum(axis=(0, 2))]),
            np.array([self.count - used, *free]).clip(0),
        )


def _most_likely(
    squares: FloatArray, freedom: FloatArray, stated: FloatArray
) -> FloatArray:
    """(3,): the peak of likelihood times what was stated.

    For the robot the derivative of ``freedom log s + squares / 2 s^2 - log s + s / stated``
    is zero: a cubic with one positive root.
    """
    pixels = _STATED_WEIGHT * stated[0] ** 2 + squares[0]
    found = [np.sqrt(pixels / (_STATED_WEIGHT + freedom[0]))]
    for square, free, sigma in zip(squares[1:], freedom[1:], stated[1:], strict=True):
        roots = np.roots([1.0, free - 1, 0.0, -square / sigma**2])
        real = roots[np.abs(roots.imag) < 1e-9 * np.abs(roots).max()].real
        found.append(sigma * max(float(real.max()), _LEAST_SHARE))
    return np.array(found)
