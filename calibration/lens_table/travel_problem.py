"""A target faced squarely from several places on a straight line, as a least squares.

The camera travels by s along a direction u of its own axes, so the target's place in
camera axes is t0 - s u. Size goes as 1 / (z0 - s u_z): its reciprocal is linear in s; the
slope gives the principal distance, the zero crossing the pupil. The stage or arm errs
at every stop in place and direction: without six small numbers per stop for that, many
points would be taken for many facts about the travel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.projection import (
    PinholeCamera,
    moved_pose,
    project,
    project_with_derivatives,
)

if TYPE_CHECKING:
    from mvp.geometry import FloatArray

_CAMERA = ("f_px", "cx_px", "cy_px", "k1")
_POSE = ("tx_mm", "ty_mm", "tz_mm", "rx_rad", "ry_rad", "rz_rad")
_FIXED = len(_CAMERA) + len(_POSE) + 2


@dataclass(frozen=True, eq=False)
class TravelShots:
    """One target seen from stops along a straight line, without turning.

    Attributes:
        travel_mm: (n,), as the stage or arm reports it, along one direction.
        points_target_mm: (m, 3), a flat target.
        pixels: (n, m, 2), where its points were found.
        sigma_px: one standard deviation of a coordinate.
        travel_sigma_mm: of a stop, on each axis.
        turn_sigma_rad: of a stop, about each axis.
    """

    travel_mm: FloatArray
    points_target_mm: FloatArray
    pixels: FloatArray
    sigma_px: float
    travel_sigma_mm: float
    turn_sigma_rad: float = 1e-4

    def __post_init__(self) -> None:
        shape = (len(self.travel_mm), len(self.points_target_mm), 2)
        if self.pixels.shape != shape or self.points_target_mm.shape[1:] != (3,):
            raise ValueError("pixels must have shape (stops, points, 2)")
        if not (np.isfinite(self.pixels).all() and np.isfinite(self.travel_mm).all()):
            raise ValueError("travel and pixels must be finite")
        if min(self.sigma_px, self.travel_sigma_mm, self.turn_sigma_rad) <= 0:
            raise ValueError("every sigma must be greater than zero")


@dataclass(frozen=True, eq=False)
class TravelState:
    """Unknowns of a travel.

    Attributes:
        camera: fx and k1, cx, cy count; fy follows fx.
        rotation: (3, 3) of ``camera_from_target``.
        translation_mm: (3,) of ``camera_from_target`` where travel is 0.
        direction: (3,), unit vector of the travel in camera axes.
        shift_mm: (n, 3), errors of the stops.
        turn: (n, 3, 3), errors of the stops.
    """

    camera: PinholeCamera
    rotation: FloatArray
    translation_mm: FloatArray
    direction: FloatArray
    shift_mm: FloatArray
    turn: FloatArray


@dataclass(frozen=True, eq=False)
class TravelProblem:
    """Whitened reprojection errors, errors of the stops, and what is known of the camera.

    Attributes:
        shots: the data.
        known: mean (4,) and one standard deviation (4,) of f (inf: unknown), centre, k1.
    """

    shots: TravelShots
    known: tuple[FloatArray, FloatArray]

    @property
    def names(self) -> tuple[str, ...]:
        """Camera, pose, two of the direction, then six for each stop."""
        stops = range(len(self.shots.travel_mm))
        each = tuple(f"stop {i + 1}: {name}" for i in stops for name in _POSE)
        return (*_CAMERA, *_POSE, "direction_1_rad", "direction_2_rad", *each)

    @property
    def scales(self) -> FloatArray:
        """About what moves a point by 1 px."""
        f = float(self.shots.pixels.max())
        reach = float(np.ptp(self.shots.points_target_mm, axis=0).max())
        pose = [reach / f] * 3 + [1 / f] * 3
        turns = [1e-2, 1e-2]
        return np.array(
            [1, 1, 1, 1e-2, *pose, *turns, *pose * len(self.shots.travel_mm)]
        )

    @property
    def prior_rows(self) -> int:
        """Six for each stop and one for each known number of the camera."""
        return 6 * len(self.shots.travel_mm) + int(np.isfinite(self.known[1]).sum())

    def poses(self, state: TravelState) -> tuple[FloatArray, FloatArray]:
        """(n, 3, 3) and (n, 3) of ``camera_from_target``."""
        travel = self.shots.travel_mm[:, None] * state.direction
        return (
            np.asarray(state.turn @ state.rotation),
            state.translation_mm - travel + state.shift_mm,
        )

    def residuals(self, state: TravelState) -> FloatArray:
        """Points, then errors of the stops, then the camera."""
        rotation, translation = self.poses(state)
        pixels = project(
            state.camera,
            rotation[:, None],
            translation[:, None],
            self.shots.points_target_mm,
        )
        errors = (pixels - self.shots.pixels) / self.shots.sigma_px
        turned = _vectors(state.turn) / self.shots.turn_sigma_rad
        stops = np.concatenate([state.shift_mm / self.shots.travel_sigma_mm, turned], 1)
        mean, sigma = self.known
        camera = ((_camera_values(state.camera) - mean) / sigma)[np.isfinite(sigma)]
        return np.concatenate([errors.ravel(), stops.ravel(), camera])

    def jacobian(self, state: TravelState) -> FloatArray:
        """Derivative of the residuals for a step."""
        rotation, translation = self.poses(state)
        found = project_with_derivatives(
            state.camera,
            rotation[:, None],
            translation[:, None],
            self.shots.points_target_mm,
        )
        stops, points = found.pixels.shape[:2]
        rows = np.zeros((stops, points, 2, len(self.names)))
        camera = found.d_camera
        ratio = state.camera.fy_px / state.camera.fx_px
        rows[..., 0] = camera[..., 0] + ratio * camera[..., 1]
        rows[..., 1:4] = camera[..., 2:5]
        rows[..., 4:7] = found.d_pose[..., :3]
        rows[..., 7:10] = found.d_pose[..., 3:] @ state.turn[:, None]
        slide = -self.shots.travel_mm[:, None, None] * _tangents(state.direction)
        rows[..., 10:12] = found.d_pose[..., :3] @ slide[:, None]
        for stop in range(stops):
            first = _FIXED + 6 * stop
            rows[stop, ..., first : first + 6] = found.d_pose[stop]
        white = rows.reshape(-1, len(self.names)) / self.shots.sigma_px
        return np.concatenate([white, self._prior_jacobian(stops)])

    def moved(self, state: TravelState, step: FloatArray) -> TravelState:
        """The state after a step."""
        values = _camera_values(state.camera) + step[:4]
        rotation, translation = moved_pose(
            state.rotation, state.translation_mm, step[4:10]
        )
        direction = state.direction + _tangents(state.direction) @ step[10:12]
        turn, shift = moved_pose(
            state.turn, state.shift_mm, step[_FIXED:].reshape(-1, 6)
        )
        return TravelState(
            camera_of(values, state.camera),
            rotation,
            translation,
            direction / np.linalg.norm(direction),
            shift,
            turn,
        )

    def _prior_jacobian(self, stops: int) -> FloatArray:
        shots, sigma = self.shots, self.known[1]
        each = [1 / shots.travel_sigma_mm] * 3 + [1 / shots.turn_sigma_rad] * 3
        stop_rows = np.zeros((6 * stops, len(self.names)))
        stop_rows[:, _FIXED:] = np.diag(each * stops)
        camera_rows = np.zeros((4, len(self.names)))
        camera_rows[:, :4] = np.diag(1 / sigma)
        return np.concatenate([stop_rows, camera_rows[np.isfinite(sigma)]])


def camera_of(values: FloatArray, like: PinholeCamera) -> PinholeCamera:
    """The camera with f, cx, cy, k1 and the ratio fy / fx of another."""
    f, cx, cy, k1 = (float(value) for value in values)
    ratio = like.fy_px / like.fx_px
    return replace(like, fx_px=f, fy_px=f * ratio, cx_px=cx, cy_px=cy, k1=k1)


def _camera_values(camera: PinholeCamera) -> FloatArray:
    return np.array([camera.fx_px, camera.cx_px, camera.cy_px, camera.k1])


def _tangents(direction: FloatArray) -> FloatArray:
    """(3, 2): two unit vectors square to a direction."""
    return np.asarray(np.linalg.svd(direction[None])[2][1:].T)


def _vectors(turns: FloatArray) -> FloatArray:
    """Rotation vectors (n, 3) of small rotations (n, 3, 3), to third order."""
    odd = (turns - np.swapaxes(turns, -1, -2)) / 2
    return np.stack([odd[:, 2, 1], odd[:, 0, 2], odd[:, 1, 0]], axis=-1)
