"""Hand-eye and part pose beside OpenCV: the same seeded data for both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from calibration.estimate import fit
from calibration.hand_eye import (
    CameraPrior,
    HandEyeData,
    Rehearsal,
    RobotNoise,
    calibrate_hand_eye,
    closed_form,
    rehearse,
    target_in_fixed,
)
from calibration.hand_eye.refine import Chain, HandEyeProblem, fixed_camera
from calibration.hand_eye.target_poses import target_poses
from calibration.observations import Observations
from calibration.part_pose import PartSight, SeenPoints, resect
from calibration.poses import Poses, difference, only
from calibration.projection import PinholeCamera, project, to_normalised
from tools.bench_calibration_rows import Clock, Row, rms

if TYPE_CHECKING:
    from collections.abc import Iterator

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
CHARUCO = Path(__file__).parents[2] / "shared" / "data" / "hand_eye_charuco"
CHARUCO_ROBOT = RobotNoise(1.0, float(np.radians(0.2)))
FITTED = PinholeCamera(1347.032, 1349.172, 772.830, 630.640, -0.0494739)


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
        each["closed"] = only(found.closed_forms["tsai-lenz"])
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
            for rival in ("closed", *MOTIONS, *WORLDS):
                own = rival == "closed"
                yield Row(
                    f"hand-eye, {words}: {name}",
                    unit,
                    ours,
                    rms(errors[rival][:, column]),
                    "our closed form, all pairs" if own else f"OpenCV {rival}",
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


def charuco_data() -> HandEyeData:
    """The published eye-to-hand set: fifteen usable poses of a robot with a board."""
    stored = np.load(CHARUCO / "corners.npz")
    u, _, vt = np.linalg.svd(stored["G"][:, :3, :3])
    robot = Poses(u @ vt, stored["G"][:, :3, 3] * 1000)
    seen = Observations.from_views(
        [stored[f"obj{i}"] * 1000.0 for i in range(len(robot))],
        [stored[f"img{i}"].astype(float) for i in range(len(robot))],
        size_px=(1600, 1200),
    )
    return HandEyeData(robot, seen, "eye-to-hand", 0.3)


def off_the_plane_mm(
    data: HandEyeData, camera: PinholeCamera, x: Poses, z: Poses
) -> np.ndarray:
    """Distances of pixels' rays from their points on the board, the robot at its word."""
    pose = x.inverse() @ data.fixed_from_moving.inverse() @ z
    rows = data.seen.view
    points = Poses(pose.rotation[rows], pose.translation_mm[rows]).apply(
        data.seen.points_target_mm
    )
    rays = np.pad(
        to_normalised(camera, data.seen.pixels), ((0, 0), (0, 1)), constant_values=1.0
    )
    normals = pose.rotation[rows][:, :, 2]
    reach = (normals * points).sum(axis=1) / (normals * rays).sum(axis=1)
    return np.asarray(np.linalg.norm(rays * reach[:, None] - points, axis=1))


def rigid(data: HandEyeData, camera: PinholeCamera) -> tuple[Poses, Poses]:
    """The robot taken at its word: all error is the picture's."""
    fixed = data.fixed_from_moving
    targets = target_poses(data, camera).camera_from_target
    x = closed_form(fixed, targets)
    start = Chain(camera, x, target_in_fixed(fixed, x, targets), data.base_from_tool)
    problem = HandEyeProblem(data, fixed_camera(camera), np.repeat([1e-4, 1e-7], 3))
    state = fit(problem, start).state
    return state.moving_from_camera, state.fixed_from_target


def bench_charuco(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """The ChArUco set: mean distance on the board; measured data, so one trial.

    With slack the robot is not taken at its word, but this figure still does: it is
    smallest for the fit that does so too, and says little about the others.
    """
    del trials, rng
    if not (CHARUCO / "corners.npz").exists():
        return
    data, clock = charuco_data(), Clock()
    x, z = clock.run("rigid", lambda: rigid(data, FITTED))
    ours = float(off_the_plane_mm(data, FITTED, x, z).mean())
    targets, fixed = opencv_targets(data, FITTED), data.fixed_from_moving
    for method in MOTIONS:
        pose = opencv_hand_eye(fixed, targets, method)
        board = target_in_fixed(fixed, pose, targets)
        yield Row(
            "ChArUco set, on the board, robot at its word",
            "mm",
            ours,
            float(off_the_plane_mm(data, FITTED, pose, board).mean()),
            f"OpenCV {method}",
            0.75,
            None,
            clock.mean_s("rigid"),
            None,
        )
    for words, names in (
        ("with slack", ()),
        ("with slack, f, c, k1 refined", ("fx_px", "fy_px", "cx_px", "cy_px", "k1")),
    ):
        prior = CameraPrior(
            FITTED, names, np.diag([3.0, 3, 3, 3, 0.01][: len(names)]) ** 2
        )
        result = clock.run(
            words, lambda p=prior: calibrate_hand_eye(data, p, CHARUCO_ROBOT)
        )
        found = result.solution
        pair = only(found.moving_from_camera), only(found.fixed_from_target)
        mean = float(off_the_plane_mm(data, found.camera, *pair).mean())
        name = f"ChArUco set, on the board, {words}"
        yield Row(name, "mm", mean, None, "", None, None, clock.mean_s(words), None)
