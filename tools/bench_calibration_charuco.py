"""A published eye-to-hand set with its cameras estimated anew, beside OpenCV's methods.

The board's pictures give the camera first. The figure that was published with the set is
how far, on the board, the ray of each pixel passes from its point, the robot at its word.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import f as f_ratio

from calibration.camera import CameraOptions, calibrate_camera
from calibration.estimate import fit
from calibration.hand_eye import (
    CameraPrior,
    HandEyeData,
    RobotNoise,
    calibrate_hand_eye,
    closed_form,
    target_in_fixed,
)
from calibration.hand_eye.refine import Chain, HandEyeProblem, fixed_camera
from calibration.hand_eye.target_poses import target_poses
from calibration.observations import Observations
from calibration.poses import Poses, only
from calibration.projection import PinholeCamera, to_normalised
from tools.bench_calibration_poses import MOTIONS, opencv_hand_eye, opencv_targets
from tools.bench_calibration_rows import Clock, Row

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibration.camera import CameraEstimate

CHARUCO = Path(__file__).parents[2] / "shared" / "data" / "hand_eye_charuco"
ROBOT = RobotNoise(1.0, float(np.radians(0.2)))
# The set comes with a guess and with the outcome of a calibration.
SHIPPED = {
    "f 1400": PinholeCamera(1400, 1400, 800, 600),
    "f 1352": PinholeCamera(1352.02747, 1356.14287, 789.67065, 627.2995),
}
BAR_MM = 0.75
LEAST = ("fx_px", "fy_px", "cx_px", "cy_px", "k1")
CAMERAS = {
    "f, c, k1": LEAST,
    "f, c, k1, p1, p2": (*LEAST, "p1", "p2"),
    "f, c, k1, p1, p2, k2, k3": (*LEAST, "p1", "p2", "k2", "k3"),
}
# How far the hand-eye views may move ``LEAST`` from what single pictures say.
MOVED_SIGMAS = np.array([3.0, 3.0, 3.0, 3.0, 0.01])


def charuco_data() -> HandEyeData:
    """Fifteen usable poses of a robot with a board."""
    stored = np.load(CHARUCO / "corners.npz")
    u, _, vt = np.linalg.svd(stored["G"][:, :3, :3])
    robot = Poses(u @ vt, stored["G"][:, :3, 3] * 1000)
    seen = Observations.from_views(
        [stored[f"obj{i}"] * 1000.0 for i in range(len(robot))],
        [stored[f"img{i}"].astype(float) for i in range(len(robot))],
        size_px=(1600, 1200),
    )
    return HandEyeData(robot, seen, "eye-to-hand", 0.3)


def camera_of(data: HandEyeData, free: tuple[str, ...]) -> CameraEstimate:
    """The camera by the board's pictures alone, without the robot."""
    return calibrate_camera(data.seen, CameraOptions(free=free, folds=0))


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


def slack_prior(camera: PinholeCamera, *, refined: bool) -> CameraPrior:
    """The camera held, or ``LEAST`` sought together with the transform."""
    names = LEAST if refined else ()
    return CameraPrior(camera, names, np.diag(MOVED_SIGMAS[: len(names)]) ** 2)


def by_chance(fewer: CameraEstimate, more: CameraEstimate) -> tuple[float, float]:
    """How much the sum of squares falls by more numbers, and how often it does by chance."""
    sums = [float((one.errors_px**2).sum()) for one in (fewer, more)]
    added = len(more.free.names) - len(fewer.free.names)
    left = more.errors_px.size - len(more.free.names) - 6 * len(more.view_names)
    ratio = (sums[0] - sums[1]) / added / (sums[1] / left)
    return 1 - sums[1] / sums[0], float(f_ratio.sf(ratio, added, left))


def bench_charuco(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """Measured data, so one trial: three cameras from the same pictures.

    With slack the robot is not taken at its word, but the figure still does so: it is
    smallest for the fit that does so too, and says little about the others.
    """
    del trials, rng
    if not (CHARUCO / "corners.npz").exists():
        return
    data = charuco_data()
    for words, camera in SHIPPED.items():
        yield from _as_shipped(words, data, camera)
    least = camera_of(data, LEAST)
    for words, free in CAMERAS.items():
        found = camera_of(data, free)
        share, chance = by_chance(least, found) if free != LEAST else (0.0, 1.0)
        fewer = f"sum of squares -{100 * share:.1f} %, by chance {chance:.2g}"
        yield _row(
            f"{words}: single pictures", "px", found.rms_px, fewer if share else ""
        )
        yield from _at_its_word(words, data, found.camera)
        for refined in (False, True):
            yield from _with_slack(words, data, found.camera, refined=refined)


def _as_shipped(words: str, data: HandEyeData, camera: PinholeCamera) -> Iterator[Row]:
    """The same figure, and what the verdict says instead of a transform."""
    verdict = calibrate_hand_eye(data, camera, ROBOT).verdict
    said = f"{verdict.grade}: {', '.join(sorted(verdict.codes()))}"
    off = off_the_plane_mm(data, camera, *rigid(data, camera))
    what = f"as shipped, {words}: robot at its word"
    yield _row(f"{what}, mean", "mm", float(off.mean()), said)
    yield _row(f"{what}, sd", "mm", float(off.std()))
    yield _row(f"{what}, largest", "mm", float(off.max()))


def _at_its_word(words: str, data: HandEyeData, camera: PinholeCamera) -> Iterator[Row]:
    clock = Clock()
    x, z = clock.run("rigid", lambda: rigid(data, camera))
    off = off_the_plane_mm(data, camera, x, z)
    targets, fixed = opencv_targets(data, camera), data.fixed_from_moving
    for method in MOTIONS:
        pose = opencv_hand_eye(fixed, targets, method)
        board = target_in_fixed(fixed, pose, targets)
        theirs = float(off_the_plane_mm(data, camera, pose, board).mean())
        yield _row(
            f"{words}: robot at its word, mean",
            "mm",
            float(off.mean()),
            f"OpenCV {method}",
            rival=theirs,
            bar=BAR_MM,
            seconds=clock.mean_s("rigid"),
        )
    yield _row(f"{words}: robot at its word, sd", "mm", float(off.std()))
    yield _row(f"{words}: robot at its word, largest", "mm", float(off.max()))


def _with_slack(
    words: str, data: HandEyeData, camera: PinholeCamera, *, refined: bool
) -> Iterator[Row]:
    clock, prior = Clock(), slack_prior(camera, refined=refined)
    result = clock.run("slack", lambda: calibrate_hand_eye(data, prior, ROBOT))
    found = result.solution
    pair = only(found.moving_from_camera), only(found.fixed_from_target)
    mean = float(off_the_plane_mm(data, found.camera, *pair).mean())
    how = f"{words}: slack" + (", f, c, k1 refined" if refined else "")
    spent = clock.mean_s("slack")
    yield _row(how, "mm", mean, f"verdict {result.verdict.grade}", seconds=spent)
    place_mm, turn_rad = found.robot_sigmas
    yield _row(f"{how}: robot noise", "mm", float(place_mm))
    yield _row(f"{how}: robot noise", "deg", float(np.degrees(turn_rad)))


def _row(
    what: str,
    unit: str,
    ours: float,
    against: str = "",
    *,
    rival: float | None = None,
    bar: float | None = None,
    seconds: float = 0.0,
) -> Row:
    return Row(f"ChArUco, {what}", unit, ours, rival, against, bar, None, seconds, None)
