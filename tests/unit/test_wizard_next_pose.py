"""The next view is the one that tells most about the task, and one that can be had."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.bundle import BundleProblem, BundleState, freedom
from calibration.camera import CameraOptions, calibrate_camera
from calibration.hand_eye import (
    CameraPrior,
    HandEyeData,
    Rehearsal,
    RobotNoise,
    calibrate_hand_eye,
    rehearse,
)
from calibration.hand_eye.refine import Chain, HandEyeProblem
from calibration.observations import Observations
from calibration.poses import Poses, difference
from calibration.projection import PinholeCamera, project
from calibration.wizard.next_pose import (
    Choice,
    FocusBand,
    HandEyeBelief,
    Knowledge,
    NoView,
    Refused,
    ViewRange,
    camera_information,
    camera_task,
    candidate_views,
    choose,
    first_of,
    hand_eye_information,
    hand_eye_task,
    views_of,
    views_until,
)
from calibration.wizard.next_pose_aim import Aim, Doubt

CAMERA = PinholeCamera(1300.0, 1300.0, 322.0, 254.0, -0.1)
SIZE = (640, 512)
FREE = ("fx_px", "fy_px", "cx_px", "cy_px", "k1")
ROBOT = RobotNoise(0.1, float(np.radians(0.02)))
STAND_OFF = 400.0
WITHIN = ViewRange(250.0, 520.0)


def board():
    x, y = np.meshgrid(np.arange(11) * 12.0, np.arange(8) * 12.0)
    return np.stack([x.ravel(), y.ravel(), np.zeros(88)], axis=1)


def candidates(seed, within=WITHIN, **options):
    rng = np.random.default_rng(seed)
    return candidate_views(CAMERA, SIZE, board(), within, rng, **options)


def belief(prior=None, x=None, z=None):
    x = x or Poses(
        Rotation.from_euler("xyz", [3, -4, 60], degrees=True).as_matrix()[None],
        np.array([[20.0, -10.0, 100.0]]),
    )
    z = z or Poses(
        Rotation.from_rotvec([np.pi, 0, 0.1]).as_matrix()[None],
        np.array([[-500.0, 100.0, 10.0]]),
    )
    held = prior or CameraPrior(CAMERA, (), np.zeros((0, 0)))
    return HandEyeBelief(x, z, held, ROBOT, 0.1)


# ------------------------------------------------------------ information, by oracles


def test_information_about_hand_eye_is_that_of_the_estimator_with_its_slack():
    rng = np.random.default_rng(0)
    told = rehearse(Rehearsal(views=4, robot=ROBOT), rng)
    camera = Rehearsal().camera
    prior = CameraPrior(camera, ("fx_px", "k1"), np.diag([1.0, 1e-4]))
    problem = HandEyeProblem(told.data, prior, ROBOT.sigmas)
    state = Chain(
        camera, told.moving_from_camera, told.fixed_from_target, told.base_from_tool
    )
    whole = problem.jacobian(state).toarray()
    own = HandEyeBelief(
        told.moving_from_camera,
        told.fixed_from_target,
        prior,
        ROBOT,
        told.data.sigma_px,
    )
    points = told.data.seen.of_view(0)[0]
    views = views_of(camera, Rehearsal().size_px, points, told.camera_from_target)
    assert views.seen.all()
    found = hand_eye_information(own, views)
    rows = np.repeat(told.data.seen.view, 2)
    for view in range(4):
        block = whole[np.flatnonzero(rows == view)]
        common, arm = block[:, :14], block[:, 14 + 6 * view : 20 + 6 * view]
        inner = arm.T @ arm + np.diag(ROBOT.sigmas**-2.0)
        left = common.T @ common
        left -= common.T @ arm @ np.linalg.solve(inner, arm.T @ common)
        np.testing.assert_allclose(found[view], left, atol=1e-9 * np.abs(left).max())


def test_information_about_a_camera_is_that_of_the_bundle_with_its_poses():
    views = candidates(1, count=16)
    free = freedom(CAMERA, FREE, tied_focal=True)
    found = camera_information(CAMERA, free, views, 0.1)
    for k in (0, 3):
        seen = Observations.from_views(
            [board()[views.seen[k]]], [views.pixels[k][views.seen[k]]], size_px=SIZE
        )
        pose = views.camera_from_target[k : k + 1]
        problem = BundleProblem(seen, free, 0.1)
        whole = np.asarray(
            problem.jacobian(BundleState(CAMERA, pose.rotation, pose.translation_mm))
        )
        inverse = np.linalg.inv(whole.T @ whole)[:4, :4]
        np.testing.assert_allclose(np.linalg.inv(found[k]), inverse, rtol=2e-4)


# --------------------------------------------------------- against chance and a pattern


def pattern(count):
    """What people do: the target in turn at nine places, tilted a little each way."""
    place = np.array([(i, j) for j in (-1, 0, 1) for i in (-1, 0, 1)], float)[:count]
    tilt = np.radians(15) * np.stack(
        [place[:, 1], -place[:, 0], 0 * place[:, 0]], axis=1
    )
    rotation = Rotation.from_rotvec(tilt).as_matrix()
    middle = board().mean(axis=0)
    centre = np.column_stack([15 * place, np.full(count, STAND_OFF)])
    return Poses(rotation, centre - rotation @ middle)


def greedy(views, information, before, weight, count):
    knowledge, chosen = Knowledge(before, weight), []
    for _ in range(count):
        found = choose(
            knowledge, information, lambda i: Refused("had") if i in chosen else i
        )
        assert isinstance(found, Choice)
        chosen.append(found.index)
        knowledge = knowledge.after(information[found.index])
    return views.some(np.array(chosen)), knowledge.error_mm


def at_random(views, information, before, weight, count, rng):
    chosen = rng.choice(len(views), count, replace=False)
    error = Knowledge(before, weight).after(information[chosen]).error_mm
    return views.some(chosen), error


@cache
def camera_errors(seed):
    """Forecast and true error (mm) of greedy, random and patterned views."""
    rng = np.random.default_rng(seed)
    views, free = candidates(seed), freedom(CAMERA, FREE, tied_focal=True)
    weight = camera_task(CAMERA, free, SIZE, STAND_OFF)
    before = np.diag([1e-4, 1e-2, 1e-2, 10.0])
    information = camera_information(CAMERA, free, views, 0.1)
    people = views_of(CAMERA, SIZE, board(), pattern(6))
    told = camera_information(CAMERA, free, people, 0.1)
    plans = [
        greedy(views, information, before, weight, 6),
        at_random(views, information, before, weight, 6, rng),
        (people, Knowledge(before, weight).after(told).error_mm),
    ]
    return np.array([(error, true_camera_error(v, weight, rng)) for v, error in plans])


def true_camera_error(views, weight, rng):
    noisy = views.pixels + rng.normal(0, 0.1, views.pixels.shape)
    seen = Observations.from_views(
        [board()[s] for s in views.seen],
        [p[s] for p, s in zip(noisy, views.seen, strict=True)],
        size_px=SIZE,
    )
    options = CameraOptions(free=FREE, tied_focal=True, sigma_px=0.1, folds=0)
    found = calibrate_camera(seen, options).camera
    off = (found.values - CAMERA.values)[[0, 2, 3, 4]]
    return float(np.sqrt(off @ weight @ off))


@cache
def hand_eye_errors(seed):
    rng = np.random.default_rng(seed)
    views, own = candidates(seed), belief()
    weight = hand_eye_task(own, STAND_OFF)
    information = hand_eye_information(own, views)
    people = views_of(CAMERA, SIZE, board(), pattern(9))
    told = hand_eye_information(own, people)
    plans = [
        greedy(views, information, own.before, weight, 9),
        at_random(views, information, own.before, weight, 9, rng),
        (people, Knowledge(own.before, weight).after(told).error_mm),
    ]
    return np.array([(error, true_hand_eye_error(v, own, rng)) for v, error in plans])


def true_hand_eye_error(views, own, rng):
    count = len(views)
    camera = own.base_from_target @ views.camera_from_target.inverse()
    tool = camera @ own.tool_from_camera.inverse()
    turn = Rotation.from_rotvec(rng.normal(0, ROBOT.angle_rad, (count, 3))).as_matrix()
    shift = rng.normal(0, ROBOT.position_mm, (count, 3))
    told = Poses(turn @ tool.rotation, tool.translation_mm + shift)
    noisy = views.pixels + rng.normal(0, 0.1, views.pixels.shape)
    seen = Observations.from_views(
        [board()[s] for s in views.seen],
        [p[s] for p, s in zip(noisy, views.seen, strict=True)],
        size_px=SIZE,
    )
    found = calibrate_hand_eye(HandEyeData(told, seen, sigma_px=0.1), CAMERA, ROBOT)
    assert found.solution is not None
    x = found.solution.moving_from_camera
    point = np.array([0.0, 0.0, STAND_OFF])
    there = own.tool_from_camera.pose(0, "tool", "camera").apply(point)
    return float(np.linalg.norm(x.apply(point) - there))


@pytest.mark.parametrize("errors_of", [camera_errors, hand_eye_errors])
def test_chosen_views_beat_random_ones_and_a_pattern_by_forecast_and_in_truth(
    errors_of,
):
    errors = np.array([errors_of(seed) for seed in range(2)])
    forecast, truth = errors[..., 0], errors[..., 1]
    assert (forecast[:, 0] < forecast[:, 1]).all()
    assert (forecast[:, 0] < forecast[:, 2]).all()
    rms = np.sqrt((truth**2).mean(axis=0))
    assert rms[0] < rms[1]
    assert rms[0] < rms[2]


@pytest.mark.full
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("errors_of", [camera_errors, hand_eye_errors])
def test_the_forecast_error_is_the_one_that_comes_true(errors_of):
    errors = np.array([errors_of(seed) for seed in range(40)])
    rms = np.sqrt((errors**2).mean(axis=0))
    np.testing.assert_allclose(rms[:2, 1], rms[:2, 0], rtol=0.35)


# ----------------------------------------------------------------- what may be proposed


def test_a_refused_view_is_never_proposed_and_its_reason_is_kept():
    views, own = candidates(3), belief()
    information = hand_eye_information(own, views)
    knowledge = Knowledge(own.before, hand_eye_task(own, STAND_OFF))
    heights = views.camera_from_target.translation_mm[:, 2]
    low = heights < np.quantile(heights, 0.8)
    found = choose(
        knowledge,
        information,
        lambda i: Refused("too low") if low[i] else i,
        most_asked=400,
    )
    assert isinstance(found, Choice)
    assert not low[found.index]
    assert set(found.refused) <= {"too low"}
    errors = knowledge.errors_after(information)
    assert found.forecast_mm == pytest.approx(errors[~low].min())


def test_when_every_view_is_refused_the_reasons_say_so():
    knowledge = Knowledge(np.eye(2), np.eye(2))
    found = choose(knowledge, np.tile(np.eye(2), (5, 1, 1)), lambda _: Refused("wall"))
    assert isinstance(found, NoView)
    assert found.refused["wall"] == 5
    assert "wall" in found.reason
    nothing = first_of(0, lambda _: Refused("wall"))
    assert isinstance(nothing, NoView)
    assert "in focus" in nothing.reason


def test_all_candidates_are_in_focus_and_show_enough_of_the_target():
    band = FocusBand(13.0, 0.034, 2.0, 0.01, 2.0)
    views = candidates(4, focus=band)
    assert len(views) > 40
    assert (views.seen.mean(axis=1) >= WITHIN.share).all()
    poses = views.camera_from_target
    points = board() @ np.swapaxes(poses.rotation, 1, 2) + poses.translation_mm[:, None]
    depth = points[..., 2][views.seen]
    assert band.blur_px(depth).max() <= band.limit_px
    near, far = band.range_mm()
    assert near <= depth.min()
    assert depth.max() <= far
    assert (views.pixels[views.seen] >= 12).all()


def test_candidates_are_the_same_for_the_same_seed():
    one, other = candidates(5), candidates(5)
    np.testing.assert_array_equal(one.pixels, other.pixels)


def test_views_are_forecast_until_the_bar_is_met():
    views, own = candidates(6), belief()
    information = hand_eye_information(own, views)
    knowledge = Knowledge(own.before, hand_eye_task(own, STAND_OFF))
    counts = [views_until(knowledge, information, bar) for bar in (1.0, 0.3, 0.2)]
    assert None not in counts
    assert counts == sorted(counts)
    assert views_until(knowledge, information, 1e-6) is None
    assert views_until(knowledge, information[:0], 1.0) is None


# -------------------------------------------------------------------------- aiming


def test_a_few_pictures_improve_the_aim_from_millimetres_to_tenths():
    rng = np.random.default_rng(7)
    own = belief()
    x, z = own.tool_from_camera, own.base_from_target
    turn = Rotation.from_rotvec([0.02, -0.015, 0.01]).as_matrix()
    rough = Aim(
        Poses(turn @ x.rotation, x.translation_mm + np.array([3.0, -4.0, 2.0])),
        Poses(z.rotation @ turn.T, z.translation_mm + np.array([-6.0, 5.0, 8.0])),
        Doubt(8.0, 0.04),
        Doubt(8.0, 0.04),
        Doubt(0.3, 0.001),
    )
    views = candidates(8).camera_from_target
    chosen = views[rng.choice(len(views), 8, replace=False)]
    tool = z @ chosen.inverse() @ x.inverse()
    better = rough.after(tool, chosen)
    there = views[rng.choice(len(views), 20)]
    wanted = z @ there.inverse() @ x.inverse()
    before = np.linalg.norm(difference(rough.tool_for(there), wanted)[:, :3], axis=1)
    after = np.linalg.norm(difference(better.tool_for(there), wanted)[:, :3], axis=1)
    assert before.mean() > 5
    assert after.max() < 0.8
    np.testing.assert_allclose(
        difference(better.seen_from(better.tool_for(there)), there), 0.0, atol=1e-9
    )


def test_a_view_seen_from_behind_shows_nothing():
    pose = Poses(np.eye(3)[None], np.array([[0.0, 0.0, -300.0]]))
    views = views_of(CAMERA, SIZE, board(), pose)
    assert not views.seen.any()
    pixels = project(CAMERA, np.eye(3), np.array([0.0, 0.0, 300.0]), board()[:1])
    assert np.isfinite(pixels).all()
