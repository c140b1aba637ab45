"""Maximum likelihood with robot slack: derivatives, accuracy, honest covariance."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.estimate import describe, fit
from calibration.hand_eye import (
    CameraPrior,
    Rehearsal,
    RobotNoise,
    calibrate_hand_eye,
    rehearse,
)
from calibration.hand_eye.left_out import left_out_mm, off_rays_mm
from calibration.hand_eye.noise import refine
from calibration.hand_eye.refine import Chain, HandEyeProblem, fixed_camera
from calibration.poses import difference, only
from calibration.projection import PinholeCamera

CAMERA = Rehearsal().camera
SPEC = RobotNoise(0.2, float(np.radians(0.05)))
WIDE = RobotNoise(1.0, float(np.radians(0.25)))


def truth_of(seen, camera=CAMERA):
    return Chain(
        camera, seen.moving_from_camera, seen.fixed_from_target, seen.base_from_tool
    )


def size(step):
    return np.degrees(np.linalg.norm(step[3:])), np.linalg.norm(step[:3])


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
def test_the_derivatives_are_those_of_finite_differences(mount):
    plan = Rehearsal(views=4, robot=SPEC, mount=mount, columns=3, rows=3)
    seen = rehearse(plan, np.random.default_rng(0))
    names = ("fx_px", "cx_px", "k1")
    camera = PinholeCamera(2272, 2272, 799.5, 599.5, -0.1, 0.05, 1e-3, -1e-3)
    prior = CameraPrior(camera, names, np.diag([4.0, 4, 1e-4]))
    problem = HandEyeProblem(seen.data, prior, SPEC.sigmas)
    state = Chain(
        camera,
        seen.moving_from_camera,
        seen.fixed_from_target,
        seen.data.base_from_tool,
    )
    jacobian = problem.jacobian(state).toarray()
    numeric = np.stack(
        [
            problem.residuals(problem.moved(state, 1e-6 * unit))
            - problem.residuals(problem.moved(state, -1e-6 * unit))
            for unit in np.eye(len(problem.names))
        ],
        axis=1,
    )
    np.testing.assert_allclose(jacobian, numeric / 2e-6, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
def test_without_noise_pixels_give_the_exact_transform(mount):
    seen = rehearse(Rehearsal(views=12, sigma_px=0.0, mount=mount, stated_px=0.1),
                    np.random.default_rng(5))  # fmt: skip
    result = calibrate_hand_eye(seen.data, CAMERA, SPEC)
    assert result.verdict.grade == "go"
    found = result.solution.moving_from_camera
    assert found.target == ("tool" if mount == "eye-in-hand" else "base")
    step = difference(only(found), seen.moving_from_camera)[0]
    assert max(size(step)) < 1e-9


def _trials(count, noise, stated, first=100):
    errors, closed, normalised, inside = [], [], [], []
    for seed in range(first, first + count):
        seen = rehearse(Rehearsal(robot=noise), np.random.default_rng(seed))
        result = calibrate_hand_eye(seen.data, CAMERA, stated)
        solution = result.solution
        step = difference(only(solution.moving_from_camera), seen.moving_from_camera)[0]
        start = only(solution.closed_forms["tsai-lenz"])
        errors.append(size(step))
        closed.append(size(difference(start, seen.moving_from_camera)[0]))
        inside.append(np.abs(step) < np.sqrt(np.diag(solution.covariance)))
        if noise is not None:
            problem = HandEyeProblem(seen.data, fixed_camera(CAMERA), noise.sigmas)
            bound = describe(problem, truth_of(seen)).covariance[:6, :6]
            normalised.append(step @ np.linalg.solve(bound, step) / 6)
    rms = [np.sqrt((np.array(rows) ** 2).mean(axis=0)) for rows in (errors, closed)]
    return *rms, float(np.mean(inside)), np.sqrt(np.mean(normalised or [0.0]))


def test_the_refinement_is_better_than_the_closed_form():
    refined, closed, _, _ = _trials(6, SPEC, WIDE)
    assert (refined <= (0.04, 0.24)).all()
    assert (refined < closed).all()


@pytest.mark.full
@pytest.mark.timeout(3600)
def test_the_refinement_reaches_the_bars_and_the_bound_and_knows_it():
    refined, closed, inside, spread = _trials(30, SPEC, WIDE)
    assert (refined <= (0.04, 0.24)).all()
    assert (refined <= closed).all()
    assert 0.55 <= inside <= 0.80
    assert spread <= 1.15


@pytest.mark.full
@pytest.mark.timeout(3600)
def test_with_a_perfect_robot_only_pixels_limit():
    stated = RobotNoise(0.05, float(np.radians(0.005)))
    refined, _, inside, _ = _trials(30, None, stated)
    assert (refined <= (0.012, 0.06)).all()
    assert 0.55 <= inside <= 0.80


def test_the_noise_of_the_robot_is_found_whatever_was_stated():
    seen = rehearse(
        Rehearsal(robot=SPEC, views=30, columns=6, rows=5), np.random.default_rng(8)
    )
    solution = calibrate_hand_eye(seen.data, CAMERA, WIDE).solution
    assert solution.robot_sigmas[0] == pytest.approx(0.2, rel=0.3)
    assert np.degrees(solution.robot_sigmas[1]) == pytest.approx(0.05, rel=0.3)
    assert solution.sigma_px == pytest.approx(0.2, rel=0.05)
    assert solution.slack_rms[0] == pytest.approx(0.35, rel=0.4)


def test_a_robot_better_than_stated_is_found_to_be_so():
    seen = rehearse(Rehearsal(views=12, columns=5, rows=4), np.random.default_rng(4))
    found = calibrate_hand_eye(seen.data, CAMERA, SPEC).solution
    assert (found.robot_sigmas < 0.15 * SPEC.sigmas[[0, 3]]).all()
    assert (found.robot_sigmas > 0).all()


def test_where_the_views_say_nothing_of_the_robot_what_was_stated_stays():
    plan = Rehearsal(views=12, columns=5, rows=4, sigma_px=2.0, robot=SPEC)
    seen = rehearse(plan, np.random.default_rng(6))
    best = RobotNoise(1e-3, 1e-6)
    found = calibrate_hand_eye(seen.data, CAMERA, best).solution
    np.testing.assert_allclose(found.robot_sigmas, best.sigmas[[0, 3]], rtol=0.5)


def test_leaving_a_view_out_by_one_step_is_as_fitting_again():
    seen = rehearse(Rehearsal(robot=SPEC, views=10), np.random.default_rng(3))
    problem = HandEyeProblem(seen.data, fixed_camera(CAMERA), SPEC.sigmas)
    refined = refine(problem, truth_of(seen))
    quick = left_out_mm(refined)
    rest = refined.problem.data.of_views(range(9))
    start = truth_of(seen)
    start = Chain(CAMERA, start.moving_from_camera, start.fixed_from_target,
                  seen.base_from_tool[:9])  # fmt: skip
    again = fit(
        HandEyeProblem(rest, fixed_camera(CAMERA), refined.problem.slack_sigmas), start
    ).state
    full = Chain(CAMERA, again.moving_from_camera, again.fixed_from_target,
                 seen.base_from_tool)  # fmt: skip
    rows = seen.data.seen.view == 9
    slow = np.sqrt((off_rays_mm(problem, full, rows) ** 2).mean())
    assert quick[9] == pytest.approx(slow, rel=0.02)


def test_wrong_intrinsics_are_mended_together_with_the_transform():
    seen = rehearse(Rehearsal(robot=SPEC), np.random.default_rng(21))
    wrong = PinholeCamera(2272 * 1.004, 2272 * 1.004, 805.0, 596.0)
    names = ("fx_px", "fy_px", "cx_px", "cy_px")
    prior = CameraPrior(wrong, names, np.diag([12.0, 12, 6, 6]) ** 2)
    held = calibrate_hand_eye(seen.data, wrong, WIDE)
    free = calibrate_hand_eye(seen.data, prior, WIDE)
    assert free.solution.camera.fx_px == pytest.approx(2272, abs=3)

    def error(result):
        found = only(result.solution.moving_from_camera)
        return size(difference(found, seen.moving_from_camera)[0])[1]

    assert error(free) < 0.5 * error(held)


def test_the_expected_error_grows_with_the_distance():
    seen = rehearse(Rehearsal(robot=SPEC, columns=5, rows=4), np.random.default_rng(1))
    solution = calibrate_hand_eye(seen.data, CAMERA, WIDE).solution
    trace = np.sqrt(np.trace(solution.covariance[:3, :3]))
    assert solution.error_mm(0.0) == pytest.approx(trace)
    assert solution.error_mm(3000.0) > 3 * solution.error_mm(400.0)
