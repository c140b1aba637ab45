"""The Airy pattern of a round pupil: encircled energy and its transfer function.

Radii are in units of lambda N_w, with the working f-number N_w = f_cal / a.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import j0, j1

if TYPE_CHECKING:
    from mvp.geometry import FloatArray

THIRD_RING = 3.238
"""Radius of the third dark ring; 95 % of the light falls inside."""


def encircled_energy(radius: FloatArray) -> FloatArray:
    """Share of the light within a radius (lambda N_w): 1 - J0^2 - J1^2 at pi r."""
    argument = np.pi * np.asarray(radius, dtype=np.float64)
    return np.asarray(1.0 - j0(argument) ** 2 - j1(argument) ** 2)


def airy_transfer(frequency: FloatArray) -> FloatArray:
    """Transfer function of a round pupil; 0 from 1 / (lambda N_w) on.

    Args:
        frequency: cycles per lambda N_w.
    """
    nu = np.clip(np.abs(np.asarray(frequency, dtype=np.float64)), 0.0, 1.0)
    return np.asarray(2 / np.pi * (np.arccos(nu) - nu * np.sqrt(1 - nu * nu)))


@lru_cache(maxsize=1)
def _inverse_table() -> tuple[FloatArray, FloatArray]:
    radius = np.linspace(0.0, THIRD_RING, 4096)
    energy = encircled_energy(radius)
    beyond = (1 - energy[-1]) * radius / THIRD_RING
    return energy + beyond, radius


def radius_of_energy(share: FloatArray) -> FloatArray:
    """Radius (lambda N_w) that holds a share of the light.

    The pattern ends at the third dark ring; the 5 % beyond are laid thinly over it.
    """
    energy, radius = _inverse_table()
    return np.asarray(np.interp(share, energy, radius))
