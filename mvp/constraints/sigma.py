"""Margins in standard deviations: what the errors of a cell do to a row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mvp.constraints.base import N_COORDINATES, SHIFT, TURN, A, D, F, Rows

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.optics.views import Views

INDEX_CAP = 1e6
"""Index of a row that no stated error can change."""


@dataclass(frozen=True)
class Uncertainty:
    """One standard deviation of every error, independent of each other.

    Attributes:
        position_mm: of the pupil, along each axis.
        angle_rad: of the orientation, about each axis.
        d_mm: of the image distance.
        f_mm: of the focal length.
        a_mm: of the pupil diameter.
    """

    position_mm: float = 1.0
    angle_rad: float = float(np.deg2rad(0.3))
    d_mm: float = 0.01
    f_mm: float = 0.0125
    a_mm: float = 0.008

    def __post_init__(self) -> None:
        values = (self.position_mm, self.angle_rad, self.d_mm, self.f_mm, self.a_mm)
        if not all(np.isfinite(v) and v >= 0 for v in values):
            raise ValueError("standard deviations must be finite and not negative")
        if self.position_mm == 0:
            raise ValueError("the position has some error: say how much")

    @property
    def sigma(self) -> FloatArray:
        """(9,) in the order of the error coordinates."""
        sigma = np.zeros(N_COORDINATES)
        sigma[SHIFT] = self.position_mm
        sigma[TURN] = self.angle_rad
        sigma[[D, F, A]] = self.d_mm, self.f_mm, self.a_mm
        return sigma

    def scaled(self, factor: float) -> Uncertainty:
        """All errors larger by one factor."""
        return Uncertainty(
            self.position_mm * factor,
            self.angle_rad * factor,
            self.d_mm * factor,
            self.f_mm * factor,
            self.a_mm * factor,
        )


class ErrorModel(Protocol):
    """Errors that depend on the view and on each other."""

    def covariance(self, views: Views) -> FloatArray:
        """Of the error coordinates at every view, (N, 9, 9)."""
        ...


def worst_spread(covariance: FloatArray) -> Uncertainty:
    """Independent errors as large as each kind is in its worst direction.

    Args:
        covariance: (9, 9) of the error coordinates.
    """
    worst = np.sqrt(np.diag(covariance).clip(min=0))
    return Uncertainty(
        position_mm=float(worst_deviation(covariance[SHIFT, SHIFT])),
        angle_rad=float(worst_deviation(covariance[TURN, TURN])),
        d_mm=float(worst[D]),
        f_mm=float(worst[F]),
        a_mm=float(worst[A]),
    )


def worst_deviation(covariance: FloatArray) -> FloatArray:
    """Standard deviation (...) in the worst direction of covariances (..., 3, 3)."""
    largest = np.linalg.eigvalsh(covariance)[..., -1]
    return np.asarray(np.sqrt(largest.clip(min=0)))


def correlated_deviation(gradient: FloatArray, covariance: FloatArray) -> FloatArray:
    """Standard deviation of rows under errors that depend on each other.

    Args:
        gradient: (N, R, 9).
        covariance: (N, 9, 9) of the error coordinates.

    Returns:
        (N, R), in the unit of the row.
    """
    spread = gradient @ covariance
    return np.asarray(np.sqrt((spread * gradient).sum(axis=-1).clip(min=0)))


def margin_deviation(gradient: FloatArray, sigma: FloatArray) -> FloatArray:
    """Standard deviation of rows under independent errors.

    Args:
        gradient: (..., 9).
        sigma: (9,) standard deviations of the error coordinates.

    Returns:
        (...), in the unit of the row.
    """
    spread = gradient * sigma
    return np.asarray(np.sqrt(np.einsum("...j,...j->...", spread, spread)))


def sigma_index(
    value: FloatArray, gradient: FloatArray, sigma: FloatArray
) -> FloatArray:
    """Margin divided by its standard deviation; same shape as ``value``.

    A row that no stated error moves, or hardly, is capped at +-``INDEX_CAP``.
    """
    deviation = margin_deviation(gradient, sigma)
    floor = np.abs(value) / INDEX_CAP
    safe = np.maximum(deviation, np.where(floor > 0, floor, 1.0 / INDEX_CAP))
    return np.asarray(value / safe)


def rows_index(rows: Rows, sigma: FloatArray) -> FloatArray:
    """``sigma_index`` of evaluated rows, (N, R).

    Raises:
        ValueError: the rows were evaluated without gradient.
    """
    if rows.gradient is None:
        raise ValueError("an index needs rows with their gradient")
    return sigma_index(rows.value, rows.gradient, sigma)
