"""The lens as a picture sees it: a thin pupil, its rays, its blur, its diffraction.

A ray starts on the disc of the entrance pupil (diameter a, plane z = 0 of the camera
frame) and passes through the point of the plane in perfect focus that the chief ray of
its image point meets. Distances z count from the entrance pupil.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import sobol_points
from mvp.imaging.diffraction import radius_of_energy
from mvp.optics.thick_lens import principal_distance_mm, signed_blur_mm

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from mvp.geometry import FloatArray

WAVELENGTH_MM = 550e-6


@dataclass(frozen=True)
class PupilOptics:
    """One lens setting.

    Attributes:
        d_mm: back nodal point to image plane.
        f_mm: focal length.
        a_mm: entrance pupil diameter.
        e_mm: entrance pupil in front of the front nodal point.
        wavelength_mm: of the light, for diffraction.
    """

    d_mm: float
    f_mm: float
    a_mm: float
    e_mm: float = 0.0
    wavelength_mm: float = WAVELENGTH_MM

    def __post_init__(self) -> None:
        if not (self.f_mm > 0 and self.a_mm > 0 and self.f_cal_mm > 0):
            raise ValueError("f, a and the principal distance must be positive")

    @property
    def f_cal_mm(self) -> float:
        """Principal distance d - e (d - f) / f."""
        return float(principal_distance_mm(self.d_mm, self.f_mm, self.e_mm))

    @property
    def inverse_focus_per_mm(self) -> float:
        """1 / z_f = m / f_cal; 0 or negative when nothing is in perfect focus."""
        return (self.d_mm - self.f_mm) / self.f_mm / self.f_cal_mm

    @property
    def working_f_number(self) -> float:
        """N_w = f_cal / a, which is d / a when the pupil offset is 0."""
        return self.f_cal_mm / self.a_mm

    @property
    def airy_unit_mm(self) -> float:
        """Lambda N_w on the sensor."""
        return self.wavelength_mm * self.working_f_number

    @property
    def brightness(self) -> float:
        """Image irradiance of unit radiance, up to a constant: (a / f_cal)^2."""
        return (self.a_mm / self.f_cal_mm) ** 2

    def blur_mm(self, z_mm: ArrayLike) -> FloatArray:
        """Diameter of the blur circle on the sensor of points at depth z, mm."""
        args = (self.d_mm, self.f_mm, self.a_mm, self.e_mm)
        return np.abs(signed_blur_mm(z_mm, *args))


@dataclass(frozen=True, eq=False)
class JointSamples:
    """Samples of pixel area x pupil x diffraction, the same for every pixel.

    Attributes:
        pixel_px: (n, 2) place within the pixel, -0.5 .. 0.5.
        pupil_mm: (n, 2) place in the entrance pupil plane.
        airy_mm: (n, 2) deviation on the sensor by diffraction.
    """

    pixel_px: FloatArray
    pupil_mm: FloatArray
    airy_mm: FloatArray


def joint_samples(
    count: int, optics: PupilOptics, *, defocus: bool = True, diffraction: bool = True
) -> JointSamples:
    """A Sobol set of ``count`` samples (a power of 2), each with its opposite.

    Opposites keep the mean of every part at zero, so that few samples do not shift the
    picture; the places within the pixel still lie on distinct rows and columns.
    """
    half = count // 2
    unit = sobol_points(6, half) + 0.5 / half
    pupil = _disc(np.sqrt(unit[:, 2]) * optics.a_mm / 2, unit[:, 3])
    radius = radius_of_energy(unit[:, 4]) * optics.airy_unit_mm
    airy = _disc(radius, unit[:, 5])
    # A quarter step off the lattice keeps a place and its opposite on different rows.
    pixel = unit[:, :2] - 0.5 + 0.25 / half
    return JointSamples(
        _with_opposites(pixel),
        _with_opposites(pupil * float(defocus)),
        _with_opposites(airy * float(diffraction)),
    )


def independent_parts(samples: JointSamples) -> JointSamples:
    """Twice as many samples, in which the pupil has nothing to do with the rest.

    In a small set that serves every pixel alike, the pupil would by chance go with the
    place within the pixel or the diffraction, and blur would grow from another distance
    than the sharp one. Every place is therefore seen through both opposite places of the
    pupil, and pupil and pixel get the second moments of a disc and a square.
    """
    pupil = _round(samples.pupil_mm, _disc_moment(samples.pupil_mm))
    pixel = _round(samples.pixel_px, 1 / 12)
    return JointSamples(
        np.concatenate([pixel, pixel]),
        np.concatenate([pupil, -pupil]),
        np.concatenate([samples.airy_mm, samples.airy_mm]),
    )


def _disc_moment(places: FloatArray) -> float:
    """Second moment along one axis, the mean over both."""
    return float((places**2).mean())


def _round(places: FloatArray, moment: float) -> FloatArray:
    """Places (n, 2) stretched to one second moment in all directions."""
    own = places.T @ places / len(places)
    if moment == 0 or np.linalg.det(own) <= 0:
        return places
    values, axes = np.linalg.eigh(own)
    return np.asarray(places @ (axes * np.sqrt(moment / values)) @ axes.T)


def _with_opposites(values: FloatArray) -> FloatArray:
    return np.concatenate([values, -values])


def _disc(radius: FloatArray, turn: FloatArray) -> FloatArray:
    angle = 2 * np.pi * turn
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
