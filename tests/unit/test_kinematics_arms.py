import itertools

import numpy as np
import pytest

from mvp.errors import ConfigError
from mvp.geometry import Pose
from mvp.kinematics import (
    ARM_MODELS,
    Gantry,
    arm_model,
    camera_rotation,
    inverse,
    jacobian,
    singularity_margin,
)

UR = [name for name in ARM_MODELS if name.startswith("ur")]
# Controller poses of a simulated UR5e: mm, rotation vector in rad.
PUBLISHED = [
    (
        [0.2, -1.4, 1.5, -1.57, -1.57, 0.1],
        [-514.15, -240.32, 433.03],
        [2.06545, 2.28297, 0.12426],
    ),
    (
        [0.0, -1.57, 1.57, -1.57, -1.57, 0.0],
        [-492.159, -133.379, 487.821],
        [2.220645, 2.220645, 0.0],
    ),
]


def denavit_hartenberg(name: str, q: np.ndarray) -> np.ndarray:
    """The textbook chain, as an oracle."""
    g = arm_model(name).geometry  # type: ignore[attr-defined]
    matrix = np.eye(4)
    for theta, d, a, alpha in zip(
        q,
        (g.d1, 0, 0, g.d4, g.d5, g.d6),
        (0, g.a2, g.a3, 0, 0, 0),
        (np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0),
        strict=True,
    ):
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        matrix = matrix @ np.array(
            [
                [ct, -st * ca, st * sa, a * ct],
                [st, ct * ca, -ct * sa, a * st],
                [0, sa, ca, d],
                [0, 0, 0, 1],
            ]
        )
    return matrix


@pytest.mark.parametrize(("joints", "point", "turn"), PUBLISHED)
def test_a_ur5e_stands_where_its_controller_says(joints, point, turn):
    pose = arm_model("ur5e").forward(np.array(joints))
    np.testing.assert_allclose(pose.translation_mm, point, atol=6e-3)
    np.testing.assert_allclose(pose.rotvec_rad, turn, atol=6e-6)


@pytest.mark.parametrize("name", UR)
def test_forward_kinematics_is_the_textbook_chain(name):
    rng = np.random.default_rng(3)
    joints = rng.uniform(-6, 6, (20, 6))
    rotation, point = arm_model(name).forward_batch(joints)
    for k, q in enumerate(joints):
        expected = denavit_hartenberg(name, q)
        np.testing.assert_allclose(rotation[k], expected[:3, :3], atol=1e-12)
        np.testing.assert_allclose(point[k], expected[:3, 3], atol=1e-9)


@pytest.mark.parametrize("name", UR)
def test_all_eight_branches_lead_back_to_the_pose(name):
    arm = arm_model(name)
    joints = np.random.default_rng(4).uniform(-np.pi, np.pi, (200, 6))
    rotation, point = arm.forward_batch(joints)
    found, exists = arm.inverse_batch(rotation, point)
    pose, branch = np.nonzero(exists)
    again, where = arm.forward_batch(found[pose, branch])
    np.testing.assert_allclose(again, rotation[pose], atol=1e-9)
    np.testing.assert_allclose(where, point[pose], atol=1e-7)
    away = np.abs(np.angle(np.exp(1j * (found - joints[:, None])))).max(axis=2)
    assert np.where(exists, away, 9).min(axis=1).max() < 1e-6
    assert (exists.sum(axis=1) == 8).mean() > 0.5


@pytest.mark.parametrize("q5", [0.0, np.pi, 1e-12])
def test_a_wrist_singularity_takes_wrist_3_from_the_reference(q5):
    arm = arm_model("ur5e")
    joints = np.array([0.3, -1.2, 1.4, -0.7, q5, 0.9])
    pose = arm.forward(joints)
    found = inverse(arm, pose, near=joints)
    assert min(np.abs(q - joints).max() for q in found) < 1e-6
    for q in found:
        again = arm.forward(q)
        np.testing.assert_allclose(again.matrix, pose.matrix, atol=1e-7)


def test_a_stretched_arm_is_not_lost_to_rounding():
    arm = arm_model("ur5e")
    joints = np.array([0.3, -1.2, 0.0, -0.7, 1.0, 0.9])
    assert len(inverse(arm, arm.forward(joints))) >= 1


def test_a_point_out_of_reach_has_no_branch():
    far = Pose("base", "tool", np.eye(3), np.array([2000.0, 0, 0]))
    near = Pose("base", "tool", np.eye(3), np.array([10.0, 0, 400.0]))
    assert inverse(arm_model("ur5e"), far) == ()
    assert inverse(arm_model("ur5e"), near) == ()


def test_turns_are_chosen_next_to_the_reference_and_inside_the_limits():
    arm = arm_model("ur5e")
    joints = np.array([6.0, -1.2, 1.4, -0.7, 1.0, -6.1])
    found = inverse(arm, arm.forward(joints), near=joints)
    assert min(np.abs(q - joints).max() for q in found) < 1e-6
    other = inverse(arm, arm.forward(joints), near=np.array([8.0, 0, 0, 0, 0, -8.0]))
    assert all(
        (q >= arm.joint_low).all() and (q <= arm.joint_high).all() for q in other
    )


def test_narrower_joint_limits_remove_branches():
    pose = arm_model("ur5e").forward(np.array([0.3, -1.2, 1.4, -0.7, 1.0, 0.9]))
    low = [-1, -2, 0, -2, 0, -2]
    high = [1, 0, 2, 0, 2, 2]
    found = inverse(arm_model("ur5e", joint_low=low, joint_high=high), pose)
    assert len(found) == 1


def test_an_unknown_arm_is_refused_with_a_suggestion():
    with pytest.raises(ConfigError) as error:
        arm_model("ur5")
    assert "ur5e" in error.value.hint


def test_limits_inside_out_are_refused():
    with pytest.raises(ConfigError, match="below"):
        arm_model("ur5e", joint_low=[1] * 6, joint_high=[0] * 6)


@pytest.mark.parametrize("name", ["ur5e", "ur20"])
def test_the_jacobian_is_that_of_the_axes(name):
    arm = arm_model(name)
    joints = np.random.default_rng(5).uniform(-2, 2, 6)
    flange = arm.forward(joints).translation_mm
    g = arm.geometry
    columns = []
    matrix = np.eye(4)
    for k in range(6):
        axis, origin = matrix[:3, 2], matrix[:3, 3]
        columns.append(np.concatenate([np.cross(axis, flange - origin), axis]))
        partial = np.zeros(6)
        partial[: k + 1] = joints[: k + 1]
        matrix = _first_links(g, joints, k + 1)
    np.testing.assert_allclose(jacobian(arm, joints), np.array(columns).T, atol=1e-5)


def _first_links(g, q, count):
    d = (g.d1, 0, 0, g.d4, g.d5, g.d6)
    a = (0, g.a2, g.a3, 0, 0, 0)
    alpha = (np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0)
    matrix = np.eye(4)
    for k in range(count):
        ct, st = np.cos(q[k]), np.sin(q[k])
        ca, sa = np.cos(alpha[k]), np.sin(alpha[k])
        matrix = matrix @ np.array(
            [
                [ct, -st * ca, st * sa, a[k] * ct],
                [st, ct * ca, -ct * sa, a[k] * st],
                [0, sa, ca, d[k]],
                [0, 0, 0, 1],
            ]
        )
    return matrix


def test_the_singularity_margin_vanishes_at_a_stretched_arm():
    arm = arm_model("ur5e")
    good = singularity_margin(arm, np.array([0.2, -1.4, 1.5, -1.57, -1.57, 0.1]))
    stretched = singularity_margin(arm, np.array([0.2, -1.4, 0.0, -1.57, -1.57, 0.1]))
    assert good > 0.05
    assert stretched < 1e-6


@pytest.mark.parametrize("name", ARM_MODELS)
def test_no_point_of_a_link_moves_more_than_its_lever_says(name):
    arm = arm_model(name)
    rng = np.random.default_rng(6)
    low, high = arm.joint_low, arm.joint_high
    step = 1e-5
    worst = np.zeros(arm.levers_mm.shape)
    for joints in rng.uniform(low, high, (60, arm.dof)):
        moved = joints + step * np.eye(arm.dof)
        links = arm.links_batch(np.vstack([joints, moved]))
        _, flange = arm.forward_batch(np.vstack([joints, moved]))
        for ends in (links.start_mm, links.end_mm):
            way = np.linalg.norm(ends[1:] - ends[0], axis=2).T / step
            worst[:-1] = np.maximum(worst[:-1], way)
        worst[-1] = np.maximum(
            worst[-1], np.linalg.norm(flange[1:] - flange[0], axis=1) / step
        )
    assert (worst <= arm.levers_mm * 1.0001 + 0.01).all()


def test_links_hang_together_and_end_at_the_flange():
    arm = arm_model("ur5e")
    joints = np.array([0.2, -1.4, 1.5, -1.57, -1.57, 0.1])
    links = arm.links_batch(joints).at(0)
    pose = arm.forward(joints)
    last = links[-1]
    face = last.end_mm + last.radius_mm * pose.rotation[:, 2]
    np.testing.assert_allclose(face, pose.translation_mm, atol=1e-9)
    for a, b in itertools.pairwise(links):
        gap = np.linalg.norm(a.end_mm - b.start_mm)
        assert gap <= a.radius_mm + b.radius_mm + 160


def test_a_gantry_is_only_for_the_roll_its_head_gives():
    gantry = Gantry()
    pose = gantry.forward(np.array([100.0, -50, 400, 0.4, 0.7]))
    (joints,) = inverse(gantry, pose)
    np.testing.assert_allclose(joints, [100, -50, 400, 0.4, 0.7], atol=1e-9)
    turned = pose @ Pose.from_rotvec("tool", "tool", [0, 0, 0.01], [0, 0, 0])
    assert inverse(gantry, turned) == ()


def test_a_gantry_names_the_rolls_it_dictates_for_a_direction():
    gantry = Gantry()
    hand = Pose.from_rotvec("tool", "camera", [0.02, -0.01, 0.3], [0, 0, 0]).rotation
    rng = np.random.default_rng(7)
    nu = rng.normal(size=(50, 3)) * [1, 1, 0.3] - [0, 0, 1]
    nu /= np.linalg.norm(nu, axis=1)[:, None]
    cameras = gantry.camera_rotations(nu, nu[:, None, None], hand)
    assert cameras.shape[1] == 2
    np.testing.assert_allclose(cameras[..., 2], np.repeat(nu[:, None], 2, 1), atol=1e-9)
    tools = cameras @ hand.T
    assert np.abs(tools[..., 2, 0]).max() < 1e-12


def test_a_gantry_looking_straight_down_may_pan_freely():
    cameras = Gantry().camera_rotations(
        np.array([[0.0, 0, -1]]), np.eye(3)[None, None], np.eye(3)
    )
    assert cameras.shape[1] > 10
    np.testing.assert_allclose(cameras[..., 2], [[[0, 0, -1]] * cameras.shape[1]])


def test_with_an_aligned_camera_the_gantry_gives_both_rolls_of_the_paper():
    nu = np.array([[0.3, 0.5, -0.8]]) / np.linalg.norm([0.3, 0.5, -0.8])
    given = Gantry().camera_rotations(nu, nu[:, None, None], np.eye(3))[0]
    paper = camera_rotation(nu[0], np.array([0.0, np.pi]))
    for rotation in given:
        assert np.abs(rotation - paper).max(axis=(1, 2)).min() < 1e-9
