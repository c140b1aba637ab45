"""Tsai's two stages from one view (1987, sections II.A and II.B).

Stage one uses only the direction of each image point from the centre, which neither f nor
radial distortion changes: rotation, Tx, Ty and, for points in depth, sx. Stage two finds
f, Tz and k1. The centre is given. Points are shifted and scaled inside, and the centroid
is moved away from the axes of the camera (the equations fail for Ty = 0).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.estimate import FitOptions, fit
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from calibration.tsai.model import TsaiCamera
    from mvp.geometry import FloatArray

_FLAT = 1e-6
_LEAST_FLAT, _LEAST_DEEP = 5, 7
_FLIP = np.array([[1, 1, -1], [1, 1, -1], [-1, -1, 1]])
_SHIFTS = np.array(
    [[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]]
)


@dataclass(frozen=True, eq=False)
class TwoStage:
    """The result of both stages.

    Attributes:
        camera: with f, k1 and (in depth) sx; the centre as given.
        rotation: (3, 3) of ``camera_from_target``.
        translation_mm: (3,).
        coplanar: the flat-target form was used, which cannot find sx.
    """

    camera: TsaiCamera
    rotation: FloatArray
    translation_mm: FloatArray
    coplanar: bool


def two_stage(
    camera: TsaiCamera, points_target_mm: FloatArray, pixels: FloatArray
) -> TwoStage:
    """Calibrate from one view.

    Args:
        camera: pitch, centre, and sx (kept for a flat target); f and k1 are not used.
        points_target_mm: (m, 3); flat targets have z = 0.
        pixels: (m, 2).

    Raises:
        CalibrationError: too few points, points on a line, or a mirrored target.
    """
    coplanar = bool(
        np.ptp(points_target_mm[:, 2]) <= _FLAT * np.ptp(points_target_mm, axis=0).max()
    )
    if len(points_target_mm) < (_LEAST_FLAT if coplanar else _LEAST_DEEP):
        raise CalibrationError(
            f"{len(points_target_mm)} points are too few for Tsai's method",
            hint=f"use at least {_LEAST_FLAT} of a flat target, {_LEAST_DEEP} in depth",
        )
    origin = _origin(camera, points_target_mm, pixels)
    local = points_target_mm - origin
    if coplanar:
        rotation, across = _flat_stage_one(camera, local, pixels)
        scaled = camera
    else:
        rotation, across, sx = _deep_stage_one(camera, local, pixels)
        scaled = replace(camera, sx=sx)
    tries = (rotation, rotation * _FLIP) if coplanar else (rotation,)
    rotation, focal, depth = _signed(scaled, tries, across, local, pixels)
    found, shift = _stage_two(
        replace(scaled, f_mm=focal, k1_per_mm2=0.0),
        rotation,
        np.append(across, depth),
        local,
        pixels,
    )
    return TwoStage(found, rotation, shift - rotation @ origin, coplanar)


def _origin(camera: TsaiCamera, points: FloatArray, pixels: FloatArray) -> FloatArray:
    """An origin near the points whose image is far from both axes of the picture.

    The image of a candidate is guessed with an affine map of the points.
    """
    middle, spread = points.mean(axis=0), np.ptp(points, axis=0)
    design = np.column_stack([points - middle, np.ones(len(points))])
    affine = np.linalg.lstsq(design, camera.on_sensor(pixels), rcond=None)[0]
    tries = np.column_stack([_SHIFTS * spread[:2] / 2, np.zeros(len(_SHIFTS))])
    images = np.abs(np.column_stack([tries, np.ones(len(tries))]) @ affine)
    best = tries[np.argmax(images.min(axis=1))]
    return np.asarray(middle + best)


def _solved(rows: FloatArray, right: FloatArray) -> FloatArray:
    """Least squares with columns of unit size.

    Raises:
        CalibrationError: the columns are not independent.
    """
    size = np.linalg.norm(rows, axis=0)
    size = np.where(size > 0, size, 1.0)
    solution, _, rank, _ = np.linalg.lstsq(rows / size, right, rcond=1e-10)
    if rank < rows.shape[1]:
        raise CalibrationError(
            "the points do not determine the rotation: they lie on a line, "
            "or all in the same place",
            hint="use points that spread over the target",
        )
    return np.asarray(solution / size)


def _flat_stage_one(
    camera: TsaiCamera, points: FloatArray, pixels: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Eqs. (10) to (14): r1, r2, r4, r5, Tx, Ty from five unknowns over Ty."""
    xd, yd = camera.on_sensor(pixels).T
    x, y = points[:, 0], points[:, 1]
    rows = np.stack([yd * x, yd * y, yd, -xd * x, -xd * y], axis=1)
    r1, r2, tx, r4, r5 = _solved(rows, xd)
    total = r1**2 + r2**2 + r4**2 + r5**2
    minor = r1 * r5 - r4 * r2
    root = max(float(total**2 - 4 * minor**2), 0.0) ** 0.5
    ty = float(np.sqrt(2 / (total + root)))
    first, second = np.array([r1, r2]) * ty, np.array([r4, r5]) * ty
    shift = np.array([tx * ty, ty])
    if _wrong_side(first, second, shift, points[:, :2], np.stack([xd, yd], 1)):
        first, second, shift = -first, -second, -shift
    r3 = max(1 - float(first @ first), 0.0) ** 0.5
    r6 = max(1 - float(second @ second), 0.0) ** 0.5
    r6 *= -1 if first @ second > 0 else 1
    return _completed(np.append(first, r3), np.append(second, r6)), shift


def _deep_stage_one(
    camera: TsaiCamera, points: FloatArray, pixels: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Eqs. (16) to (19): seven unknowns; the scale sx from the length of the row."""
    plain = replace(camera, sx=1.0).on_sensor(pixels)
    xd, yd = plain.T
    rows = np.concatenate(
        [yd[:, None] * points, yd[:, None], -xd[:, None] * points], axis=1
    )
    solution = _solved(rows, xd)
    ty = 1 / float(np.linalg.norm(solution[4:]))
    sx = float(np.linalg.norm(solution[:3])) * ty
    first, second = solution[:3] * ty / sx, solution[4:] * ty
    shift = np.array([solution[3] * ty / sx, ty])
    if _wrong_side(first, second, shift, points, plain):
        first, second, shift = -first, -second, -shift
    return _completed(first, second), shift, sx


def _wrong_side(
    first: FloatArray,
    second: FloatArray,
    shift: FloatArray,
    points: FloatArray,
    images: FloatArray,
) -> bool:
    """The sign of Ty: camera x, y of the farthest point must agree with its image."""
    farthest = int(np.argmax((images**2).sum(axis=1)))
    place = np.array([first @ points[farthest], second @ points[farthest]]) + shift
    return bool(place @ images[farthest] < 0)


def _completed(first: FloatArray, second: FloatArray) -> FloatArray:
    """The rotation nearest to two rows and their cross product."""
    u, _, vt = np.linalg.svd(np.stack([first, second, np.cross(first, second)]))
    return np.asarray(u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt)


def _signed(
    camera: TsaiCamera,
    tries: tuple[FloatArray, ...],
    across: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
) -> tuple[FloatArray, float, float]:
    """Linear f and Tz; where f is negative r3, r6, r7, r8 change sign (II.A.5).

    Only a flat target leaves these signs open.

    Raises:
        CalibrationError: f stays negative or the points lie behind the camera.
    """
    for candidate in tries:
        focal, depth = _linear_focal(camera, candidate, across, points, pixels)
        if focal > 0 and depth + (points @ candidate[2]).min() > 0:
            return candidate, focal, depth
    raise CalibrationError(
        "no camera with a positive focal length sees these points",
        hint="the target may be mirrored (check the order of rows and columns), parallel "
        "to the sensor, or the centre far off",
    )


def _linear_focal(
    camera: TsaiCamera,
    rotation: FloatArray,
    across: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
) -> tuple[float, float]:
    """Eq. (15) for both coordinates, without distortion."""
    images = camera.on_sensor(pixels)
    place = points @ rotation[:2].T + across
    ahead = points @ rotation[2]
    rows = np.stack([place.T.ravel(), -images.T.ravel()], axis=1)
    right = (images * ahead[:, None]).T.ravel()
    focal, depth = _solved(rows, right)
    return float(focal), float(depth)


@dataclass(frozen=True, eq=False)
class _StageTwo:
    """f, Tz, k1 against both coordinates on the sensor."""

    camera: TsaiCamera
    rotation: FloatArray
    shift: FloatArray
    points: FloatArray
    pixels: FloatArray
    names = ("f_mm", "tz_mm", "k1_per_mm2")
    scales = np.ones(3)
    prior_rows = 0
    index = np.array([0, 7, 4])

    def residuals(self, state: FloatArray) -> FloatArray:
        camera, shift = self.parts(state)
        found = camera.project(self.rotation, shift, self.points)
        return np.asarray((found - self.pixels).ravel())

    def jacobian(self, state: FloatArray) -> FloatArray:
        camera, shift = self.parts(state)
        found = camera.project_with_derivatives(self.rotation, shift, self.points)
        both = np.concatenate([found.d_camera, found.d_pose], axis=-1)
        return np.asarray(both[..., self.index].reshape(-1, 3))

    def moved(self, state: FloatArray, step: FloatArray) -> FloatArray:
        return np.asarray(state + step)

    def parts(self, state: FloatArray) -> tuple[TsaiCamera, FloatArray]:
        focal, depth, k1 = (float(value) for value in state)
        camera = replace(self.camera, f_mm=focal, k1_per_mm2=k1)
        return camera, np.append(self.shift[:2], depth)


def _stage_two(
    camera: TsaiCamera,
    rotation: FloatArray,
    shift: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
) -> tuple[TsaiCamera, FloatArray]:
    problem = _StageTwo(camera, rotation, shift, points, pixels)
    start = np.array([camera.f_mm, shift[2], 0.0])
    found = fit(problem, start, FitOptions(noise_known=False))
    return problem.parts(found.state)
