"""How wide a point becomes on the sensor: defocus, diffraction and the pixel itself.

Lengths in mm on the sensor. Contributions are compared by the standard deviation of
their profile along one axis, which adds in squares whatever their shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from mvp.geometry import FloatArray

_AIRY_FIRST_ZERO = 2.4393
_AIRY_FWHM = 1.0290
_FWHM_PER_SIGMA = float(2 * np.sqrt(2 * np.log(2)))


def working_f_number(d_mm: ArrayLike, a_mm: ArrayLike) -> FloatArray:
    """N_w = d / a, the f-number that the sensor sees (pupil ratio 1)."""
    return np.asarray(np.asarray(d_mm, np.float64) / np.asarray(a_mm, np.float64))


def airy_diameter_mm(
    d_mm: ArrayLike, a_mm: ArrayLike, wavelength_mm: float
) -> FloatArray:
    """Diameter of the first dark ring, 2.44 lambda N_w."""
    return np.asarray(_AIRY_FIRST_ZERO * wavelength_mm * working_f_number(d_mm, a_mm))


def airy_fwhm_mm(d_mm: ArrayLike, a_mm: ArrayLike, wavelength_mm: float) -> FloatArray:
    """Full width at half maximum of the diffraction spot, 1.03 lambda N_w."""
    return np.asarray(_AIRY_FWHM * wavelength_mm * working_f_number(d_mm, a_mm))


def smallest_pupil_mm(d_mm: ArrayLike, c_mm: float, wavelength_mm: float) -> FloatArray:
    """The a whose Airy disc is as wide as c: smaller pupils blur more, not less."""
    return np.asarray(
        _AIRY_FIRST_ZERO * wavelength_mm * np.asarray(d_mm, np.float64) / c_mm
    )


@dataclass(frozen=True, eq=False)
class BlurBudget:
    """What makes a point wide; arrays broadcast.

    Attributes:
        defocus_mm: diameter of the circle of confusion (sign ignored).
        airy_fwhm_mm: full width at half maximum of the diffraction spot.
        pixel_mm: side of a pixel (its light-collecting width).
    """

    defocus_mm: FloatArray
    airy_fwhm_mm: FloatArray
    pixel_mm: FloatArray

    @classmethod
    def of(
        cls,
        defocus_mm: ArrayLike,
        *,
        d_mm: ArrayLike,
        a_mm: ArrayLike,
        wavelength_mm: float,
        pixel_mm: ArrayLike,
    ) -> BlurBudget:
        """From the blur circle and the lens setting."""
        return cls(
            np.asarray(defocus_mm, np.float64),
            airy_fwhm_mm(d_mm, a_mm, wavelength_mm),
            np.asarray(pixel_mm, np.float64),
        )

    @property
    def defocus_sigma_mm(self) -> FloatArray:
        """Of a uniform disc: a quarter of its diameter."""
        return np.asarray(np.abs(self.defocus_mm) / 4)

    @property
    def diffraction_sigma_mm(self) -> FloatArray:
        """Of the Gaussian with the Airy spot's half width (its own is unbounded)."""
        return np.asarray(self.airy_fwhm_mm / _FWHM_PER_SIGMA)

    @property
    def pixel_sigma_mm(self) -> FloatArray:
        """Of a box."""
        return np.asarray(self.pixel_mm / np.sqrt(12))

    @property
    def optical_sigma_mm(self) -> FloatArray:
        """Defocus and diffraction together."""
        return np.asarray(np.hypot(self.defocus_sigma_mm, self.diffraction_sigma_mm))

    @property
    def total_sigma_mm(self) -> FloatArray:
        """All three together."""
        return np.asarray(np.hypot(self.optical_sigma_mm, self.pixel_sigma_mm))

    @property
    def spread_mm(self) -> FloatArray:
        """Diameter of the disc that is as wide as defocus and diffraction together."""
        return np.asarray(4 * self.optical_sigma_mm)
