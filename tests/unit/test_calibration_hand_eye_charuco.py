"""A published eye-to-hand set: sixteen robot poses, a ChArUco target on the hand."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.hand_eye import RobotNoise, calibrate_hand_eye
from calibration.poses import only
from tools.bench_calibration_charuco import (
    BAR_MM,
    CHARUCO,
    LEAST,
    ROBOT,
    SHIPPED,
    camera_of,
    charuco_data,
    off_the_plane_mm,
    rigid,
    slack_prior,
)

pytestmark = pytest.mark.skipif(
    not (CHARUCO / "corners.npz").exists(), reason="the ChArUco set is not here"
)
PLACE_MM = np.array([-19.8, 1264.4, 288.2])


@pytest.fixture(scope="module")
def data():
    return charuco_data()


@pytest.fixture(scope="module")
def estimated(data):
    """f, centre and k1 from the same pictures, without the robot."""
    return camera_of(data, LEAST)


def mean_mm(data, camera, solution):
    """The published figure of a solution with slack."""
    pair = only(solution.moving_from_camera), only(solution.fixed_from_target)
    return off_the_plane_mm(data, camera, *pair).mean()


def test_the_pictures_alone_give_the_known_camera(estimated):
    found = [getattr(estimated.camera, name) for name in LEAST]
    np.testing.assert_allclose(found[:4], [1347.0, 1349.2, 772.8, 630.6], atol=0.05)
    assert found[4] == pytest.approx(-0.0495, abs=1e-4)
    assert estimated.rms_px == pytest.approx(0.63, abs=0.005)


def test_the_robot_taken_at_its_word_gives_the_published_figures(data, estimated):
    x, z = rigid(data, estimated.camera)
    errors = off_the_plane_mm(data, estimated.camera, x, z)
    assert errors.mean() <= BAR_MM
    assert errors.mean() == pytest.approx(0.590, abs=0.002)
    assert errors.std() == pytest.approx(0.366, abs=0.002)
    assert errors.max() == pytest.approx(2.71, abs=0.01)
    np.testing.assert_allclose(x.translation_mm[0], PLACE_MM, atol=0.3)


def test_with_slack_the_result_is_near_and_says_how_poor_robot_and_lens_are(
    data, estimated
):
    """The figure takes the robot at its word, which this fit does not: 0.7502 mm."""
    prior = slack_prior(estimated.camera, refined=True)
    result = calibrate_hand_eye(data, prior, ROBOT)
    solution = result.solution
    assert result.verdict.grade == "marginal"
    assert 0.05 < np.degrees(solution.robot_sigmas[1]) < 0.3
    assert np.sqrt((solution.left_out_mm**2).mean()) < 1.2
    off = np.linalg.norm(solution.moving_from_camera.translation_mm - PLACE_MM)
    assert off < 3 * np.sqrt(np.trace(solution.covariance[:3, :3]))
    assert mean_mm(data, solution.camera, solution) <= 1.001 * BAR_MM


def test_with_slack_and_the_camera_held_the_figure_is_larger_still(data, estimated):
    prior = slack_prior(estimated.camera, refined=False)
    solution = calibrate_hand_eye(data, prior, ROBOT).solution
    assert mean_mm(data, estimated.camera, solution) <= 0.81


def test_the_calibrated_intrinsics_as_shipped_give_what_plain_least_squares_does(data):
    camera = SHIPPED["f 1352"]
    errors = off_the_plane_mm(data, camera, *rigid(data, camera))
    assert errors.mean() == pytest.approx(1.13, abs=0.005)
    assert errors.std() == pytest.approx(0.83, abs=0.01)


@pytest.mark.parametrize("camera", SHIPPED.values(), ids=SHIPPED)
def test_the_shipped_intrinsics_are_refused(data, camera):
    result = calibrate_hand_eye(data, camera, ROBOT)
    assert result.verdict.grade == "no-go"
    assert result.solution is None
    assert {"scale", "intrinsics-do-not-fit"} <= result.verdict.codes()
    assert any("intrinsics do not fit" in words for words in result.verdict.reasons)


def test_a_tight_datasheet_is_contradicted(data, estimated):
    tight = RobotNoise(0.3, float(np.radians(0.03)))
    result = calibrate_hand_eye(data, estimated.camera, tight)
    assert "robot-contradicts-itself" in result.verdict.codes()
    assert result.verdict.grade == "no-go"
