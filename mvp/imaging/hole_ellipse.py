"""Coordinates about an ellipse: signed distance, place on it, normal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.imaging.register import Alignment

_NEAREST_ROUNDS = 5


@dataclass(frozen=True)
class Ellipse:
    """Centre (px), semi-axes (px) and the turn of the first one (rad)."""

    x_px: float
    y_px: float
    semi_a_px: float
    semi_b_px: float
    turn_rad: float

    @property
    def axes_px(self) -> tuple[float, float]:
        """Full axes, the larger first."""
        axes = 2 * self.semi_a_px, 2 * self.semi_b_px
        return max(axes), min(axes)

    @property
    def circumference_px(self) -> float:
        """Ramanujan's approximation."""
        a, b = self.semi_a_px, self.semi_b_px
        return float(np.pi * (3 * (a + b) - np.sqrt((3 * a + b) * (a + 3 * b))))

    def moved(self, alignment: Alignment) -> Ellipse:
        """The same ellipse after a similarity; eccentric angles are kept."""
        x, y = alignment.apply(np.array([self.x_px, self.y_px]))
        return Ellipse(
            float(x),
            float(y),
            self.semi_a_px * alignment.scale,
            self.semi_b_px * alignment.scale,
            self.turn_rad + alignment.roll_rad,
        )

    @property
    def _rotation(self) -> FloatArray:
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.array([[cos, -sin], [sin, cos]])

    def points(self, angle: FloatArray) -> FloatArray:
        """Points (..., 2) at eccentric angles."""
        own = np.stack(
            [self.semi_a_px * np.cos(angle), self.semi_b_px * np.sin(angle)], axis=-1
        )
        return np.asarray(own @ self._rotation.T + np.array([self.x_px, self.y_px]))

    def normals(self, angle: FloatArray) -> FloatArray:
        """Outward unit normals (..., 2) at eccentric angles."""
        own = np.stack(
            [self.semi_b_px * np.cos(angle), self.semi_a_px * np.sin(angle)], axis=-1
        )
        own = own / np.linalg.norm(own, axis=-1, keepdims=True)
        return np.asarray(own @ self._rotation.T)

    def nearest(self, places: FloatArray) -> FloatArray:
        """Eccentric angle (n,) of the nearest point, for places near the ellipse."""
        own = (places - np.array([self.x_px, self.y_px])) @ self._rotation
        x, y = own[:, 0], own[:, 1]
        a, b = self.semi_a_px, self.semi_b_px
        angle = np.arctan2(y * a, x * b)
        for _ in range(_NEAREST_ROUNDS):
            cos, sin = np.cos(angle), np.sin(angle)
            slope = (a * a - b * b) * cos * sin - x * a * sin + y * b * cos
            bend = (a * a - b * b) * (cos * cos - sin * sin) - x * a * cos - y * b * sin
            step = np.divide(slope, bend, out=np.zeros_like(slope), where=bend < 0)
            angle = angle - np.clip(step, -0.3, 0.3)
        return np.asarray(angle)

    def distance(self, places: FloatArray, angle: FloatArray) -> FloatArray:
        """Signed distance (n,) along the normal at the nearest angles, > 0 outside."""
        away = places - self.points(angle)
        return np.asarray((away * self.normals(angle)).sum(axis=-1))

    def modes(self, angle: FloatArray) -> FloatArray:
        """Normal displacement (n, 5) per px of: x, y, semi-axes, and skew.

        The last one is the turn times a^2 - b^2, which stays well defined for circles.
        """
        normal = self.normals(angle)
        cos, sin = np.cos(angle), np.sin(angle)
        a, b = self.semi_a_px, self.semi_b_px
        size = np.hypot(b * cos, a * sin)
        skew = max(a, b) * sin * cos / size
        shape = [b * cos * cos / size, a * sin * sin / size, skew]
        return np.column_stack([normal, *shape])


def fitted_ellipse(places_px: FloatArray) -> Ellipse:
    """The ellipse through points that lie on one (n, 2), n >= 5.

    Raises:
        ValueError: the points lie on another kind of conic.
    """
    middle = places_px.mean(axis=0)
    scale = float(np.abs(places_px - middle).max())
    x, y = ((places_px - middle) / scale).T
    system = np.column_stack([x * x, x * y, y * y, x, y])
    a, b, c, d, e = np.linalg.lstsq(system, np.ones(len(x)), rcond=None)[0]
    quadric = np.array([[a, b / 2], [b / 2, c]])
    centre = np.linalg.solve(-2 * quadric, np.array([d, e]))
    values, vectors = np.linalg.eigh(quadric)
    square = (1 + centre @ quadric @ centre) / values
    if not (square > 0).all():
        raise ValueError("the points do not lie on an ellipse")
    semi = scale * np.sqrt(square)
    turn = float(np.arctan2(vectors[1, 0], vectors[0, 0]))
    x0, y0 = middle + scale * centre
    return Ellipse(float(x0), float(y0), float(semi[0]), float(semi[1]), turn)
