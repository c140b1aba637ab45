"""Hand-eye and part pose beside OpenCV: the same seeded data for both."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from calibration.hand_eye import Rehearsal, RobotNoise, calibrate_hand_eye, rehearse
from calibration.part_pose import PartSight, SeenPoints, resect
from calibration.poses import Poses, difference, only
from calibration.projection import PinholeCamera, project
from tools.bench_calibration_rows import Clock, Row, rms

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibration.hand_eye import HandEyeData

SPEC = RobotNoise(0.2, float(np.radians(0.05)))
STATED = RobotNoise(1.0, float(np.radians(0.25)))
PERFECT = RobotNoise(0.05, float(np.radians(0.005)))
REHEARSED = Rehearsal().camera
MOTIONS = ("TSAI", "PARK", "HORAUD", "DANIILIDIS", "ANDREFF")
WORLDS = ("SHAH", "LI")
PAPER = PinholeCamera(13.07 / 0.01625, 13.07 / 0.0135, 255.5, 239.5)
CUBE = 25.4 * (
    np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) - 0.5
)
OWN = {
    "tsai-lenz": "our closed form, all pairs",
    "park": "our Park, all pairs",
    "daniilidis": "our Daniilidis, all pairs",
}


def opencv_pose(
    camera: PinholeCamera, points: np.ndarray, pixels: np.ndarray, start: int
) -> tuple[np.ndarray, np.ndarray]:
    """``camera_from_target`` by ``solvePnP`` and its refinement."""
    rest = camera.distortion
    _, turn, shift = cv2.solvePnP(points, pixels, camera.matrix, rest, flags=start)
    turn, shift = cv2.solvePnPRefineLM(points, pixels, camera.matrix, rest, turn, shift)
    return cv2.Rodrigues(turn)[0], shift.ravel()


def opencv_targets(data: HandEyeData, camera: PinholeCamera) -> Poses:
    """The target in every picture, by OpenCV."""
    found = [
        opencv_pose(camera, *data.seen.of_view(view), cv2.SOLVEPNP_ITERATIVE)
        for view in range(data.seen.views)
    ]
    return Poses(np.stack([r for r, _ in found]), np.stack([t for _, t in found]))


def opencv_hand_eye(fixed: Poses, targets: Poses, method: str) -> Poses:
    """``moving_from_camera`` by one of OpenCV's methods."""
    if method in WORLDS:
        inverse = fixed.inverse()
        number = getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{method}")
        found = cv2.calibrateRobotWorldHandEye(
            targets.rotation,
            targets.translation_mm,
            inverse.rotation,
            inverse.translation_mm,
            method=number,
        )
        gripper_to_camera = Poses(found[2][None], found[3].reshape(1, 3))
        return gripper_to_camera.inverse()
    turn, shift = cv2.calibrateHandEye(
        fixed.rotation,
        fixed.translation_mm,
        targets.rotation,
        targets.translation_mm,
        method=getattr(cv2, f"CALIB_HAND_EYE_{method}"),
    )
    return Poses(turn[None], shift.reshape(1, 3))


def error_of(found: Poses, truth: Poses) -> tuple[float, float]:
    """Degrees and mm."""
    step = difference(found, truth)[0]
    return float(np.degrees(np.linalg.norm(step[3:]))), float(np.linalg.norm(step[:3]))


def hand_eye_trials(
    trials: int, rng: np.random.Generator, robot: RobotNoise | None, stated: RobotNoise
) -> tuple[dict[str, np.ndarray], float, Clock]:
    """Errors (trials, 2) by method, share of ours within one sigma, and seconds."""
    clock, errors, inside = Clock(), {}, []
    for _ in range(trials):
        seen = rehearse(Rehearsal(robot=robot), rng)
        truth, data = seen.moving_from_camera, seen.data
        result = clock.run(
            "ours", lambda d=data: calibrate_hand_eye(d, REHEARSED, stated)
        )
        found = result.solution
        step = difference(only(found.moving_from_camera), truth)[0]
        inside.append(np.abs(step) < np.sqrt(np.diag(found.covariance)))
        each = {"ours": only(found.moving_from_camera)}
        each |= {name: only(pose) for name, pose in found.closed_forms.items()}
        targets = clock.run("pnp", lambda d=data: opencv_targets(d, REHEARSED))
        fixed = data.fixed_from_moving
        for method in (*MOTIONS, *WORLDS):
            each[method] = clock.run(
                method, lambda m=method, t=targets, f=fixed: opencv_hand_eye(f, t, m)
            )
        for name, pose in each.items():
            errors.setdefault(name, []).append(error_of(pose, truth))
    return {k: np.array(v) for k, v in errors.items()}, float(np.mean(inside)), clock


def bench_hand_eye(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """25 poses; a robot as its data sheet has it, and a perfect one."""
    for words, robot, stated, bars in (
        ("0.05 deg, 0.2 mm", SPEC, STATED, (0.04, 0.24)),
        ("perfect robot", None, PERFECT, (0.012, 0.06)),
    ):
        errors, honest, clock = hand_eye_trials(trials, rng, robot, stated)
        for column, (name, unit) in enumerate((("rotation", "deg"), ("place", "mm"))):
            ours = rms(errors["ours"][:, column])
            for rival in (*OWN, *MOTIONS, *WORLDS):
                own = rival in OWN
                yield Row(
                    f"hand-eye, {words}: {name}",
                    unit,
                    ours,
                    rms(errors[rival][:, column]),
                    OWN.get(rival, f"OpenCV {rival}"),
                    bars[column],
                    honest,
                    clock.mean_s("ours"),
                    None if own else clock.mean_s("pnp") + clock.mean_s(rival),
                )


def bench_part(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """Seven corners of a one-inch cube at 360 mm, 0.2 px, the camera of the paper."""
    clock, ours, rival, inside = Clock(), [], [], []
    down = Rotation.from_euler("xyz", [200, 30, 20], degrees=True)
    for _ in range(10 * trials):
        turn = (down * Rotation.from_rotvec(rng.normal(0, 0.3, 3))).as_matrix()
        place = np.array([0.0, 0, 360]) + rng.normal(0, 5, 3)
        corners = CUBE[np.argsort((CUBE @ turn.T + place)[:, 2])[:7]]
        pixels = project(PAPER, turn, place, corners) + rng.normal(0, 0.2, (7, 2))
        sight = PartSight(SeenPoints(corners, pixels, 0.2))
        best = clock.run("ours", lambda s=sight: resect(PAPER, s)).best
        theirs = clock.run(
            "cv2",
            lambda c=corners, p=pixels: opencv_pose(PAPER, c, p, cv2.SOLVEPNP_SQPNP),
        )
        truth = Poses(turn[None], place[None])
        step = difference(only(best.camera_from_part), truth)[0]
        ours.append(step)
        inside.append(np.abs(step) < best.estimate.sigmas)
        rival.append(difference(Poses(theirs[0][None], theirs[1][None]), truth)[0])
    both = np.array(ours), np.array(rival)
    lengths = (
        ("rotation", "deg", slice(3, 6), np.degrees(1.0), 0.3),
        ("across", "mm", slice(0, 2), 1.0, 0.08),
        ("depth", "mm", slice(2, 3), 1.0, 0.9),
    )
    for name, unit, columns, scale, bar in lengths:
        sizes = [rms(np.linalg.norm(e[:, columns], axis=1)) * scale for e in both]
        yield Row(
            f"part, 1-in cube, 7 corners: {name}",
            unit,
            sizes[0],
            sizes[1],
            "OpenCV solvePnP SQPNP, refined",
            bar,
            float(np.mean(inside)),
            clock.mean_s("ours"),
            clock.mean_s("cv2"),
        )
