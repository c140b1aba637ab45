"""The entrance pupil's diameter from how fast blur grows with defocus.

A point at z from the pupil has a disc of a |m - f_cal / z| on the sensor (m = x / f), so
blur against that slope of defocus is a straight line through the sharp place. Diffraction
and pixels add in squares. Exposure would give a smaller a: lenses lose light.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.estimate import Estimate, FitOptions, fit
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from mvp.geometry import FloatArray

_LEAST_CONTRAST = 2.0


@dataclass(frozen=True, eq=False)
class BlurShots:
    """Blur at one iris.

    Attributes:
        defocus: (n,), m - f_cal / z of each picture, from a sweep of distance or focus.
        blur_mm: (n,), diameter on the sensor of the disc that is as wide as what was
            measured (4 standard deviations of the profile of a point).
        sigma_mm: one standard deviation of each; (n,) or a number.
    """

    defocus: FloatArray
    blur_mm: FloatArray
    sigma_mm: FloatArray

    def __post_init__(self) -> None:
        sigma = np.broadcast_to(self.sigma_mm, np.shape(self.blur_mm))
        if np.shape(self.defocus) != np.shape(self.blur_mm) or (sigma <= 0).any():
            raise ValueError("defocus and blur must be as many, and every sigma > 0")
        object.__setattr__(self, "sigma_mm", np.asarray(sigma, np.float64))


@dataclass(frozen=True, eq=False)
class ApertureResult:
    """The pupil at one iris.

    Attributes:
        a_mm: diameter of the entrance pupil; ``a_sigma_mm`` one standard deviation.
        sharp_at: defocus where the picture was sharpest, 0 if the table is right.
        sharp_at_sigma: its one standard deviation.
        least_blur_mm: what is left there: diffraction, pixels, aberrations.
        estimate: covariance, condition, weakest direction, chi-square.
    """

    a_mm: float
    a_sigma_mm: float
    sharp_at: float
    sharp_at_sigma: float
    least_blur_mm: float
    estimate: Estimate


def defocus(
    z_mm: ArrayLike, f_cal_mm: ArrayLike, magnification: ArrayLike
) -> FloatArray:
    """M - f_cal / z, for points z from the entrance pupil; m = (d - f) / f."""
    ratio = np.asarray(f_cal_mm, np.float64) / np.asarray(z_mm, np.float64)
    return np.asarray(np.asarray(magnification, np.float64) - ratio)


def measure_aperture(
    shots: BlurShots, sharp_at: tuple[float, float] | None = None
) -> ApertureResult:
    """The pupil from blur on both sides of the sharp place, or one.

    Args:
        shots: blur against defocus.
        sharp_at: mean and one standard deviation of where it is sharp, from a table;
            where only one side was seen the place and the pupil are hard to tell apart.

    Raises:
        CalibrationError: too few pictures, or hardly any was out of focus.
    """
    if len(shots.blur_mm) < 4:
        raise CalibrationError(
            f"{len(shots.blur_mm)} pictures do not give the pupil's diameter",
            hint="take four or more, from sharp to clearly blurred on both sides",
        )
    if shots.blur_mm.max() < _LEAST_CONTRAST * shots.blur_mm.min():
        raise CalibrationError(
            "the blur hardly changed over the pictures",
            hint="sweep further out of focus: blur must at least double",
        )
    start = _start(shots)
    if sharp_at is not None:
        start[1] = sharp_at[0]
    found = fit(_BlurProblem(shots, sharp_at), start, FitOptions(tolerance=1e-7))
    a, centre, least = (float(value) for value in found.state)
    estimate = found.estimate
    return ApertureResult(
        abs(a),
        estimate.sigma_of("a_mm"),
        centre,
        estimate.sigma_of("sharp_at"),
        abs(least),
        estimate,
    )


@dataclass(frozen=True, eq=False)
class _BlurProblem:
    """sqrt((a (g - g0))^2 + b0^2) against blur."""

    shots: BlurShots
    sharp_at: tuple[float, float] | None = None
    names = ("a_mm", "sharp_at", "least_blur_mm")

    @property
    def prior_rows(self) -> int:
        return int(self.sharp_at is not None)

    @property
    def scales(self) -> FloatArray:
        return np.array([0.01, 1e-3, 1e-3])

    def residuals(self, state: FloatArray) -> FloatArray:
        a, centre, least = state
        blur = np.hypot(a * (self.shots.defocus - centre), least)
        rest = (blur - self.shots.blur_mm) / self.shots.sigma_mm
        if self.sharp_at is None:
            return np.asarray(rest)
        mean, sigma = self.sharp_at
        return np.append(rest, (centre - mean) / sigma)

    def jacobian(self, state: FloatArray) -> FloatArray:
        a, centre, least = state
        off = self.shots.defocus - centre
        blur = np.maximum(np.hypot(a * off, least), 1e-12)
        rows = np.stack([a * off**2, -(a**2) * off, np.full_like(off, least)], axis=1)
        slope = rows / (blur * self.shots.sigma_mm)[:, None]
        if self.sharp_at is None:
            return np.asarray(slope)
        return np.vstack([slope, [0.0, 1 / self.sharp_at[1], 0.0]])

    def moved(self, state: FloatArray, step: FloatArray) -> FloatArray:
        return state + step


def _start(shots: BlurShots) -> FloatArray:
    """The squares of blur lie on a parabola in defocus."""
    second, first, constant = np.polyfit(shots.defocus, shots.blur_mm**2, 2)
    sharpest = int(np.argmin(shots.blur_mm))
    if second <= 0:
        off = shots.defocus - shots.defocus[sharpest]
        slope = float(np.max(shots.blur_mm / np.maximum(np.abs(off), 1e-12)))
        a = min(slope, float(np.ptp(shots.blur_mm) / np.ptp(shots.defocus)))
        return np.array([a, shots.defocus[sharpest], shots.blur_mm.min()])
    centre = -first / (2 * second)
    least = max(constant - second * centre**2, (0.1 * shots.blur_mm.min()) ** 2)
    return np.array([np.sqrt(second), centre, np.sqrt(least)])
