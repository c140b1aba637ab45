"""How far a point may be off in the picture and on the work, from a camera covariance.

Two answers at one distance. *Direct*: the pose of the camera is known from elsewhere, so
every error of the camera shows. *Refitted*: the pose was found with this same camera in
pictures at about this distance (hand-eye, part pose), so the part of the error that a
small motion imitates is gone; a least-squares motion over points at 0.9, 1 and 1.1 times
the distance takes it away.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.projection import (
    PinholeCamera,
    project_with_derivatives,
    to_normalised,
)

if TYPE_CHECKING:
    from mvp.geometry import FloatArray

_NEAR_AND_FAR = (0.9, 1.0, 1.1)


@dataclass(frozen=True, eq=False)
class ProjectionUncertainty:
    """One standard deviation in the worst direction on a grid over the picture.

    Attributes:
        distance_mm: of the points from the entrance pupil, along the axis.
        pixels: (rows, columns, 2), where.
        direct_px: (rows, columns).
        refitted_px: (rows, columns).
        mm_per_px: on a plane at the distance, in the middle.
    """

    distance_mm: float
    pixels: FloatArray
    direct_px: FloatArray
    refitted_px: FloatArray
    mm_per_px: float

    @property
    def direct_mm(self) -> FloatArray:
        """(rows, columns), on a plane at the distance."""
        return self.direct_px * self.mm_per_px

    @property
    def refitted_mm(self) -> FloatArray:
        """(rows, columns), on a plane at the distance."""
        return self.refitted_px * self.mm_per_px


def projection_uncertainty(
    camera: PinholeCamera,
    covariance: FloatArray,
    *,
    size_px: tuple[int, int],
    distance_mm: float,
    grid: tuple[int, int] = (9, 12),
) -> ProjectionUncertainty:
    """Carry a camera covariance to the picture and the work.

    Args:
        camera: the camera.
        covariance: (9, 9) of ``CAMERA_NAMES``.
        size_px: columns and rows of the picture.
        distance_mm: working distance from the entrance pupil.
        grid: rows and columns of the answer, corners of the picture included.

    Raises:
        ValueError: the distortion folds over inside the picture.
    """
    pixels = _grid(size_px, grid)
    rays = to_normalised(camera, pixels)
    if not np.isfinite(rays).all():
        raise ValueError("the distortion folds over inside the picture")
    flat = np.concatenate([rays, np.ones((*grid, 1))], axis=-1).reshape(-1, 3)
    points = np.concatenate([factor * distance_mm * flat for factor in _NEAR_AND_FAR])
    found = project_with_derivatives(camera, np.eye(3), np.zeros(3), points)
    d_camera = found.d_camera.reshape(-1, 9)
    d_pose = found.d_pose.reshape(-1, 6)
    motion = np.linalg.lstsq(d_pose, d_camera, rcond=None)[0]
    middle = slice(2 * len(flat), 4 * len(flat))
    left = d_camera[middle] - d_pose[middle] @ motion
    return ProjectionUncertainty(
        distance_mm,
        pixels,
        _worst(d_camera[middle], covariance).reshape(grid),
        _worst(left, covariance).reshape(grid),
        distance_mm / float(np.sqrt(camera.fx_px * camera.fy_px)),
    )


def _grid(size_px: tuple[int, int], grid: tuple[int, int]) -> FloatArray:
    across = np.linspace(0, size_px[0] - 1, grid[1])
    down = np.linspace(0, size_px[1] - 1, grid[0])
    return np.stack(np.meshgrid(across, down), axis=-1)


def _worst(derivative: FloatArray, covariance: FloatArray) -> FloatArray:
    """Largest standard deviation over directions in the picture, one for each point."""
    pairs = derivative.reshape(-1, 2, 9)
    spread = pairs @ covariance @ pairs.swapaxes(1, 2)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, -1], 0.0)))
