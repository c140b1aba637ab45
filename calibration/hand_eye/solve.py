"""Hand-eye calibration from start to verdict."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

import numpy as np

from calibration.estimate import weakest_direction
from calibration.hand_eye import half_turn, judge
from calibration.hand_eye.closed_form import Method, closed_form, target_in_fixed
from calibration.hand_eye.left_out import left_out_mm
from calibration.hand_eye.motions import all_pairs
from calibration.hand_eye.noise import refine
from calibration.hand_eye.observability import observability
from calibration.hand_eye.readings import angle_causes, check_readings
from calibration.hand_eye.refine import (
    CameraPrior,
    Chain,
    HandEyeProblem,
    camera_from_target,
    fixed_camera,
)
from calibration.hand_eye.result import HandEyeResult, HandEyeSolution
from calibration.hand_eye.target_poses import target_poses
from calibration.poses import difference
from calibration.projection import POSE_NAMES
from calibration.verdict import judged

if TYPE_CHECKING:
    from calibration.hand_eye.data import HandEyeData, RobotNoise
    from calibration.hand_eye.judge import HandEyeLimits
    from calibration.hand_eye.noise import Refined
    from calibration.hand_eye.readings import ReadingCheck
    from calibration.hand_eye.target_poses import TargetPoses
    from calibration.poses import Poses
    from calibration.projection import PinholeCamera
    from calibration.verdict import Cause
    from mvp.geometry import Pose

_FATAL = ("reading", "unit", "no-reading-fits", "half-turned", "pose-stuck")
_UNEXPLAINED_SIGMAS = 10.0
_HOPELESS_SHARE = 0.2


def calibrate_hand_eye(
    data: HandEyeData,
    camera: PinholeCamera | CameraPrior,
    robot: RobotNoise,
    limits: HandEyeLimits | None = None,
) -> HandEyeResult:
    """Find where the camera sits on the hand (or beside the robot), and judge it.

    Args:
        data: robot poses and pictures.
        camera: intrinsics, or intrinsics with a prior to be refined together.
        robot: how far off a reported pose may be.
        limits: what the result must keep.

    Raises:
        CalibrationError: a picture that shows too little of the target; named.
    """
    limits = limits or judge.HandEyeLimits()
    prior = camera if isinstance(camera, CameraPrior) else fixed_camera(camera)
    early = judge.of_data(data)
    if len(data.base_from_tool) < judge.LEAST_VIEWS:
        return HandEyeResult(data.mount, judged(early))
    targets = target_poses(data, prior.camera)
    fixed = data.fixed_from_moving
    motions = all_pairs(fixed, targets.camera_from_target)
    seen = observability(motions, data.frames[0])
    early += angle_causes(motions) or seen.causes()
    if not seen.determined:
        return HandEyeResult(data.mount, judged(early), None, seen)
    readings, told = _checked(data, targets, robot)
    if any(cause.code in _FATAL for cause in told) or (
        not prior.names and judged(told).grade == "no-go"
    ):
        pictures = judge.of_pictures(targets.variance_factor)
        verdict = judged(told, early, pictures)
        return HandEyeResult(data.mount, verdict, None, seen, readings)
    solution = _solved(data, prior, robot, targets)
    if prior.names:
        targets = target_poses(data, solution.camera)
        readings, told = _checked(data, targets, robot)
    late = judge.of_solution(solution, data, robot, limits)
    verdict = judged(told, early, late, judge.of_pictures(targets.variance_factor))
    return HandEyeResult(data.mount, verdict, solution, seen, readings)


def _checked(
    data: HandEyeData, targets: TargetPoses, robot: RobotNoise
) -> tuple[ReadingCheck, tuple[Cause, ...]]:
    """Readings of the robot's numbers, and what speaks against the one told."""
    poses = targets.camera_from_target
    readings = check_readings(data.base_from_tool, poses, data.mount)
    clear = judge.stuck(data, poses)
    clear = clear or half_turn.causes(data.fixed_from_moving, poses, data.seen.names)
    hopeless = _HOPELESS_SHARE * _distance_mm(poses)
    return readings, clear or readings.causes(_explained_mm(poses, robot), hopeless)


def _solved(
    data: HandEyeData, prior: CameraPrior, robot: RobotNoise, targets: TargetPoses
) -> HandEyeSolution:
    start = _start(data, prior.camera, targets)
    sure = targets.nearest(camera_from_target(start, data, data.base_from_tool))
    start = _start(data, prior.camera, sure)
    refined = refine(HandEyeProblem(data, prior, robot.sigmas), start)
    moving, _ = data.frames
    closed: dict[str, Pose] = {
        method: closed_form(
            data.fixed_from_moving, sure.camera_from_target, method
        ).pose(0, moving, "camera")
        for method in get_args(Method)
    }
    return _solution(data, refined, closed)


def _start(data: HandEyeData, camera: PinholeCamera, targets: TargetPoses) -> Chain:
    fixed, seen = data.fixed_from_moving, targets.camera_from_target
    x = closed_form(fixed, seen)
    return Chain(camera, x, target_in_fixed(fixed, x, seen), data.base_from_tool)


def _solution(
    data: HandEyeData, refined: Refined, closed: dict[str, Pose]
) -> HandEyeSolution:
    state, estimate = refined.fit.state, refined.fit.estimate
    moving, fixed = data.frames
    covariance = estimate.covariance[:6, :6]
    return HandEyeSolution(
        moving_from_camera=state.moving_from_camera.pose(0, moving, "camera"),
        fixed_from_target=state.fixed_from_target.pose(0, fixed, "target"),
        covariance=covariance,
        weakest=weakest_direction(POSE_NAMES, covariance, refined.problem.scales[:6]),
        estimate=estimate,
        camera=state.camera,
        closed_forms=closed,
        slack=difference(state.base_from_tool, data.base_from_tool),
        robot_sigmas=refined.robot_sigmas,
        robot_freedom=refined.freedom,
        sigma_px=refined.sigma_px,
        left_out_mm=left_out_mm(refined),
    )


def _explained_mm(targets: Poses, robot: RobotNoise) -> float:
    """Misfit of two motions that the robot's stated noise could just explain."""
    one = np.hypot(robot.position_mm, robot.angle_rad * _distance_mm(targets))
    return float(_UNEXPLAINED_SIGMAS * one)


def _distance_mm(targets: Poses) -> float:
    return float(np.linalg.norm(targets.translation_mm, axis=1).mean())
