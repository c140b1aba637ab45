"""Between Tsai's camera and OpenCV's, with the error that is left.

Neither radial model is the exact inverse of the other: Tsai's polynomial acts on the
distorted point, OpenCV's on the ideal one. The coefficients are fitted over the whole
picture, and the largest difference in pixels is returned with the result.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.projection import PinholeCamera, to_normalised, to_pixels
from calibration.tsai.model import TsaiCamera

if TYPE_CHECKING:
    from mvp.geometry import FloatArray

_GRID = 41


@dataclass(frozen=True)
class FitOfModels:
    """How far the two cameras differ over the picture.

    Attributes:
        worst_px: largest distance of the two images of one ray.
        rms_px: root mean square of the distance.
    """

    worst_px: float
    rms_px: float


def pinhole_from_tsai(
    camera: TsaiCamera, size_px: tuple[int, int]
) -> tuple[PinholeCamera, FitOfModels]:
    """OpenCV's k1, k2, k3 that imitate Tsai's k1 inside the picture.

    Args:
        camera: Tsai's.
        size_px: columns and rows of the picture.
    """
    pixels = _grid(size_px)
    distorted = camera.on_sensor(pixels) / camera.f_mm
    ideal = camera.undistort(camera.on_sensor(pixels)) / camera.f_mm
    squares = (ideal**2).sum(axis=1)[:, None, None]
    powers = squares ** np.arange(1, 4) * ideal[:, :, None]
    k1, k2, k3 = _solved(powers.reshape(-1, 3), (distorted - ideal).ravel())
    found = PinholeCamera(
        camera.f_mm * camera.sx / camera.pitch_x_mm,
        camera.f_mm / camera.pitch_y_mm,
        camera.cx_px,
        camera.cy_px,
        k1=k1,
        k2=k2,
        k3=k3,
    )
    return found, _difference(to_pixels(found, ideal), pixels)


def tsai_from_pinhole(
    camera: PinholeCamera,
    size_px: tuple[int, int],
    pitch_mm: tuple[float, float],
) -> tuple[TsaiCamera, FitOfModels]:
    """Tsai's single k1 that imitates OpenCV's distortion inside the picture.

    Args:
        camera: OpenCV's; tangential terms have no counterpart and show in the error.
        size_px: columns and rows of the picture.
        pitch_mm: of columns and rows on the sensor, which OpenCV's camera does not know.

    Raises:
        ValueError: the distortion folds over inside the picture.
    """
    pixels = _grid(size_px)
    ideal = to_normalised(camera, pixels)
    if not np.isfinite(ideal).all():
        raise ValueError("the distortion folds over inside the picture")
    focal = camera.fy_px * pitch_mm[1]
    scale = camera.fx_px * pitch_mm[0] / focal
    plain = TsaiCamera(*pitch_mm, focal, camera.cx_px, camera.cy_px, scale)
    distorted = plain.on_sensor(pixels)
    cubes = distorted * (distorted**2).sum(axis=1, keepdims=True)
    (k1,) = _solved(cubes.reshape(-1, 1), (ideal * focal - distorted).ravel())
    found = TsaiCamera(*pitch_mm, focal, camera.cx_px, camera.cy_px, scale, k1)
    seen = found.to_pixels(found.distort(ideal * focal)[0])
    return found, _difference(seen, pixels)


def _grid(size_px: tuple[int, int]) -> FloatArray:
    across = np.linspace(0, size_px[0] - 1, _GRID)
    down = np.linspace(0, size_px[1] - 1, _GRID)
    return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)


def _solved(rows: FloatArray, right: FloatArray) -> tuple[float, ...]:
    size = np.linalg.norm(rows, axis=0)
    solution = np.linalg.lstsq(rows / size, right, rcond=None)[0] / size
    return tuple(float(value) for value in solution)


def _difference(one: FloatArray, other: FloatArray) -> FitOfModels:
    distance = np.linalg.norm(one - other, axis=1)
    return FitOfModels(float(distance.max()), float(np.sqrt((distance**2).mean())))
