"""Light that travels with the camera: ambient, lamps with fall-off, a small gloss.

Lambert plus a Blinn lobe, no cast shadows and no inter-reflection. Lamps are points in
the camera frame, so parallel faces at different depth have different greys.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float32Array: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True)
class Lamp:
    """A point lamp fixed to the camera.

    Attributes:
        position_mm: in the camera frame; (0, 0, 0) stands for a ring round the lens.
        strength: grey of a white face that it lights squarely at the reference distance.
    """

    position_mm: tuple[float, float, float]
    strength: float


@dataclass(frozen=True)
class Illumination:
    """All light of a scene.

    Attributes:
        ambient: grey of a white face lit by nothing else.
        lamps: the point lamps.
        reference_mm: distance at which a lamp has its stated strength.
        gloss: strength of the Blinn lobe relative to the lamp.
        gloss_exponent: its sharpness.
        background: grey where no body is hit.
    """

    ambient: float = 0.05
    lamps: tuple[Lamp, ...] = (
        Lamp((0.0, 0.0, 0.0), 0.3),
        Lamp((-150.0, -110.0, 20.0), 0.6),
    )
    reference_mm: float = 300.0
    gloss: float = 0.1
    gloss_exponent: float = 30.0
    background: float = 0.01

    def scaled(self, factor: float) -> Illumination:
        """The same light, dimmed or raised: lamps, ambient part and background."""
        lamps = tuple(Lamp(m.position_mm, m.strength * factor) for m in self.lamps)
        return Illumination(
            self.ambient * factor,
            lamps,
            self.reference_mm,
            self.gloss,
            self.gloss_exponent,
            self.background * factor,
        )

    def radiance(
        self,
        points: Float32Array,
        normals: Float32Array,
        albedo: Float32Array,
    ) -> Float32Array:
        """Grey of lit points as the camera sees them.

        Args:
            points: (3, n) in the camera frame, mm.
            normals: (3, n) unit normals on the camera's side of the face.
            albedo: (n,) diffuse reflectance.

        Returns:
            (n,) radiance, 1 = a white face at full lamp strength.
        """
        x, y, z = points
        range_mm = np.sqrt(x * x + y * y + z * z)
        cos_view = -(normals[0] * x + normals[1] * y + normals[2] * z) / range_mm
        diffuse = np.full_like(z, self.ambient)
        glossy = np.zeros_like(z)
        for lamp in self.lamps:
            lit, lobe = self._lamp(lamp, points, normals, range_mm, cos_view)
            diffuse += lit
            glossy += lobe
        return np.asarray(albedo * diffuse + glossy, dtype=np.float32)

    def _lamp(
        self,
        lamp: Lamp,
        points: Float32Array,
        normals: Float32Array,
        range_mm: Float32Array,
        cos_view: Float32Array,
    ) -> tuple[Float32Array, Float32Array]:
        """Diffuse and glossy part of one lamp, (n,) each."""
        to_lamp = [
            np.float32(p) - c for p, c in zip(lamp.position_mm, points, strict=True)
        ]
        squared = to_lamp[0] ** 2 + to_lamp[1] ** 2 + to_lamp[2] ** 2
        distance = np.sqrt(squared)
        cosine = sum(n * t for n, t in zip(normals, to_lamp, strict=True)) / distance
        strength = np.float32(lamp.strength * self.reference_mm**2) / squared
        strength = np.where(cosine > 0, strength, np.float32(0))
        if self.gloss == 0:
            return strength * cosine, np.zeros_like(strength)
        aligned = -sum(t * c for t, c in zip(to_lamp, points, strict=True))
        aligned = np.maximum(aligned / (distance * range_mm), np.float32(-0.999))
        half = (cosine + cos_view) / np.sqrt(2 + 2 * aligned)
        lobe = np.maximum(half, np.float32(0)) ** np.float32(self.gloss_exponent)
        return strength * cosine, np.float32(self.gloss) * strength * lobe
