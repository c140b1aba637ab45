"""Several views of a part, its place in the cell, and the viewpoint that follows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.part_pose import (
    HandEye,
    PartView,
    judge_located,
    locate,
    viewpoint_covariance,
)
from calibration.poses import difference, only
from mvp.geometry import Pose
from mvp.kinematics.camera_pose import base_from_part, base_from_tool
from mvp.planning.probability_errors import camera_spread

ROBOT = np.diag([0.1, 0.1, 0.1, 5e-4, 5e-4, 5e-4]) ** 2
EYE = np.diag([0.3, 0.3, 0.5, 1e-3, 1e-3, 2e-3]) ** 2
PICTURE = np.diag([0.05, 0.05, 0.5, 3e-3, 3e-3, 1e-3]) ** 2
NOTHING = np.zeros((6, 6))


def random_pose(rng, target, source, size_mm=300.0):
    turn = Rotation.random(rng=rng).as_matrix()
    return Pose(target, source, turn, rng.normal(0, size_mm, 3))


def nudged(rng, pose, covariance):
    step = rng.multivariate_normal(np.zeros(6), covariance)
    turn = Rotation.from_rotvec(step[3:]).as_matrix()
    return Pose(
        pose.target, pose.source, turn @ pose.rotation, pose.translation_mm + step[:3]
    )


def cell(rng, views):
    """True part, hand-eye, tools and pictures."""
    part = random_pose(rng, "base", "part")
    x = random_pose(rng, "tool", "camera", 80.0)
    seen = [
        Pose(
            "camera",
            "part",
            Rotation.random(rng=rng).as_matrix(),
            np.array([0.0, 0, 360]) + rng.normal(0, 10, 3),
        )
        for _ in range(views)
    ]
    tools = [part @ s.inverse() @ x.inverse() for s in seen]
    return part, x, tools, seen


def measured(rng, x, tools, seen, robot=ROBOT, eye=EYE, picture=PICTURE):
    """The truth is the told plus its error, as all covariances here mean it."""
    views = [
        PartView(
            nudged(rng, s, picture), picture + 1e-18 * np.eye(6), nudged(rng, t, robot)
        )
        for s, t in zip(seen, tools, strict=True)
    ]
    return views, HandEye(nudged(rng, x, eye), eye, robot)


def test_from_the_planned_view_to_the_gripper_and_back_is_exact():
    rng = np.random.default_rng(0)
    for _ in range(20):
        part, x, tools, seen = cell(rng, 1)
        back = base_from_part(tools[0], x, seen[0].inverse())
        np.testing.assert_allclose(back.matrix, part.matrix, atol=1e-10)
        tool = base_from_tool(back, seen[0].inverse(), x)
        np.testing.assert_allclose(tool.rotation, tools[0].rotation, atol=1e-12)
        size = np.abs(tools[0].translation_mm).max()
        np.testing.assert_allclose(
            tool.translation_mm / size, tools[0].translation_mm / size, atol=1e-12
        )
        found = locate([PartView(seen[0], PICTURE, tools[0])], HandEye(x, EYE, ROBOT))
        np.testing.assert_allclose(found.base_from_part.matrix, back.matrix, atol=1e-9)


def test_the_stated_covariance_of_a_located_part_is_that_of_its_errors():
    rng = np.random.default_rng(1)
    part, x, tools, seen = cell(rng, 3)
    pulls = []
    for _ in range(150):
        found = locate(*measured(rng, x, tools, seen))
        step = difference(only(found.base_from_part), only(part))[0]
        pulls.append(step @ np.linalg.solve(found.covariance, step) / 6)
    assert np.mean(pulls) == pytest.approx(1.0, abs=0.2)


def test_more_views_help_down_to_the_floor_of_the_hand_eye():
    rng = np.random.default_rng(2)
    sizes = []
    for count in (1, 4, 16, 64):
        _, x, tools, seen = cell(rng, count)
        found = locate(*measured(rng, x, tools, seen, eye=NOTHING))
        sizes.append(np.sqrt(np.trace(found.own_covariance[:3, :3])))
    assert sizes[2] < 0.35 * sizes[0]
    assert sizes[3] == pytest.approx(sizes[2] / 2, rel=0.35)
    _, x, tools, seen = cell(rng, 1)
    views, eye = measured(rng, x, tools * 40, seen * 40)
    total = locate(views, eye).covariance
    assert np.sqrt(np.trace(total[:3, :3])) > 0.6


def test_an_error_of_the_hand_eye_cancels_at_the_view_that_located_the_part():
    rng = np.random.default_rng(3)
    _, x, tools, seen = cell(rng, 1)
    eye = HandEye(x, EYE, 1e-12 * np.eye(6))
    found = locate([PartView(seen[0], 1e-12 * np.eye(6), tools[0])], eye)
    same = camera_spread(viewpoint_covariance(seen[0].inverse(), found, eye))
    turn = Pose.from_rotvec("camera", "camera", [0, 0, np.pi / 2], [0, 0, 0])
    other = viewpoint_covariance((turn @ seen[0]).inverse(), found, eye)
    assert same.position_mm < 1e-3
    assert camera_spread(other).position_mm > 0.3


def test_the_predicted_error_of_a_viewpoint_is_that_of_many_trials():
    rng = np.random.default_rng(4)
    part, x, tools, seen = cell(rng, 2)
    planned = Pose.from_rotvec("part", "camera", [2.8, 0.4, 0.3], [40, -60, 380])
    steps, stated = [], []
    for _ in range(200):
        views, eye = measured(rng, x, tools, seen)
        found = locate(views, eye)
        sent = base_from_tool(found.base_from_part, planned, eye.tool_from_camera)
        stands = part.inverse() @ nudged(rng, sent, ROBOT) @ x
        steps.append(difference(only(stands), only(planned))[0])
        stated.append(viewpoint_covariance(planned, found, eye))
    steps, covariance = np.array(steps), np.mean(stated, axis=0)
    pulls = np.einsum("ni,ij,nj->n", steps, np.linalg.inv(covariance), steps) / 6
    assert pulls.mean() == pytest.approx(1.0, abs=0.15)
    error = camera_spread(covariance)
    distance = np.linalg.norm(steps[:, :3], axis=1)
    assert np.sqrt((distance**2).mean()) == pytest.approx(error.position_mm, rel=0.12)
    assert 0.90 <= (distance < error.position_95_mm).mean() <= 0.985
    turns = np.linalg.norm(steps[:, 3:], axis=1)
    assert 0.90 <= (turns < error.angle_95_rad).mean() <= 0.985


def test_views_that_disagree_are_refused_and_the_worst_is_named():
    rng = np.random.default_rng(5)
    _, x, tools, seen = cell(rng, 4)
    views, eye = measured(rng, x, tools, seen, eye=NOTHING)
    assert judge_located(locate(views, eye)).grade == "go"
    shift = Pose.from_rotvec("base", "base", [0, 0, 0], [0, 9, 0])
    views[2] = PartView(
        views[2].camera_from_part, PICTURE, shift @ views[2].base_from_tool
    )
    verdict = judge_located(locate(views, eye))
    assert verdict.grade == "no-go"
    assert "view 3" in verdict.reasons[0]


def test_no_view_is_a_misuse():
    with pytest.raises(ValueError, match="one view"):
        locate([], HandEye(Pose.identity("tool", "camera"), EYE, ROBOT))
