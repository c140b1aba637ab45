"""The one camera model that every estimator shares, with its derivatives.

Nine numbers describe the camera: fx, fy, cx, cy in px and k1, k2, p1, p2, k3 in OpenCV's
order and meaning (Brown's distortion of normalised coordinates). A pose is
``camera_from_target``; its derivatives are taken for the six small numbers
(v, w) of ``t' = t + v`` (mm) and ``R' = exp([w]) R`` (rad), both in camera axes: the order
and meaning of every 6 x 6 covariance of this package. Pixel (0, 0) is the centre of the
top-left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray

CAMERA_NAMES = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
POSE_NAMES = ("tx_mm", "ty_mm", "tz_mm", "rx_rad", "ry_rad", "rz_rad")
_UNDISTORT_STEPS = 30
_LEAST_DEPTH_MM = 1e-9


@dataclass(frozen=True)
class PinholeCamera:
    """Focal lengths, principal point (px) and distortion (OpenCV's coefficients)."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    @classmethod
    def from_values(cls, values: FloatArray) -> PinholeCamera:
        """From the nine numbers of ``CAMERA_NAMES``."""
        return cls(*(float(value) for value in values))

    @property
    def names(self) -> tuple[str, ...]:
        """``CAMERA_NAMES``."""
        return CAMERA_NAMES

    def with_values(self, values: FloatArray) -> PinholeCamera:
        """Another camera, from the nine numbers of ``CAMERA_NAMES``."""
        return PinholeCamera.from_values(values)

    def project(
        self, rotation: FloatArray, translation_mm: FloatArray, points: FloatArray
    ) -> FloatArray:
        """As the function ``project``."""
        return project(self, rotation, translation_mm, points)

    def project_with_derivatives(
        self, rotation: FloatArray, translation_mm: FloatArray, points: FloatArray
    ) -> Projection:
        """As the function ``project_with_derivatives``."""
        return project_with_derivatives(self, rotation, translation_mm, points)

    @property
    def values(self) -> FloatArray:
        """The nine numbers of ``CAMERA_NAMES``."""
        return np.array([getattr(self, name) for name in CAMERA_NAMES])

    @property
    def matrix(self) -> FloatArray:
        """OpenCV's (3, 3) camera matrix, px."""
        return np.array(
            [[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1.0]]
        )

    @property
    def distortion(self) -> FloatArray:
        """(k1, k2, p1, p2, k3)."""
        return self.values[4:]

    def without_distortion(self) -> PinholeCamera:
        """The same camera with an ideal lens."""
        return replace(self, k1=0.0, k2=0.0, p1=0.0, p2=0.0, k3=0.0)


@dataclass(frozen=True, eq=False)
class Projection:
    """Pixels and their derivatives.

    Attributes:
        pixels: (..., 2); nan where a point is not in front of the camera.
        in_front: (...), depth greater than zero.
        d_camera: (..., 2, 9), for ``CAMERA_NAMES``.
        d_pose: (..., 2, 6), for ``POSE_NAMES``.
        d_point: (..., 2, 3), for the point in target axes, px / mm.
    """

    pixels: FloatArray
    in_front: BoolArray
    d_camera: FloatArray
    d_pose: FloatArray
    d_point: FloatArray


def project(
    camera: PinholeCamera,
    rotation: FloatArray,
    translation_mm: FloatArray,
    points_target_mm: FloatArray,
) -> FloatArray:
    """Points (..., 3) of a target seen by a camera, px.

    Args:
        camera: the lens and sensor.
        rotation: (..., 3, 3) of ``camera_from_target``; broadcasts against the points.
        translation_mm: (..., 3) of ``camera_from_target``.
        points_target_mm: (..., 3).

    Returns:
        (..., 2); nan where a point is not in front of the camera.
    """
    points_camera = _to_camera(rotation, translation_mm, points_target_mm)
    return to_pixels(camera, _normalised(points_camera))


def project_with_derivatives(
    camera: PinholeCamera,
    rotation: FloatArray,
    translation_mm: FloatArray,
    points_target_mm: FloatArray,
) -> Projection:
    """As ``project``, with all derivatives in closed form."""
    turned = np.einsum("...ij,...j->...i", rotation, points_target_mm)
    points_camera = turned + translation_mm
    normalised = _normalised(points_camera)
    pixels, d_camera, d_normalised = _pixels_with_derivatives(camera, normalised)
    d_points_camera = d_normalised @ _d_normalised(points_camera, normalised)
    d_rotation = -d_points_camera @ skew(turned)
    return Projection(
        pixels,
        points_camera[..., 2] > _LEAST_DEPTH_MM,
        d_camera,
        np.concatenate([d_points_camera, d_rotation], axis=-1),
        d_points_camera @ rotation,
    )


def moved_pose(
    rotation: FloatArray, translation_mm: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A pose (..., 3, 3), (..., 3) after a small step (..., 6) of ``POSE_NAMES``."""
    turn = Rotation.from_rotvec(step[..., 3:].reshape(-1, 3)).as_matrix()
    turn = turn.reshape(*step.shape[:-1], 3, 3)
    moved = np.asarray(turn @ rotation)
    u, _, vt = np.linalg.svd(moved)
    return np.asarray(u @ vt), np.asarray(translation_mm + step[..., :3])


def distort(camera: PinholeCamera, normalised: FloatArray) -> FloatArray:
    """Ideal normalised coordinates (..., 2) to distorted ones."""
    x, y = normalised[..., 0], normalised[..., 1]
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def to_pixels(camera: PinholeCamera, normalised: FloatArray) -> FloatArray:
    """Ideal normalised coordinates (..., 2) to pixels."""
    scale = np.array([camera.fx_px, camera.fy_px])
    centre = np.array([camera.cx_px, camera.cy_px])
    return np.asarray(distort(camera, normalised) * scale + centre)


def to_normalised(camera: PinholeCamera, pixels: FloatArray) -> FloatArray:
    """Pixels (..., 2) to ideal normalised coordinates, by Newton's method.

    Where the distortion folds over (no ideal point maps to the pixel) the result is nan.
    """
    scale = np.array([camera.fx_px, camera.fy_px])
    wanted = (pixels - np.array([camera.cx_px, camera.cy_px])) / scale
    ideal = np.array(wanted, dtype=np.float64)
    for _ in range(_UNDISTORT_STEPS):
        missing = wanted - distort(camera, ideal)
        if np.abs(missing).max(initial=0.0) < 1e-14:
            break
        slope = _d_distorted(camera, ideal)
        determinant = slope[..., 0, 0] * slope[..., 1, 1] - slope[..., 0, 1] ** 2
        slope[determinant <= 0] = np.eye(2)
        ideal = ideal + np.linalg.solve(slope, missing[..., None])[..., 0]
    error = np.abs(wanted - distort(camera, ideal)).max(axis=-1, keepdims=True)
    return np.where(error < 1e-9, ideal, np.nan)


def skew(vectors: FloatArray) -> FloatArray:
    """The matrices (..., 3, 3) of ``vectors x``."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    zero = np.zeros_like(x)
    rows = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return rows.reshape(*vectors.shape[:-1], 3, 3)


def _to_camera(
    rotation: FloatArray, translation_mm: FloatArray, points_target_mm: FloatArray
) -> FloatArray:
    turned = np.einsum("...ij,...j->...i", rotation, points_target_mm)
    return np.asarray(turned + translation_mm)


def _normalised(points_camera: FloatArray) -> FloatArray:
    depth = points_camera[..., 2:3]
    ahead = depth > _LEAST_DEPTH_MM
    return np.where(ahead, points_camera[..., :2] / np.where(ahead, depth, 1.0), np.nan)


def _d_normalised(points_camera: FloatArray, normalised: FloatArray) -> FloatArray:
    """Derivative (..., 2, 3) of x/z and y/z for x, y, z."""
    inverse = 1 / np.where(points_camera[..., 2] == 0, np.nan, points_camera[..., 2])
    zero = np.zeros_like(inverse)
    x, y = normalised[..., 0], normalised[..., 1]
    rows = [inverse, zero, -x * inverse, zero, inverse, -y * inverse]
    return np.stack(rows, axis=-1).reshape(*inverse.shape, 2, 3)


def _d_distorted(camera: PinholeCamera, normalised: FloatArray) -> FloatArray:
    """Derivative (..., 2, 2) of the distorted for the ideal normalised coordinates."""
    x, y = normalised[..., 0], normalised[..., 1]
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * k3 * r2))
    xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
    xy = x * y * slope + 2 * p1 * x + 2 * p2 * y
    yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
    return np.stack([xx, xy, xy, yy], axis=-1).reshape(*x.shape, 2, 2)


def _pixels_with_derivatives(
    camera: PinholeCamera, normalised: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels, their derivative for the camera (2, 9) and for the ideal point (2, 2)."""
    x, y = normalised[..., 0], normalised[..., 1]
    fx, fy = camera.fx_px, camera.fy_px
    distorted = distort(camera, normalised)
    r2 = x * x + y * y
    zero, one = np.zeros_like(x), np.ones_like(x)
    cross = 2 * x * y
    across = [distorted[..., 0], zero, one, zero, fx * x * r2, fx * x * r2 * r2]
    across += [fx * cross, fx * (r2 + 2 * x * x), fx * x * r2**3]
    down = [zero, distorted[..., 1], zero, one, fy * y * r2, fy * y * r2 * r2]
    down += [fy * (r2 + 2 * y * y), fy * cross, fy * y * r2**3]
    d_camera = np.stack([np.stack(across, -1), np.stack(down, -1)], axis=-2)
    scale = np.array([fx, fy])
    d_normalised = _d_distorted(camera, normalised) * scale[:, None]
    pixels = distorted * scale + np.array([camera.cx_px, camera.cy_px])
    return pixels, d_camera, d_normalised
