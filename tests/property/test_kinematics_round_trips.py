import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mvp.geometry import Pose
from mvp.kinematics import (
    arm_model,
    base_from_part,
    base_from_tool,
    camera_rotation,
    inverse,
    part_from_camera,
    roll_of,
)

angle = st.floats(-3.1, 3.1)
length = st.floats(-500, 500)
turns = st.tuples(angle, angle, angle).filter(lambda v: 0 < np.linalg.norm(v) < 3.1)
points = st.tuples(length, length, length)
joints = st.tuples(*[angle] * 6)


@given(q=joints, name=st.sampled_from(["ur3e", "ur5e", "ur10e", "ur16e", "ur20"]))
@settings(max_examples=60, deadline=None)
def test_every_branch_of_every_arm_returns_to_the_pose(q, name):
    arm = arm_model(name)
    pose = arm.forward(np.array(q))
    for found in inverse(arm, pose):
        np.testing.assert_allclose(arm.forward(found).matrix, pose.matrix, atol=1e-6)


@given(
    xyz=st.tuples(st.floats(-500, 500), st.floats(-500, 500), st.floats(50, 800)),
    pan=angle,
    tilt=st.floats(-1.7, 1.7),
)
@settings(max_examples=60, deadline=None)
def test_the_gantry_returns_to_its_joints(xyz, pan, tilt):
    gantry = arm_model("gantry_xyz_pan_tilt")
    q = np.array([*xyz, pan, tilt])
    (found,) = inverse(gantry, gantry.forward(q))
    np.testing.assert_allclose(found, q, atol=1e-6)


@given(hand=turns, reach=points, part=turns, place=points, nu=turns, at=points)
@settings(max_examples=60, deadline=None)
def test_gripper_camera_object_world_close_the_chain(hand, reach, part, place, nu, at):
    # (20) then (26) give the part back; the same point maps round the whole chain.
    tool_camera = Pose.from_rotvec("tool", "camera", hand, reach)
    base_part = Pose.from_rotvec("base", "part", part, place)
    view = part_from_camera(at, nu, roll_rad=0.7)
    tool = base_from_tool(base_part, view, tool_camera)
    again = base_from_part(tool, tool_camera, view)
    np.testing.assert_allclose(again.matrix, base_part.matrix, atol=1e-9)
    point = np.array([3.0, -4.0, 250.0])
    np.testing.assert_allclose(
        tool.apply(tool_camera.apply(point)),
        base_part.apply(view.apply(point)),
        atol=1e-9,
    )


@given(nu=turns, roll=angle)
@settings(max_examples=80, deadline=None)
def test_camera_axes_are_a_rotation_about_the_viewing_direction(nu, roll):
    rotation = camera_rotation(nu, roll)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1)
    np.testing.assert_allclose(rotation[:, 2], np.array(nu) / np.linalg.norm(nu))
    np.testing.assert_allclose(
        np.angle(np.exp(1j * (roll_of(rotation) - roll))), 0, atol=1e-6
    )
