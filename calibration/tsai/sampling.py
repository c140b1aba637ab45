"""How a frame buffer samples the lines of a camera with an analogue output.

The sensor's elements are read out at one clock, the sampler takes picture elements at
another. Their distance on the sensor is that of the elements times the ratio of the two
clocks; Tsai (1987, eq. 6) starts from dx Ncx / Nfx and leaves the rest to sx. A digital
camera hands over its elements one by one: then Nfx = Ncx and sx = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.tsai.model import TsaiCamera


@dataclass(frozen=True)
class Sampling:
    """A sensor and the picture that is made of it.

    Attributes:
        element_x_mm: distance of two sensor elements along a line.
        element_y_mm: distance of two lines; each is a row of the picture.
        elements: Ncx, sensor elements in a line.
        samples: Nfx, picture elements in a line.
    """

    element_x_mm: float
    element_y_mm: float
    elements: int
    samples: int

    def __post_init__(self) -> None:
        sizes = (self.element_x_mm, self.element_y_mm)
        if not (min(sizes) > 0 and np.isfinite(sizes).all()):
            raise ValueError("the distances of the elements are positive and finite")
        if min(self.elements, self.samples) < 1:
            raise ValueError("a line has one element and one sample, or more")

    @property
    def pitch_x_mm(self) -> float:
        """Dx Ncx / Nfx: of two picture elements, if both clocks fit the line alike."""
        return self.element_x_mm * self.elements / self.samples

    def spacing_mm(self, sx: float = 1.0) -> float:
        """Distance of two picture elements on the sensor, dx Ncx / (Nfx sx)."""
        return self.pitch_x_mm / sx

    def diagonal_mm(self, sx: float = 1.0) -> float:
        """From a picture element to its diagonal neighbour (eq. 18 of the planner)."""
        return float(np.hypot(self.spacing_mm(sx), self.element_y_mm))

    def scale_of_clocks(self, sensor_hz: float, sampler_hz: float) -> float:
        """Sx from the rates of the two clocks (Lenz and Tsai 1988).

        Needs no target, so it also serves where no picture can tell sx.

        Args:
            sensor_hz: elements that the camera reads out in a second.
            sampler_hz: picture elements that are taken in a second.

        Raises:
            ValueError: a rate is not positive.
        """
        if not min(sensor_hz, sampler_hz) > 0:
            raise ValueError("the rate of a clock is positive")
        return self.elements / self.samples * sampler_hz / sensor_hz

    def camera(
        self, centre_px: tuple[float, float], *, sx: float = 1.0, f_mm: float = 1.0
    ) -> TsaiCamera:
        """A camera to start a calibration from.

        Args:
            centre_px: column and row.
            sx: as the clocks say, or as found before.
            f_mm: not used by a calibration.
        """
        return TsaiCamera(self.pitch_x_mm, self.element_y_mm, f_mm, *centre_px, sx)
