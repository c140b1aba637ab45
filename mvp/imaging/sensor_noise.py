"""From light to grey levels: electrons, shot and read noise, gain, quantisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mvp.geometry import BoolArray
    from mvp.imaging.light import Float32Array
    from mvp.imaging.render import RenderedImage

FrameArray: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]

_GAUSSIAN_FROM_E = 20.0  # electrons; fewer are drawn from Poisson's own law


@dataclass(frozen=True)
class SensorNoise:
    """A linear sensor.

    Attributes:
        full_well_e: electrons at the highest grey level.
        read_noise_e: standard deviation of the read-out.
        bits: 8, 10 or 12; frames above 8 bit are uint16.
        full_wells_per_s: signal of grey 1 at brightness (a / f_cal)^2 = 1, in full wells
            per second: the default fills the well at N_w = 16 in 16 ms.
    """

    full_well_e: float = 10_000.0
    read_noise_e: float = 8.0
    bits: int = 8
    full_wells_per_s: float = 16_000.0

    def __post_init__(self) -> None:
        if self.bits not in (8, 10, 12):
            raise ValueError("a frame has 8, 10 or 12 bits")
        if not (self.full_well_e > 0 and self.read_noise_e >= 0):
            raise ValueError("full well must be positive, read noise not negative")

    @property
    def white_level(self) -> int:
        """The highest grey level."""
        return int(2**self.bits - 1)


def signal(
    image: RenderedImage, exposure_s: float, sensor: SensorNoise
) -> Float32Array:
    """Noise-free signal as a share of the full well; above 1 it saturates."""
    factor = sensor.full_wells_per_s * image.brightness * exposure_s
    return np.asarray(image.grey * np.float32(factor))


def expose(
    image: RenderedImage,
    exposure_s: float,
    *,
    sensor: SensorNoise | None = None,
    rng: np.random.Generator | None = None,
) -> FrameArray:
    """The frame that the camera delivers; without ``rng`` free of noise."""
    sensor = sensor or SensorNoise()
    electrons = signal(image, exposure_s, sensor) * np.float32(sensor.full_well_e)
    if rng is not None:
        electrons = _noisy(electrons, sensor, rng)
    return quantised(electrons / np.float32(sensor.full_well_e), sensor)


def quantised(share: Float32Array, sensor: SensorNoise) -> FrameArray:
    """Grey levels of a signal given as share of the full well."""
    levels = np.clip(
        np.rint(share * np.float32(sensor.white_level)), 0, sensor.white_level
    )
    if sensor.bits == 8:
        return np.asarray(levels, dtype=np.uint8)
    return np.asarray(levels, dtype=np.uint16)


def _noisy(
    electrons: Float32Array, sensor: SensorNoise, rng: np.random.Generator
) -> Float32Array:
    """Shot and read noise; counts above 20 are Gaussian to well below one electron."""
    variance = electrons + np.float32(sensor.read_noise_e**2)
    noise = rng.standard_normal(electrons.shape, dtype=np.float32)
    noisy = electrons + noise * np.sqrt(variance)
    few = electrons < _GAUSSIAN_FROM_E
    if few.any():
        counts = rng.poisson(electrons[few]).astype(np.float32)
        read = rng.standard_normal(counts.shape, dtype=np.float32)
        noisy[few] = counts + read * np.float32(sensor.read_noise_e)
    return np.asarray(noisy)


def exposure_for(
    image: RenderedImage,
    *,
    mask: BoolArray | None = None,
    target: float = 0.6,
    percentile: float = 95.0,
    sensor: SensorNoise | None = None,
) -> float:
    """Exposure time, s, that puts a percentile of the masked grey at the target.

    Raises:
        ValueError: the mask is empty or everything in it is black.
    """
    sensor = sensor or SensorNoise()
    values = image.grey if mask is None else image.grey[mask]
    level = float(np.percentile(values, percentile)) if values.size else 0.0
    if not level > 0:
        raise ValueError("nothing to meter: the mask is empty or black")
    return target / (level * sensor.full_wells_per_s * image.brightness)
