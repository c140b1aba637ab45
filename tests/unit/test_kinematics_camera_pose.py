import numpy as np
import pytest

from mvp.geometry import Pose
from mvp.kinematics import (
    camera_rotation,
    part_from_camera,
    roll_of,
    tool_from_camera_at,
)


def test_both_roll_solutions_keep_the_image_rows_level():
    nu = np.array([-0.389, 0.694, -0.608])
    for roll, sign in ((0.0, 1), (np.pi, -1)):
        x, _, z = camera_rotation(nu, roll).T
        level = np.cross(z, [0, 0, 1])
        np.testing.assert_allclose(x * np.linalg.norm(level) * sign, level, atol=1e-12)


def test_roll_zero_is_upright():
    x, y, _ = camera_rotation([0.0, 1.0, 0.0]).T
    np.testing.assert_allclose(x, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(y, [0, 0, -1], atol=1e-12)


@pytest.mark.parametrize("direction", [[0, 0, -1], [0, 0, 1], [1e-9, 0, -1]])
def test_a_straight_down_view_starts_along_the_object_x(direction):
    rotation = camera_rotation(direction)
    np.testing.assert_allclose(rotation[:, 0], [1, 0, 0], atol=1e-8)
    np.testing.assert_allclose(np.linalg.det(rotation), 1)


def test_the_front_nodal_point_of_the_paper_is_minus_r_times_position():
    # (23): T_oc = -R_oc r_V.
    position = np.array([107.58, -231.43, 258.68])
    pose = part_from_camera(position, [-0.389, 0.694, -0.608]).inverse()
    np.testing.assert_allclose(pose.translation_mm, -pose.rotation @ position)


def test_roll_is_read_back_from_the_axes():
    rolls = np.linspace(-3, 3, 7)
    rotation = camera_rotation([0.2, -0.3, -0.7], rolls)
    np.testing.assert_allclose(roll_of(rotation), rolls, atol=1e-12)


def test_the_pupil_moves_towards_the_object_as_d_grows():
    hand = Pose.from_rotvec("tool", "camera", [0.1, 0.2, 0.3], [1, 2, 90])
    moved = tool_from_camera_at(hand, d_mm=13.5, reference_d_mm=13.0)
    np.testing.assert_allclose(
        moved.translation_mm - hand.translation_mm, 0.5 * hand.rotation[:, 2]
    )
    np.testing.assert_allclose(moved.rotation, hand.rotation)


def test_without_a_reference_the_hand_eye_transform_stays():
    hand = Pose.identity("tool", "camera")
    assert tool_from_camera_at(hand, d_mm=13.5, reference_d_mm=None) is hand
