"""A hand-eye calibration whose truth is known: for forecasts, benchmarks and training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.hand_eye.data import HandEyeData, RobotNoise
from calibration.observations import Observations
from calibration.poses import Poses
from calibration.projection import PinholeCamera, project

if TYPE_CHECKING:
    from calibration.hand_eye.motions import Mount
    from mvp.geometry import FloatArray

_CAMERA = PinholeCamera(2272.0, 2272.0, 799.5, 599.5)


@dataclass(frozen=True)
class Rehearsal:
    """How the views are taken.

    Attributes:
        views: how many.
        tilt_deg: greatest tilt of the target, uniform on the disc.
        roll_deg: greatest roll about the optical axis, both ways.
        stand_off_mm: nearest and farthest distance of the target's middle.
        robot: true noise of the robot; None for a perfect one.
        sigma_px: true noise of found points.
        stated_px: what is said of it; as it is when None.
        mount: where the camera is.
        camera: true intrinsics.
        size_px: columns and rows of the picture.
        columns: points of the target across.
        rows: points of the target down.
        pitch_mm: distance between points.
    """

    views: int = 25
    tilt_deg: float = 30.0
    roll_deg: float = 60.0
    stand_off_mm: tuple[float, float] = (350.0, 500.0)
    robot: RobotNoise | None = None
    sigma_px: float = 0.2
    stated_px: float | None = None
    mount: Mount = "eye-in-hand"
    camera: PinholeCamera = _CAMERA
    size_px: tuple[int, int] = (1600, 1200)
    columns: int = 11
    rows: int = 8
    pitch_mm: float = 12.0


@dataclass(frozen=True, eq=False)
class Rehearsed:
    """Data as measured, and the truth behind them (sets of one, and of n)."""

    data: HandEyeData
    moving_from_camera: Poses
    fixed_from_target: Poses
    camera_from_target: Poses
    base_from_tool: Poses


def rehearse(plan: Rehearsal, rng: np.random.Generator) -> Rehearsed:
    """Take all views of a made-up cell."""
    points = _target(plan)
    target = _views(plan, points.mean(axis=0), rng)
    x = _pose([5.0, -8.0, 30.0], [60.0, -40.0, 90.0])
    z = _pose([2.0, 3.0, 20.0], [500.0, 100.0, -50.0])
    fixed_from_moving = z @ target.inverse() @ x.inverse()
    in_hand = plan.mount == "eye-in-hand"
    robot = fixed_from_moving if in_hand else fixed_from_moving.inverse()
    found = project(
        plan.camera,
        target.rotation[:, None],
        target.translation_mm[:, None],
        points[None],
    )
    found = found + rng.normal(0.0, plan.sigma_px, found.shape)
    data = HandEyeData(
        _told(robot, plan.robot, rng),
        Observations.from_views(
            [points] * plan.views, list(found), size_px=plan.size_px
        ),
        plan.mount,
        plan.stated_px or plan.sigma_px or 1e-3,
    )
    return Rehearsed(data, x, z, target, robot)


def _target(plan: Rehearsal) -> FloatArray:
    across, down = np.meshgrid(np.arange(plan.columns), np.arange(plan.rows))
    flat = np.stack([across.ravel(), down.ravel(), np.zeros(across.size)], axis=1)
    return np.asarray(flat * plan.pitch_mm, dtype=np.float64)


def _views(plan: Rehearsal, middle: FloatArray, rng: np.random.Generator) -> Poses:
    """``camera_from_target`` of all views; the target faces the camera."""
    count = plan.views
    tilt = np.radians(plan.tilt_deg) * np.sqrt(rng.random(count))
    side = rng.uniform(0, 2 * np.pi, count)
    roll = np.radians(rng.uniform(-plan.roll_deg, plan.roll_deg, count))
    tilted = np.stack([tilt * np.cos(side), tilt * np.sin(side), 0 * side], axis=1)
    rolled = np.stack([0 * roll, 0 * roll, roll], axis=1)
    rotation = (
        Rotation.from_rotvec(rolled)
        * Rotation.from_rotvec(tilted)
        * Rotation.from_rotvec([np.pi, 0.0, 0.0])
    ).as_matrix()
    near, far = plan.stand_off_mm
    aim = 0.04 * near * rng.uniform(-1, 1, (count, 2))
    centre = np.column_stack([aim, rng.uniform(near, far, count)])
    return Poses(rotation, centre - rotation @ middle)


def _told(robot: Poses, noise: RobotNoise | None, rng: np.random.Generator) -> Poses:
    if noise is None:
        return robot
    turn = Rotation.from_rotvec(rng.normal(0.0, noise.angle_rad, (len(robot), 3)))
    shift = rng.normal(0.0, noise.position_mm, (len(robot), 3))
    return Poses(turn.as_matrix() @ robot.rotation, robot.translation_mm + shift)


def _pose(angles_deg: list[float], translation_mm: list[float]) -> Poses:
    rotation = Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()
    return Poses(rotation[None], np.array([translation_mm]))
