import numpy as np
import pytest

from mvp.constraints import CameraClearance, Reach
from mvp.geometry import Box, Pose
from mvp.kinematics import (
    Capsule,
    CellBodies,
    Gantry,
    Placement,
    Unreachable,
    arm_model,
    camera_rotation,
    obstacles,
    part_from_camera,
    realisations,
    singularity_margin,
)
from mvp.optics import Views
from mvp.scene import paper_object

HOME = np.radians([0.0, -90, 90, -90, -90, 0])
TOOL = (Capsule("camera", np.array([0.0, 0, 20]), np.array([0.0, 0, 95]), 32.0),)
HAND = Pose.from_rotvec("tool", "camera", np.radians([0.4, -0.3, 25]), [1.8, -2.2, 104])
PART = Pose.from_rotvec("base", "part", np.radians([0, 0, 5]), [-520, -130, 60])
PAPER = {
    "V_f": ([107.58, -231.43, 258.68], [-0.389, 0.694, -0.608]),
    "V_f1": ([197.10, 100.58, 330.45], [-0.513, -0.255, -0.820]),
    "V_f2": ([112.78, 110.49, 159.77], [-0.444, -0.583, -0.680]),
}


def placement(
    *boxes: tuple[str, Box], model=None, part=PART, reference=HOME, **more
) -> Placement:
    model = model or arm_model("ur5e")
    bodies = CellBodies(model, TOOL, obstacles(paper_object().moved(part), (), boxes))
    margin = np.full(model.dof, np.radians(3))
    return Placement(bodies, part, HAND, margin, reference=reference, **more)


@pytest.mark.parametrize("name", PAPER)
def test_the_published_views_are_reached_and_the_camera_is_where_it_was_planned(name):
    view = part_from_camera(*PAPER[name])
    found = realisations(placement(), view)
    assert not isinstance(found, Unreachable)
    best = found[0]
    again = PART.inverse() @ arm_model("ur5e").forward(best.joints) @ HAND
    np.testing.assert_allclose(again.translation_mm, view.translation_mm, atol=1e-6)
    np.testing.assert_allclose(again.rotation[:, 2], view.rotation[:, 2], atol=1e-9)
    np.testing.assert_allclose(again.matrix, best.part_from_camera.matrix, atol=1e-9)
    assert best.reach.value >= 3
    assert best.nearest.distance_mm >= 5
    assert best.score == max(r.score for r in found)


def test_the_roll_that_was_chosen_is_the_roll_of_the_view():
    found = realisations(placement(), part_from_camera(*PAPER["V_f"]))
    assert not isinstance(found, Unreachable)
    for one in found[:5]:
        made = camera_rotation(one.part_from_camera.rotation[:, 2], one.roll_rad)
        np.testing.assert_allclose(made, one.part_from_camera.rotation, atol=1e-6)


def test_a_fixed_roll_is_kept():
    view = part_from_camera(*PAPER["V_f1"], roll_rad=0.3)
    found = realisations(placement(), view, free_roll=False)
    assert not isinstance(found, Unreachable)
    np.testing.assert_allclose(found[0].part_from_camera.matrix, view.matrix, atol=1e-9)


def test_a_straight_down_view_is_reached():
    view = part_from_camera([0.0, 0, 300], [0, 0, -1])
    assert not isinstance(realisations(placement(), view), Unreachable)


def test_a_view_out_of_reach_says_so():
    found = realisations(placement(), part_from_camera([0, 0, 2500], [0, 0, -1]))
    assert isinstance(found, Unreachable)
    assert "reach" in found.reason


def test_a_keep_out_that_swallows_the_camera_is_named():
    box = ("enclosure", Box(np.array([-2000.0, -2000, 250]), np.full(3, 2000.0)))
    found = realisations(placement(box), part_from_camera([0, 0, 300], [0, 0, -1]))
    assert isinstance(found, Unreachable)
    assert "enclosure" in found.reason


def test_joint_limits_that_forbid_a_view_are_named():
    narrow = arm_model(
        "ur5e", joint_low=[-1.5, -6, -3, -6, -6, -6], joint_high=[-1, 6, 3, 6, 6, 6]
    )
    found = realisations(
        placement(model=narrow, reference=np.array([-1.2, -1, 1, -1, -1, 0])),
        part_from_camera([0, 0, 300], [0, 0, -1]),
    )
    assert isinstance(found, Unreachable)
    assert "base" in found.reason


def test_a_gantry_takes_the_view_with_a_roll_of_its_own():
    part = Pose.from_rotvec("base", "part", [0, 0, 0], [0, 0, 100])
    where = placement(
        model=Gantry(), part=part, reference=np.array([0.0, 0, 700, 0, 0])
    )
    view = part_from_camera(*PAPER["V_f"])
    found = realisations(where, view)
    assert not isinstance(found, Unreachable)
    got = found[0].part_from_camera
    np.testing.assert_allclose(got.translation_mm, view.translation_mm, atol=1e-6)
    np.testing.assert_allclose(got.rotation[:, 2], view.rotation[:, 2], atol=1e-9)


def test_a_gantry_refuses_a_roll_that_its_head_cannot_give():
    part = Pose.from_rotvec("base", "part", [0, 0, 0], [0, 0, 100])
    where = placement(
        model=Gantry(), part=part, reference=np.array([0.0, 0, 700, 0, 0])
    )
    view = part_from_camera(*PAPER["V_f"], roll_rad=0.7)
    found = realisations(where, view, free_roll=False)
    assert isinstance(found, Unreachable)
    assert "roll" in found.reason


def views(count: int) -> Views:
    rng = np.random.default_rng(0)
    nu = rng.normal(size=(count, 3))
    nu[:, 2] = -np.abs(nu[:, 2])
    nu /= np.linalg.norm(nu, axis=1)[:, None]
    one = np.ones(count)
    place = -nu * rng.uniform(120, 900, (count, 1))
    return Views(camera_rotation(nu, 0.3), place, 13.2 * one, 12.5 * one, one, 0 * one)


@pytest.mark.parametrize("name", ["ur5e", "gantry_xyz_pan_tilt"])
def test_the_filter_and_the_margins_agree(name):
    model = arm_model(name)
    reach = Reach(model, PART, HAND, 13.0, np.full(model.dof, 0.05))
    batch = views(150)
    np.testing.assert_array_equal(reach.reachable(batch), reach.margins_deg(batch) >= 0)


def test_the_filter_agrees_with_a_realisation_one_by_one():
    model = arm_model("ur5e")
    reach = Reach(model, PART, HAND, None, np.full(6, np.radians(3)))
    batch = views(25)
    bodies = CellBodies(model, (), ())
    where = Placement(bodies, PART, HAND, np.full(6, np.radians(3)), clearance_mm=-1e9)
    for k, good in enumerate(reach.reachable(batch)):
        found = realisations(where, batch.part_from_camera(k))
        assert good == (not isinstance(found, Unreachable))


def test_a_camera_that_would_touch_the_part_has_a_negative_clearance():
    batch = Views(
        camera_rotation(np.array([[0.0, 0, -1], [0, 0, -1]])),
        np.array([[80.0, 80, 60], [80, 80, 400]]),
        *(np.full(2, v) for v in (13.0, 12.5, 0.8, 0.0)),
    )
    found = CameraClearance(
        TOOL, obstacles(paper_object().moved(PART)), PART, HAND, 13.0
    ).distances_mm(batch)
    assert found[0] < 0
    assert found[1] > 200


def test_configurations_closer_to_a_singular_one_than_asked_are_refused():
    view = part_from_camera(*PAPER["V_f"])
    free = realisations(placement(), view)
    asked = realisations(placement(singularity_margin=0.1), view)
    assert not isinstance(free, Unreachable)
    assert not isinstance(asked, Unreachable)
    model = arm_model("ur5e")
    assert all(singularity_margin(model, one.joints) >= 0.1 for one in asked)
    refused = realisations(placement(singularity_margin=5.0), view)
    assert isinstance(refused, Unreachable)
    assert "singular" in refused.reason
