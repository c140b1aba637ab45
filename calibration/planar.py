"""Closed forms for a flat target: homography, focal length, pose (Zhang 2000)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.bundle import BundleProblem, BundleState, freedom
from calibration.estimate import FitOptions, fit
from calibration.observations import Observations
from calibration.projection import PinholeCamera, to_normalised

if TYPE_CHECKING:
    from mvp.geometry import FloatArray

_HOPELESS = 100.0
_POSE_ONLY = FitOptions(most_steps=30, tolerance=1e-6)


def homography(points: FloatArray, images: FloatArray) -> FloatArray:
    """The (3, 3) matrix that maps plane points (m, 2) to images (m, 2).

    Solved linearly on coordinates centred and scaled to unit size.

    Raises:
        ValueError: fewer than four points, or all on a line.
    """
    if len(points) < 4:
        raise ValueError("a homography needs at least four points")
    plane, plane_scaled = _normaliser(points)
    image, image_scaled = _normaliser(images)
    x, y = plane_scaled.T
    u, v = image_scaled.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    across = np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=1)
    down = np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=1)
    _, sizes, vt = np.linalg.svd(np.concatenate([across, down]), full_matrices=True)
    if sizes[7] < 1e-9 * sizes[0]:
        raise ValueError("the points lie on a line")
    scaled = vt[-1].reshape(3, 3)
    return np.asarray(np.linalg.solve(image, scaled @ plane))


def focal_from_homographies(
    homographies: FloatArray, centre_px: FloatArray, aspect: float = 1.0
) -> float | None:
    """Fx that makes the two axes of every target perpendicular and equally long.

    Args:
        homographies: (views, 3, 3), plane to pixels.
        centre_px: (2,), the principal point.
        aspect: fy / fx.

    Returns:
        fx, px; None when the views do not tell (targets parallel to the sensor).
    """
    shift = np.array([[1, 0, -centre_px[0]], [0, 1 / aspect, -centre_px[1] / aspect]])
    flat = np.concatenate([shift @ homographies, homographies[:, 2:]], axis=1)
    size = np.linalg.norm(flat[:, :2, :2], axis=(1, 2), keepdims=True)
    first, second = (flat / size)[..., 0], (flat / size)[..., 1]
    plane = np.concatenate(
        [
            (first[:, :2] * second[:, :2]).sum(axis=1),
            (first[:, :2] ** 2 - second[:, :2] ** 2).sum(axis=1),
        ]
    )
    depth = np.concatenate(
        [first[:, 2] * second[:, 2], first[:, 2] ** 2 - second[:, 2] ** 2]
    )
    inverse = -(plane @ depth) / max(depth @ depth, np.finfo(float).tiny)
    return float(np.sqrt(inverse)) if inverse > 0 else None


def planar_pose(
    camera: PinholeCamera, points_target_mm: FloatArray, pixels: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pose ``camera_from_target`` of a flat target (z = 0) with a known camera.

    Both poses that a nearly flat image allows are refined, unless the second one is far
    worse to begin with than the first one after refinement; the better one is taken.

    Returns:
        Rotation (3, 3) and translation (3,), mm.

    Raises:
        ValueError: fewer than four points, or all on a line.
    """
    normalised = to_normalised(camera, pixels)
    if not np.isfinite(normalised).all():
        plain = camera.without_distortion()
        normalised = to_normalised(plain, pixels)
    start = pose_from_homography(homography(points_target_mm[:, :2], normalised))
    seen = Observations.from_views([points_target_mm], [pixels], size_px=(2, 2))
    held = freedom(camera, ())
    problem: BundleProblem[PinholeCamera] = BundleProblem(seen, held, 1.0)
    best: tuple[float, BundleState[PinholeCamera]] | None = None
    for rotation, translation in (start, _other_pose(*start, points_target_mm)):
        state = BundleState(camera, rotation[None], translation[None])
        residuals = problem.residuals(state)
        if not np.isfinite(residuals).all():
            continue
        if best is not None and residuals @ residuals > _HOPELESS * best[0]:
            continue
        found = fit(problem, state, _POSE_ONLY)
        if best is None or found.estimate.chi_square < best[0]:
            best = (found.estimate.chi_square, found.state)
    if best is None:
        raise ValueError("no pose puts the target in front of the camera")
    return best[1].rotation[0], best[1].translation_mm[0]


def pose_from_homography(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation from a homography to normalised coordinates."""
    scale = 2 / np.linalg.norm(matrix[:, :2], axis=0).sum()
    scaled = matrix * (scale if matrix[2, 2] > 0 else -scale)
    columns = np.column_stack([scaled[:, :2], np.cross(scaled[:, 0], scaled[:, 1])])
    u, _, vt = np.linalg.svd(columns)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return np.asarray(rotation), np.asarray(scaled[:, 2])


def _other_pose(
    rotation: FloatArray, translation_mm: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The target turned so that its normal is mirrored in the line of sight."""
    middle = points.mean(axis=0)
    centre = rotation @ middle + translation_mm
    sight = centre / np.linalg.norm(centre)
    half_turn = 2 * np.outer(sight, sight) - np.eye(3)
    mirrored = half_turn @ rotation @ np.diag([-1.0, -1.0, 1.0])
    return mirrored, centre - mirrored @ middle


def _normaliser(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The (3, 3) matrix that centres and scales points (m, 2), and its result."""
    middle = points.mean(axis=0)
    spread = float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean())) or 1.0
    matrix = np.array(
        [[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, spread]], dtype=np.float64
    )
    return matrix / spread, (points - middle) / spread
