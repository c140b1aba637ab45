"""What speaks against a hand-eye calibration, before and after the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2

from calibration.verdict import Cause, Limit

if TYPE_CHECKING:
    from calibration.hand_eye.data import HandEyeData, RobotNoise
    from calibration.hand_eye.result import HandEyeSolution
    from calibration.poses import Poses
    from mvp.geometry import BoolArray

LEAST_VIEWS = 5
_IMPROBABLE = 1e-3
_OUTLIER_SIGMAS = 5.0
_EXPLAINED_SIGMAS = 2.0
_SAME_MM, _SAME_RAD = 1.0, float(np.radians(0.3))
_CLEARLY = 10.0

_VIEWS = Limit(
    "few-views",
    "the number of views from distinct poses",
    "",
    marginal=12,
    no_go=8,
    action="take 20 views or more",
    at_least=True,
)
_INTRINSICS = Limit(
    "intrinsics-do-not-fit",
    "intrinsics do not fit: residual of single pictures by their stated noise",
    "",
    marginal=1.5,
    no_go=3.0,
    action="calibrate the camera again at this lens setting, or refine its intrinsics "
    "here with a prior",
)


@dataclass(frozen=True)
class HandEyeLimits:
    """What a result must keep.

    Attributes:
        stand_off_mm: distance at which the camera will work.
        marginal_mm: error there (or at the target of a view left out) that is marginal.
        no_go_mm: error that is not to be used.
    """

    stand_off_mm: float = 400.0
    marginal_mm: float = 1.0
    no_go_mm: float = 3.0


def of_data(data: HandEyeData) -> tuple[Cause, ...]:
    """Number of views, and an arm that was still moving."""
    causes = _VIEWS.check(distinct_poses(data.base_from_tool))
    moving = [
        name
        for name, settled in zip(data.seen.names, data.settled, strict=False)
        if not settled
    ]
    if moving:
        causes += (
            Cause(
                "robot-moving",
                "no-go",
                f"the robot was moving in {', '.join(moving)}",
                "take these views again and wait until the arm stands still",
            ),
        )
    return causes


def distinct_poses(poses: Poses) -> int:
    """How many poses differ from all that came before."""
    return int((~np.tril(_same(poses, 1.0), -1).any(axis=1)).sum())


def stuck(data: HandEyeData, camera_from_target: Poses) -> tuple[Cause, ...]:
    """Views whose robot pose is that of another one, while their pictures differ."""
    wrong = _same(data.base_from_tool, 1.0) & ~_same(camera_from_target, _CLEARLY)
    if not wrong.any():
        return ()
    listed = zip(data.seen.names, np.any(wrong, axis=1).tolist(), strict=True)
    names = ", ".join(name for name, is_it in listed if is_it)
    return (
        Cause(
            "pose-stuck",
            "no-go",
            f"the robot told one pose for different pictures: {names}",
            "read the pose after the arm has settled, and anew for every picture",
        ),
    )


def _same(poses: Poses, times: float) -> BoolArray:
    """(n, n): which poses are one and the same, within so many times 1 mm, 0.3 deg."""
    apart = poses.translation_mm[:, None] - poses.translation_mm
    turned = np.einsum("iab,jab->ij", poses.rotation, poses.rotation)
    angle = np.arccos(np.clip((turned - 1) / 2, -1, 1))
    near = np.linalg.norm(apart, axis=2) < times * _SAME_MM
    return np.asarray(near & (angle < times * _SAME_RAD))


def of_pictures(variance_factor: float) -> tuple[Cause, ...]:
    """Do the intrinsics explain single pictures, with the pose of each free?"""
    return _INTRINSICS.check(float(np.sqrt(variance_factor)))


def of_solution(
    solution: HandEyeSolution,
    data: HandEyeData,
    robot: RobotNoise,
    limits: HandEyeLimits,
) -> tuple[Cause, ...]:
    """Robot against its datasheet, single views, errors in mm."""
    forecast = Limit(
        "error-large",
        f"the expected error at {limits.stand_off_mm:.0f} mm",
        "mm",
        limits.marginal_mm,
        limits.no_go_mm,
        "take more views with larger rotations",
    )
    held = Limit(
        "left-out-error-large",
        "the error at the target in views left out of the fit",
        "mm",
        limits.marginal_mm,
        limits.no_go_mm,
        "look at the views with the largest slack; check that target and camera are "
        "fixed firmly",
    )
    left_out = float(np.sqrt((solution.left_out_mm**2).mean()))
    return (
        *_robot(solution, robot),
        *_outliers(solution, data, robot),
        *held.check(left_out),
        *forecast.check(solution.error_mm(limits.stand_off_mm)),
    )


def _robot(solution: HandEyeSolution, robot: RobotNoise) -> tuple[Cause, ...]:
    """A robot that contradicts itself by more than was stated."""
    stated = np.array([robot.position_mm, robot.angle_rad])
    freedom = np.maximum(solution.robot_freedom, 1.0)
    limit = np.sqrt(chi2.isf(_IMPROBABLE, freedom) / freedom)
    ratio = solution.robot_sigmas / stated
    if (ratio <= limit).all():
        return ()
    position, angle = solution.robot_sigmas[0], np.degrees(solution.robot_sigmas[1])
    return (
        Cause(
            "robot-contradicts-itself",
            "no-go",
            f"the robot's poses disagree by {position:.3g} mm and {angle:.3g} deg (one "
            f"sigma on each axis); {stated[0]:.3g} mm and {np.degrees(stated[1]):.3g} "
            "deg were stated",
            "check the robot's calibration, its payload and tool settings, and that "
            "camera and target are fixed firmly",
        ),
    )


def _outliers(
    solution: HandEyeSolution, data: HandEyeData, robot: RobotNoise
) -> tuple[Cause, ...]:
    """Views that stand apart from the others, measured by their typical slack.

    A robot that is much better than stated has views that differ by next to nothing:
    what its stated noise explains is not held against it.
    """
    size = np.linalg.norm(solution.slack.reshape(-1, 2, 3), axis=2)
    typical = np.median(size, axis=0)
    stated = np.array([robot.position_mm, robot.angle_rad])
    limit = np.maximum(_OUTLIER_SIGMAS * typical, _EXPLAINED_SIGMAS * stated)
    far = (size > limit).any(axis=1)
    names = [name for name, apart in zip(data.seen.names, far, strict=True) if apart]
    if not names:
        return ()
    return (
        Cause(
            "views-apart",
            "marginal",
            f"the robot pose does not fit the picture in {', '.join(names)}",
            "leave these views out or take them again",
        ),
    )
