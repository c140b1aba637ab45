"""Mistakes that people make with robot poses: each is named, none is believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.hand_eye import (
    HandEyeData,
    Rehearsal,
    RobotNoise,
    calibrate_hand_eye,
    check_readings,
    layouts_that_fit,
    rehearse,
)
from calibration.observations import Observations
from calibration.poses import Poses
from mvp.errors import CalibrationError

CAMERA = Rehearsal().camera
SPEC = RobotNoise(0.2, float(np.radians(0.05)))
SMALL = Rehearsal(views=12, robot=SPEC, columns=5, rows=4, pitch_mm=25.0)


@pytest.fixture(scope="module")
def seen():
    return rehearse(SMALL, np.random.default_rng(11))


def judged(data, robot=SPEC):
    return calibrate_hand_eye(data, CAMERA, robot)


def told(seen, rotation=None, translation_mm=None):
    robot = seen.data.base_from_tool
    poses = Poses(
        robot.rotation if rotation is None else rotation,
        robot.translation_mm if translation_mm is None else translation_mm,
    )
    return replace(seen.data, base_from_tool=poses)


def reordered(robot, *, read_scalar_first):
    quaternion = Rotation.from_matrix(robot.rotation).as_quat(
        scalar_first=not read_scalar_first
    )
    return Rotation.from_quat(quaternion, scalar_first=read_scalar_first).as_matrix()


def refused(result, code):
    assert result.verdict.grade == "no-go"
    assert result.solution is None
    cause = result.verdict.ordered[0]
    assert cause.code == code
    assert cause.action
    return cause


def test_good_data_pass(seen):
    result = judged(seen.data)
    assert result.verdict.grade == "go", result.verdict.reasons
    assert result.readings.best.name == "as told"
    assert result.readings.told.scale == pytest.approx(1, abs=0.01)


def test_metres_are_named(seen):
    robot = seen.data.base_from_tool
    cause = refused(judged(told(seen, None, robot.translation_mm / 1000)), "unit")
    assert "in metres" in cause.message


def test_inches_are_named(seen):
    robot = seen.data.base_from_tool
    cause = refused(judged(told(seen, None, robot.translation_mm / 25.4)), "unit")
    assert "in inches" in cause.message


@pytest.mark.parametrize("first", [True, False])
def test_the_order_of_the_quaternion_is_named(seen, first):
    rotation = reordered(seen.data.base_from_tool, read_scalar_first=first)
    cause = refused(judged(told(seen, rotation)), "reading")
    assert ("scalar last" if first else "scalar first") in cause.message


def test_transposed_rotations_are_named(seen):
    rotation = np.swapaxes(seen.data.base_from_tool.rotation, 1, 2)
    cause = refused(judged(told(seen, rotation)), "reading")
    assert "transposed" in cause.message


def test_inverted_poses_and_the_other_mount_are_named(seen):
    inverse = seen.data.base_from_tool.inverse()
    for wrong in (
        replace(seen.data, base_from_tool=inverse),
        replace(seen.data, mount="eye-to-hand"),
    ):
        assert "inverted robot poses" in refused(judged(wrong), "reading").message


@pytest.mark.parametrize(("shift", "words"), [(1, "later"), (-1, "earlier")])
def test_the_robot_pose_of_another_sample_is_named(seen, shift, words):
    robot = seen.data.base_from_tool
    rolled = robot[np.roll(np.arange(len(robot)), shift)]
    cause = refused(judged(replace(seen.data, base_from_tool=rolled)), "reading")
    assert f"one sample {words}" in cause.message


def test_wrong_squares_show_as_a_scale(seen):
    found = seen.data.seen
    wrong = replace(found, points_target_mm=found.points_target_mm * 1.05)
    cause = refused(judged(replace(seen.data, seen=wrong)), "scale")
    assert "0.95" in cause.message
    assert "squares" in cause.action


def test_three_views_are_too_few(seen):
    cause = refused(judged(seen.data.of_views(range(3))), "few-views")
    assert "20 views" in cause.action


def test_parallel_poses_are_refused():
    plan = replace(SMALL, tilt_deg=0.0, roll_deg=0.0)
    data = rehearse(plan, np.random.default_rng(0)).data
    cause = refused(judged(data), "no-rotation")
    assert "translation of the camera in every direction" in cause.message


def test_one_axis_is_refused_and_named():
    plan = replace(SMALL, tilt_deg=0.5, roll_deg=60.0)
    cause = refused(judged(rehearse(plan, np.random.default_rng(0)).data), "one-axis")
    assert "translation along and rotation about" in cause.message
    assert "turn by +-20 deg" in cause.action


def test_small_rotations_are_refused():
    plan = replace(SMALL, tilt_deg=4.0, roll_deg=4.0)
    result = judged(rehearse(plan, np.random.default_rng(0)).data)
    assert result.verdict.grade == "no-go"
    assert result.verdict.codes() & {"rotations-small", "one-axis", "no-rotation"}


def test_a_robot_that_contradicts_itself_is_refused():
    plan = replace(SMALL, robot=RobotNoise(2.0, float(np.radians(0.5))))
    result = judged(rehearse(plan, np.random.default_rng(2)).data)
    assert result.verdict.grade == "no-go"
    assert "robot-contradicts-itself" in result.verdict.codes()


def test_an_arm_that_still_moved_is_named(seen):
    settled = tuple(index != 4 for index in range(12))
    result = judged(replace(seen.data, settled=settled))
    assert result.verdict.grade == "no-go"
    assert "moving in view 5" in result.verdict.reasons[0]


def test_one_wrong_robot_pose_is_pointed_at(seen):
    shift = np.array(seen.data.base_from_tool.translation_mm)
    shift[7] += (6.0, -5.0, 4.0)
    result = judged(told(seen, None, shift))
    assert result.verdict.grade == "no-go"
    assert any("view 8" in reason for reason in result.verdict.reasons)


def test_a_picture_with_two_points_is_named(seen):
    points, pixels = zip(*[seen.data.seen.of_view(v) for v in range(12)], strict=True)
    points, pixels = list(points), list(pixels)
    points[3], pixels[3] = points[3][:2], pixels[3][:2]
    bad = Observations.from_views(points, pixels, size_px=(1600, 1200))
    with pytest.raises(CalibrationError, match="view 4"):
        judged(replace(seen.data, seen=bad))


def test_numbers_of_poses_and_pictures_must_agree(seen):
    with pytest.raises(ValueError, match="11 robot poses for 12 pictures"):
        HandEyeData(seen.data.base_from_tool[:11], seen.data.seen)


@pytest.mark.parametrize("layout", ["rotation vector, deg", "rotation vector, rad",
                                    "roll pitch yaw, deg", "roll pitch yaw, rad"])  # fmt: skip
def test_bare_angles_say_their_own_layout(seen, layout):
    turn = Rotation.from_matrix(seen.data.base_from_tool.rotation)
    vector = layout.startswith("rotation vector")
    angles = turn.as_rotvec() if vector else turn.as_euler("xyz")
    angles = np.degrees(angles) if layout.endswith("deg") else angles
    numbers = np.hstack([seen.data.base_from_tool.translation_mm, angles])
    fits = layouts_that_fit(numbers, seen.camera_from_target, "eye-in-hand")
    assert fits[0].name == layout
    assert fits[1].misfit_mm > 4 * fits[0].misfit_mm


def test_bare_quaternions_say_their_order(seen):
    turn = Rotation.from_matrix(seen.data.base_from_tool.rotation)
    numbers = np.hstack([seen.data.base_from_tool.translation_mm, turn.as_quat()])
    fits = layouts_that_fit(numbers, seen.camera_from_target, "eye-in-hand")
    assert fits[0].name == "quaternion x y z w"
    with pytest.raises(ValueError, match="rows of 7"):
        layouts_that_fit(numbers[:, :5], seen.camera_from_target, "eye-in-hand")


def test_the_scale_has_an_honest_sigma():
    pulls = []
    for seed in range(12):
        seen = rehearse(SMALL, np.random.default_rng(seed))
        reading = check_readings(
            seen.data.base_from_tool, seen.camera_from_target, "eye-in-hand"
        ).told
        pulls.append((reading.scale - 1) / reading.scale_sigma)
    assert 0.3 < np.sqrt(np.mean(np.square(pulls))) < 2
