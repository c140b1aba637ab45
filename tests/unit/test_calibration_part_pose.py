"""Pose of a part from its own features: accuracy, branches, rims, edges, viewpoints."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.estimate import fit
from calibration.part_pose import (
    PartSight,
    SeenCircles,
    SeenEdges,
    SeenPoints,
    judge_resection,
    resect,
)
from calibration.part_pose.problem import PoseProblem
from calibration.part_pose.start import mirrored
from calibration.projection import PinholeCamera, project, to_pixels
from mvp.errors import CalibrationError
from mvp.geometry import Pose

PAPER = PinholeCamera(13.07 / 0.01625, 13.07 / 0.0135, 255.5, 239.5)
BENT = PinholeCamera(2300, 2310, 800, 600, -0.1, 0.05, 1e-3, -2e-3, 0.01)
CUBE = 25.4 * (
    np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) - 0.5
)
DOWN = Rotation.from_euler("xyz", [200, 30, 20], degrees=True)


def placed(rng, depth_mm=360.0):
    rotation = (DOWN * Rotation.from_rotvec(rng.normal(0, 0.3, 3))).as_matrix()
    return rotation, np.array([0.0, 0, depth_mm]) + rng.normal(0, 5, 3)


def seven_corners(rotation, translation):
    return CUBE[np.argsort((CUBE @ rotation.T + translation)[:, 2])[:7]]


def off(pose, rotation, translation):
    turn = Rotation.from_matrix(pose.rotation @ rotation.T).as_rotvec()
    return np.concatenate([pose.translation_mm - translation, turn])


def _cubes(count, sigma_px):
    errors, inside, pulls = [], [], []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        state = placed(rng)
        corners = seven_corners(*state)
        pixels = project(PAPER, *state, corners) + rng.normal(0, sigma_px, (7, 2))
        best = resect(PAPER, PartSight(SeenPoints(corners, pixels, sigma_px))).best
        step = off(best.camera_from_part, *state)
        sight = PartSight(
            SeenPoints(corners, project(PAPER, *state, corners), sigma_px)
        )
        jacobian = PoseProblem.of(PAPER, sight).jacobian(state)
        errors.append(step)
        inside.append(np.abs(step) < best.estimate.sigmas)
        pulls.append(step @ (jacobian.T @ jacobian) @ step / 6)
    rms = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    return rms, float(np.mean(inside)), float(np.sqrt(np.mean(pulls)))


@pytest.mark.parametrize(
    "count", [12, pytest.param(200, marks=pytest.mark.full, id="full")]
)
def test_a_one_inch_cube_is_found_as_well_as_its_corners_allow(count):
    rms, inside, pull = _cubes(count, 0.2)
    assert np.degrees(np.linalg.norm(rms[3:])) <= 0.3
    assert np.linalg.norm(rms[:2]) <= 0.08
    assert rms[2] <= 0.9
    assert 0.55 <= inside <= 0.80
    assert pull <= 1.15


def rim_sight(rng, state, camera, sigma_px=0.0):
    """Centres of ellipses fitted by OpenCV to the images of points on the rims."""
    centres = rng.uniform(-15, 15, (6, 3))
    normals = rng.normal(size=(6, 3)) * 0.3 + (state[0].T @ [0, 0, -1.0])
    radii = rng.uniform(3, 6, 6)
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    pixels = []
    for centre, normal, radius in zip(centres, normals, radii, strict=True):
        across = np.linalg.svd(normal[None])[2][1:]
        rim = np.stack([np.cos(angle), np.sin(angle)], 1) @ across * radius + centre
        outline = project(camera, *state, rim).astype(np.float32)
        pixels.append(cv2.fitEllipseDirect(outline)[0])
    noise = rng.normal(0, sigma_px, (6, 2))
    return PartSight(
        circles=SeenCircles(centres, normals, radii, np.array(pixels) + noise, 0.05)
    )


def test_the_centre_of_an_ellipse_is_not_the_image_of_the_centre():
    rng = np.random.default_rng(0)
    camera = PinholeCamera(2300, 2310, 800, 600)
    state = placed(rng, 150.0)
    sight = rim_sight(rng, state, camera)
    predicted = PoseProblem.of(camera, sight).residuals(state) * 0.05
    assert np.abs(predicted).max() < 0.01
    plain = project(camera, *state, sight.circles.centres_part_mm)
    assert np.abs(plain - sight.circles.pixels).max() > 0.3


def test_holes_alone_give_the_pose():
    rng = np.random.default_rng(2)
    camera = PinholeCamera(2300, 2310, 800, 600)
    state = placed(rng, 300.0)
    found = resect(camera, rim_sight(rng, state, camera)).best
    step = off(found.camera_from_part, *state)
    assert np.linalg.norm(step[3:]) < 1e-3
    assert np.linalg.norm(step[:3]) < 0.1


def edge_sight(rng, state, camera, sigma_px):
    ends = CUBE[[[0, 1], [0, 2], [0, 4], [1, 3], [2, 6], [4, 5], [7, 3]]]
    share = rng.uniform(0.1, 0.9, (7, 8, 1))
    places = ends[:, None, 0] + share * (ends[:, None, 1] - ends[:, None, 0])
    pixels = project(camera, *state, places.reshape(-1, 3))
    pixels = pixels + rng.normal(0, sigma_px, pixels.shape)
    edges = SeenEdges(ends, pixels, np.repeat(np.arange(7), 8), max(sigma_px, 0.01))
    return PartSight(edges=edges)


def test_edges_alone_give_the_pose_through_a_bent_lens():
    rng = np.random.default_rng(4)
    state = placed(rng)
    exact = resect(BENT, edge_sight(rng, state, BENT, 0.0)).best
    assert np.abs(off(exact.camera_from_part, *state)).max() < 1e-6
    noisy = resect(BENT, edge_sight(rng, state, BENT, 0.2)).best
    step = off(noisy.camera_from_part, *state)
    assert (np.abs(step) < 4 * noisy.estimate.sigmas).all()
    assert noisy.estimate.probability > 1e-3


def test_the_derivatives_of_all_kinds_are_those_of_finite_differences():
    rng = np.random.default_rng(0)
    state = placed(rng, 300.0)
    points = SeenPoints(rng.uniform(-15, 15, (5, 3)), rng.uniform(700, 900, (5, 2)))
    circles = rim_sight(rng, state, BENT).circles
    edges = edge_sight(rng, state, BENT, 3.0).edges
    problem = PoseProblem.of(BENT, PartSight(points, circles, edges))
    step = 1e-6
    numeric = [
        problem.residuals(problem.moved(state, step * unit))
        - problem.residuals(problem.moved(state, -step * unit))
        for unit in np.eye(6)
    ]
    jacobian = problem.jacobian(state)
    numeric = np.stack(numeric, axis=1) / (2 * step)
    np.testing.assert_allclose(jacobian, numeric, rtol=1e-5, atol=1e-2)


FLAT = np.array([[0.0, 0, 0], [12.7, 0, 0], [25.4, 0, 0], [0, 12.7, 0], [0, 25.4, 0]])


def flat_sight(rng, sigma_px=0.2, depth_mm=600.0):
    tilt = Rotation.from_euler("xyz", [180 + 15, 8, 40], degrees=True).as_matrix()
    state = tilt, np.array([-5.0, -5, depth_mm])
    pixels = project(PAPER, *state, FLAT) + rng.normal(0, sigma_px, (5, 2))
    return state, PartSight(SeenPoints(FLAT, pixels, sigma_px))


def test_a_flat_part_far_away_has_two_poses_and_says_so():
    state, sight = flat_sight(np.random.default_rng(1))
    found = resect(PAPER, sight)
    assert found.ambiguous
    verdict = judge_resection(sight, found)
    assert verdict.grade == "no-go"
    assert "mirror-ambiguity" in verdict.codes()
    turned = [
        Rotation.from_matrix(b.camera_from_part.rotation @ state[0].T).magnitude()
        for b in found.branches[:2]
    ]
    assert min(turned) < np.radians(8) < max(turned)


def test_the_expected_pose_settles_what_the_picture_cannot():
    for seed in range(6):
        state, sight = flat_sight(np.random.default_rng(seed))
        found = resect(PAPER, sight, near=Pose("camera", "part", *state))
        if found.settled_by_prior:
            step = off(found.best.camera_from_part, *state)
            assert np.linalg.norm(step[3:]) < np.radians(12)
            assert judge_resection(sight, found).grade != "go"


def test_near_to_the_camera_the_mirror_image_is_rejected():
    tilt = Rotation.from_euler("xyz", [215, 20, 40], degrees=True).as_matrix()
    state = tilt, np.array([-5.0, -5, 120.0])
    pixels = project(PAPER, *state, FLAT)
    found = resect(PAPER, PartSight(SeenPoints(FLAT, pixels, 0.1)))
    assert not found.ambiguous
    assert np.abs(off(found.best.camera_from_part, *state)).max() < 1e-5


def test_a_fit_from_the_mirror_pose_is_not_taken_for_the_answer():
    rng = np.random.default_rng(5)
    state, sight = flat_sight(rng, 0.02, 200.0)
    trapped = fit(PoseProblem.of(PAPER, sight), mirrored(state, FLAT))
    assert np.linalg.norm(off(Pose("camera", "part", *trapped.state), *state)[3:]) > 0.1
    found = resect(PAPER, sight)
    assert np.linalg.norm(off(found.best.camera_from_part, *state)[3:]) < 0.02
    assert trapped.estimate.chi_square > 4 * found.best.estimate.chi_square


def test_three_points_have_several_poses_and_are_not_enough_to_trust():
    rng = np.random.default_rng(3)
    state = placed(rng)
    points = CUBE[[1, 2, 4]]
    sight = PartSight(SeenPoints(points, project(PAPER, *state, points)))
    found = resect(PAPER, sight)
    close = [np.abs(off(b.camera_from_part, *state)).max() for b in found.branches]
    assert min(close) < 1e-4
    verdict = judge_resection(sight, found)
    assert verdict.grade == "no-go"
    assert "few-features" in verdict.codes()


def test_two_points_are_refused():
    sight = PartSight(SeenPoints(CUBE[:2], np.array([[10.0, 10], [20, 30]])))
    with pytest.raises(CalibrationError, match="six numbers"):
        resect(PAPER, sight)


def test_swapped_features_do_not_pass():
    rng = np.random.default_rng(6)
    state = placed(rng)
    corners = seven_corners(*state)
    pixels = project(PAPER, *state, corners)[[1, 0, 2, 3, 4, 6, 5]]
    sight = PartSight(SeenPoints(corners, pixels, 0.2))
    assert judge_resection(sight, resect(PAPER, sight)).grade == "no-go"


def test_points_on_one_line_leave_a_rotation_open():
    line = np.linspace(-20, 20, 6)[:, None] * np.array([[0.6, 0.8, 0.0]])
    state = placed(np.random.default_rng(7))
    sight = PartSight(SeenPoints(line, project(PAPER, *state, line), 0.1))
    verdict = judge_resection(sight, resect(PAPER, sight))
    assert verdict.grade == "no-go"
    assert "weakly-determined" in verdict.codes()


def test_a_mirrored_drawing_does_not_pass():
    state = placed(np.random.default_rng(8))
    corners = seven_corners(*state)
    pixels = to_pixels(
        PAPER, np.divide(*np.split(corners @ state[0].T + state[1], [2], axis=1))
    )
    mirrored_part = corners * [-1.0, 1, 1]
    sight = PartSight(SeenPoints(mirrored_part, pixels, 0.2))
    assert judge_resection(sight, resect(PAPER, sight)).grade == "no-go"
