"""A published eye-to-hand set: sixteen robot poses, a ChArUco target on the hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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
from calibration.poses import Poses
from calibration.projection import PinholeCamera, to_normalised

FOLDER = Path(__file__).parents[2].parent / "shared" / "data" / "hand_eye_charuco"
pytestmark = pytest.mark.skipif(
    not (FOLDER / "corners.npz").exists(), reason="the ChArUco set is not here"
)
SHIPPED = PinholeCamera(1400, 1400, 800, 600)
FITTED = PinholeCamera(1347.032, 1349.172, 772.830, 630.640, -0.0494739)
ROBOT = RobotNoise(1.0, float(np.radians(0.2)))


@pytest.fixture(scope="module")
def data():
    stored = np.load(FOLDER / "corners.npz")
    u, _, vt = np.linalg.svd(stored["G"][:, :3, :3])
    robot = Poses(u @ vt, stored["G"][:, :3, 3] * 1000)
    count = len(robot)
    seen = Observations.from_views(
        [stored[f"obj{i}"] * 1000.0 for i in range(count)],
        [stored[f"img{i}"].astype(float) for i in range(count)],
        size_px=(1600, 1200),
    )
    return HandEyeData(robot, seen, "eye-to-hand", 0.3)


def on_the_plane(data, camera, x, z):
    """Distance of each pixel's ray from its point, on the target, robot at its word."""
    pose = x.inverse() @ data.base_from_tool @ z
    rows = data.seen.view
    points = Poses(pose.rotation[rows], pose.translation_mm[rows]).apply(
        data.seen.points_target_mm
    )
    rays = np.column_stack(
        [to_normalised(camera, data.seen.pixels), np.ones(len(rows))]
    )
    normals = pose.rotation[rows][:, :, 2]
    reach = (normals * points).sum(axis=1) / (normals * rays).sum(axis=1)
    return np.linalg.norm(rays * reach[:, None] - points, axis=1)


def test_the_robot_taken_at_its_word_gives_the_published_figures(data):
    fixed = data.fixed_from_moving
    seen = target_poses(data, FITTED).camera_from_target
    x = closed_form(fixed, seen)
    start = Chain(FITTED, x, target_in_fixed(fixed, x, seen), data.base_from_tool)
    rigid = HandEyeProblem(data, fixed_camera(FITTED), np.repeat([1e-4, 1e-7], 3))
    state = fit(rigid, start).state
    errors = on_the_plane(
        data, FITTED, state.moving_from_camera, state.fixed_from_target
    )
    assert errors.mean() == pytest.approx(0.590, abs=0.02)
    assert errors.max() == pytest.approx(2.71, abs=0.1)
    np.testing.assert_allclose(
        state.moving_from_camera.translation_mm[0], [-19.8, 1264.4, 288.2], atol=0.3
    )


def test_with_slack_the_result_is_near_and_says_how_poor_robot_and_lens_are(data):
    names = ("fx_px", "fy_px", "cx_px", "cy_px", "k1")
    prior = CameraPrior(FITTED, names, np.diag([3.0, 3, 3, 3, 0.01]) ** 2)
    result = calibrate_hand_eye(data, prior, ROBOT)
    solution = result.solution
    assert result.verdict.grade == "marginal"
    assert 0.05 < np.degrees(solution.robot_sigmas[1]) < 0.3
    assert np.sqrt((solution.left_out_mm**2).mean()) < 1.2
    expected = np.array([-19.8, 1264.4, 288.2])
    off = np.linalg.norm(solution.moving_from_camera.translation_mm - expected)
    assert off < 3 * np.sqrt(np.trace(solution.covariance[:3, :3]))


def test_the_shipped_intrinsics_are_refused(data):
    result = calibrate_hand_eye(data, SHIPPED, ROBOT)
    assert result.verdict.grade == "no-go"
    assert result.solution is None
    assert {"scale", "intrinsics-do-not-fit"} <= result.verdict.codes()
    assert any("intrinsics do not fit" in words for words in result.verdict.reasons)


def test_a_tight_datasheet_is_contradicted(data):
    result = calibrate_hand_eye(data, FITTED, RobotNoise(0.3, float(np.radians(0.03))))
    assert "robot-contradicts-itself" in result.verdict.codes()
    assert result.verdict.grade == "no-go"
