"""A lens as thin groups and a stop, traced ray by ray: an oracle for thick-lens formulas.

Everything follows from two facts: between groups a ray is straight, at a group of power p
its slope changes by -p times its height. The axis z runs from the object to the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray


@dataclass(frozen=True)
class ParaxialLens:
    """Groups, stop and sensor on one axis.

    Attributes:
        powers_per_mm: of the groups, in the order of the light.
        places_mm: z of the groups, rising.
        stop_mm: z of the stop, before, between or behind the groups.
        stop_diameter_mm: of the stop itself.
        sensor_mm: z of the sensor.
    """

    powers_per_mm: tuple[float, ...]
    places_mm: tuple[float, ...]
    stop_mm: float
    stop_diameter_mm: float
    sensor_mm: float

    @classmethod
    def thin(
        cls, *, f_mm: float, d_mm: float, e_mm: float, a_mm: float
    ) -> ParaxialLens:
        """One group at z = 0 with an entrance pupil of diameter a, e in front of it.

        A pupil behind the group (e < 0) is the image of a stop behind it.
        """
        if e_mm >= 0:
            return cls((1 / f_mm,), (0.0,), -e_mm, a_mm, d_mm)
        behind = f_mm * -e_mm / (f_mm - e_mm)
        return cls((1 / f_mm,), (0.0,), behind, a_mm * behind / -e_mm, d_mm)

    def focused(self, d_mm: float) -> ParaxialLens:
        """The whole lens moved so that the sensor is d behind its rear principal plane."""
        return replace(self, sensor_mm=self.sensor_mm + d_mm - self.d_mm)

    @property
    def f_mm(self) -> float:
        """Focal length, from a ray parallel to the axis."""
        return float(-1 / self._matrix(self._front, self._rear)[1, 0])

    @property
    def front_nodal_mm(self) -> float:
        """Z where rays leave parallel to how they came (in air)."""
        m = self._matrix(self._front, self._rear)
        return float(self._front - (1 - m[1, 1]) / m[1, 0])

    @property
    def d_mm(self) -> float:
        """From the rear principal plane to the sensor."""
        m = self._matrix(self._front, self._rear)
        return float(self.sensor_mm - self._rear - (1 - m[0, 0]) / m[1, 0])

    @property
    def pupil_mm(self) -> float:
        """Z of the entrance pupil: where rays to the middle of the stop cross the axis."""
        m = self._matrix(self._front, self.stop_mm)
        return float(self._front + m[0, 1] / m[0, 0])

    @property
    def e_mm(self) -> float:
        """How far the entrance pupil lies in front of the front nodal point."""
        return self.front_nodal_mm - self.pupil_mm

    @property
    def a_mm(self) -> float:
        """Diameter of the entrance pupil."""
        m = self._matrix(self._front, self.stop_mm)
        return float(abs(self.stop_diameter_mm / m[0, 0]))

    def sharp_from_pupil_mm(self) -> float:
        """Distance of the object whose rays meet on the sensor."""
        m = self._matrix(self._front, self.sensor_mm)
        return float(-m[0, 1] / m[0, 0]) + self.pupil_mm - self._front

    def scale(self, from_pupil_mm: FloatArray | float) -> FloatArray:
        """Image size by object size at distances from the pupil, of the chief rays."""
        z = self.pupil_mm - np.asarray(from_pupil_mm, np.float64)
        slope = 1 / (z - self.pupil_mm)
        at_front = 1 + slope * (self._front - z)
        m = self._matrix(self._front, self.sensor_mm)
        return np.asarray(-(m[0, 0] * at_front + m[0, 1] * slope))

    def blur_mm(self, from_pupil_mm: FloatArray | float) -> FloatArray:
        """Diameter on the sensor of the light from a point on the axis."""
        z = self.pupil_mm - np.asarray(from_pupil_mm, np.float64)
        slope = self.a_mm / (self.pupil_mm - z)
        m = self._matrix(self._front, self.sensor_mm)
        return np.asarray(np.abs(m[0, 0] * slope * (self._front - z) + m[0, 1] * slope))

    @property
    def _front(self) -> float:
        return min(self.places_mm[0], self.stop_mm)

    @property
    def _rear(self) -> float:
        return self.places_mm[-1]

    def _matrix(self, start: float, end: float) -> FloatArray:
        """From height and slope at one z to those at a later one."""
        found, here = np.eye(2), start
        for power, place in zip(self.powers_per_mm, self.places_mm, strict=True):
            if start <= place <= end:
                gap = np.array([[1.0, place - here], [0.0, 1.0]])
                found = np.array([[1.0, 0.0], [-power, 1.0]]) @ gap @ found
                here = place
        return np.asarray(np.array([[1.0, end - here], [0.0, 1.0]]) @ found)
