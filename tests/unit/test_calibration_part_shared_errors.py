"""Errors that all pictures of a part share: of the intrinsics and of the hand-eye."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.part_pose import (
    HandEye,
    PartSight,
    PartView,
    SeenEdges,
    SeenPoints,
    by_camera,
    judge_located,
    locate,
    resect,
)
from calibration.poses import difference, only
from calibration.projection import PinholeCamera, project
from mvp.geometry import Pose

CAMERA = PinholeCamera(2600.0, 2590.0, 640.0, 510.0, k1=-0.08)
NAMES = ("fx_px", "fy_px", "cx_px", "cy_px", "k1")
ROBOT = np.diag([0.02] * 3 + [5e-5] * 3) ** 2
PICTURE = np.diag([0.02] * 3 + [1e-4] * 3) ** 2


def corners() -> np.ndarray:
    ends = np.array([-20.0, 20.0])
    return np.stack(np.meshgrid(ends, ends, ends), axis=-1).reshape(-1, 3)


def seen(camera: PinholeCamera, pose: Pose) -> PartSight:
    pixels = project(camera, pose.rotation, pose.translation_mm, corners())
    return PartSight(SeenPoints(corners(), pixels, 0.1))


def looking(rng, distance_mm=350.0) -> Pose:
    turn = Rotation.random(rng=rng).as_matrix()
    return Pose("camera", "part", turn, np.array([3.0, -2.0, distance_mm]))


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_camera_moves_the_pose_as_its_lever_says(name):
    rng = np.random.default_rng(1)
    pose = looking(rng)
    step = {"k1": 2e-3}.get(name, 1.0)
    true = CAMERA.with_values(
        CAMERA.values + step * np.array([n == name for n in CAMERA.names])
    )
    sight = seen(true, pose)
    found = resect(CAMERA, sight).best
    lever = by_camera(CAMERA, sight, found, [name])[:, 0]
    moved = difference(only(pose), only(found.camera_from_part))[0]
    size = np.array([1.0] * 3 + [30.0] * 3)
    assert np.linalg.norm((moved - step * lever) * size) < 0.06 * np.linalg.norm(
        moved * size
    )


def test_a_sigma_for_each_place_weighs_like_as_many_pictures():
    """A place known twice as well counts like four places."""
    rng = np.random.default_rng(2)
    pose = looking(rng)
    ends = corners().reshape(-1, 2, 3)
    places = (ends[:, :1] * [[0.8], [0.2]] + ends[:, 1:] * [[0.2], [0.8]]).reshape(
        -1, 3
    )
    pixels = project(CAMERA, pose.rotation, pose.translation_mm, places)
    edge = np.repeat(np.arange(len(ends)), 2)
    rest = SeenPoints(
        corners()[:5],
        project(CAMERA, pose.rotation, pose.translation_mm, corners()[:5]),
        0.1,
    )
    sharp = SeenEdges(ends, pixels, edge, 0.1, each_sigma_px=np.full(len(pixels), 0.05))
    often = SeenEdges(ends, np.tile(pixels, (4, 1)), np.tile(edge, 4), 0.1)
    one, other = (
        resect(CAMERA, PartSight(points=rest, edges=edges), near=pose).best.estimate
        for edges in (sharp, often)
    )
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-3)


def test_a_sigma_of_nothing_is_refused():
    ends, pixels = corners().reshape(-1, 2, 3)[:1], np.zeros((2, 2))
    with pytest.raises(ValueError, match="positive sigma"):
        SeenEdges(ends, pixels, np.zeros(2, np.int64), each_sigma_px=np.zeros(2))


def crossed(rng, eye):
    """Views from four sides through a hand-eye transform with a drawn error."""
    part = Pose.from_rotvec("base", "part", [0.1, 0.2, 0.3], [-400.0, 100, 50])
    true = Pose.from_rotvec("tool", "camera", [0.0, 0, 0.4], [2.0, -60, 100])
    step = rng.multivariate_normal(np.zeros(6), eye)
    told = Pose(
        "tool",
        "camera",
        Rotation.from_rotvec(-step[3:]).as_matrix() @ true.rotation,
        true.translation_mm - step[:3],
    )
    views = []
    for _ in range(4):
        there = looking(rng)
        noisy = rng.multivariate_normal(np.zeros(6), PICTURE)
        picture = Pose(
            "camera",
            "part",
            Rotation.from_rotvec(noisy[3:]).as_matrix() @ there.rotation,
            there.translation_mm + noisy[:3],
        )
        tool = part @ there.inverse() @ true.inverse()
        off = rng.multivariate_normal(np.zeros(6), ROBOT)
        told_tool = Pose(
            "base",
            "tool",
            Rotation.from_rotvec(off[3:]).as_matrix() @ tool.rotation,
            tool.translation_mm + off[:3],
        )
        views.append(PartView(picture, PICTURE, told_tool))
    return part, views, HandEye(told, eye, ROBOT)


def test_views_that_a_wrong_hand_eye_moves_apart_do_not_contradict_each_other():
    eye = np.diag([0.5] * 3 + [2e-3] * 3) ** 2
    rng = np.random.default_rng(3)
    causes, pulls = 0, []
    for _ in range(30):
        part, views, known = crossed(rng, eye)
        found = locate(views, known)
        causes += bool(judge_located(found).causes)
        step = difference(only(part), only(found.base_from_part))[0]
        pulls.append(step @ np.linalg.solve(found.covariance, step))
    assert causes == 0
    assert np.mean(pulls) == pytest.approx(6.0, abs=2.0)


def test_a_part_that_moved_between_the_views_is_told_from_a_wrong_hand_eye():
    eye = np.diag([0.05] * 3 + [1e-4] * 3) ** 2
    _, views, known = crossed(np.random.default_rng(4), eye)
    moved = Pose("part", "part", np.eye(3), np.array([2.0, 0, 0]))
    views[2] = PartView(
        views[2].camera_from_part @ moved, PICTURE, views[2].base_from_tool
    )
    codes = {cause.code for cause in judge_located(locate(views, known)).causes}
    assert codes == {"views-disagree"}


def test_an_uncertain_camera_widens_the_pose_and_more_pictures_do_not_help_that():
    rng = np.random.default_rng(5)
    pose = looking(rng)
    sight = seen(CAMERA, pose)
    best = resect(CAMERA, sight).best
    lever = by_camera(CAMERA, sight, best, ["fx_px", "fy_px"])
    tool = Pose.identity("base", "tool")
    known = HandEye(
        Pose.identity("tool", "camera"), np.zeros((6, 6)), 1e-12 * np.eye(6)
    )
    scale = np.outer([26.0, 25.9], [26.0, 25.9])  # 1 % of the focal length
    view = PartView(pose, PICTURE, tool, lever)
    spreads = [
        np.sqrt(np.diag(locate([view] * count, known, scale).covariance)[2])
        for count in (1, 16)
    ]
    assert spreads[0] == pytest.approx(3.5, rel=0.1)
    assert spreads[1] == pytest.approx(spreads[0], rel=0.02)


def test_a_view_without_its_camera_lever_is_refused():
    view = PartView(
        looking(np.random.default_rng(6)), PICTURE, Pose.identity("base", "tool")
    )
    known = HandEye(Pose.identity("tool", "camera"), np.zeros((6, 6)), ROBOT)
    with pytest.raises(ValueError, match="by_camera"):
        locate([view], known, np.eye(2))
