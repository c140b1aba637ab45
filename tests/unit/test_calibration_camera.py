"""Camera calibration beside OpenCV, and against the truth of seeded scenes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.bundle import BundleProblem, BundleState, freedom
from calibration.camera import CameraOptions, calibrate_camera
from calibration.camera_uncertainty import projection_uncertainty
from calibration.observations import Observations
from calibration.planar import planar_pose
from calibration.projection import (
    CAMERA_NAMES,
    PinholeCamera,
    moved_pose,
    project,
    project_with_derivatives,
)
from mvp.errors import CalibrationError

DATA = Path(__file__).parents[2].parent / "shared" / "data"
CAMERA = PinholeCamera(2376.4, 2376.4, 806.0, 595.0, k1=-0.12, k2=0.05)
FREE = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2")
SIGMA_PX = 0.1


def board(columns=12, rows=9, square_mm=25.0):
    grid = np.zeros((columns * rows, 3))
    grid[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2) * square_mm
    return grid - grid.mean(axis=0)


def tilted_views(rng, count, *, tilt_deg=(25, 40), distance_mm=500.0):
    """Poses tilted about axes spread over the circle."""
    about = np.arange(count) * 2 * np.pi / count + rng.uniform(0, 1)
    tilt = np.radians(rng.uniform(*tilt_deg, count))
    axis = np.stack([np.cos(about), np.sin(about), np.zeros(count)], axis=1)
    roll = Rotation.from_rotvec(np.outer(rng.uniform(-0.3, 0.3, count), [0, 0, 1]))
    turn = Rotation.from_rotvec(axis * tilt[:, None]) * roll
    shift = np.column_stack(
        [rng.uniform(-8, 8, (count, 2)), np.full(count, distance_mm)]
    )
    return turn.as_matrix(), shift


def seen_by(camera, poses, points, rng, sigma_px=SIGMA_PX):
    pixels = project(camera, poses[0][:, None], poses[1][:, None], points)
    pixels = pixels + rng.normal(0, 1, pixels.shape) * sigma_px
    return Observations.from_views(
        [points] * len(pixels), list(pixels), size_px=(1600, 1200)
    )


def opencv_board(side, window):
    folder = DATA / "opencv_chessboard"
    if not folder.is_dir():
        pytest.skip("the OpenCV chessboard pictures are not here")
    points = np.zeros((54, 3))
    points[:, :2] = 25 * np.mgrid[0:9, 0:6].T.reshape(-1, 2)
    pixels, names = [], []
    for path in sorted(folder.glob(f"{side}*.jpg")):
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        found, corners = cv2.findChessboardCorners(grey, (9, 6))
        assert found
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
        corners = cv2.cornerSubPix(grey, corners, (window, window), (-1, -1), stop)
        pixels.append(corners[:, 0].astype(float))
        names.append(path.stem)
    return Observations.from_views(
        [points] * len(pixels), pixels, size_px=(640, 480), names=names
    )


def opencv_answer(seen):
    points = [p.astype(np.float32) for p in np.split(seen.points_target_mm, seen.views)]
    pixels = [p.astype(np.float32) for p in np.split(seen.pixels, seen.views)]
    size = (seen.width_px, seen.height_px)
    rms, matrix, distortion, *_ = cv2.calibrateCamera(points, pixels, size, None, None)
    return rms, matrix, distortion.ravel()


@pytest.mark.parametrize(
    ("side", "window", "rms_px", "fx_px", "centre_px"),
    [
        ("left", 5, 0.1954, 532.83, (342.49, 233.86)),
        ("left", 11, 0.4088, 536.07, (342.37, 235.54)),
        ("right", 5, 0.2070, 537.45, (327.59, 248.88)),
    ],
)
def test_real_boards_give_what_opencv_gives(side, window, rms_px, fx_px, centre_px):
    seen = opencv_board(side, window)
    folds = 3 if (side, window) == ("left", 5) else 0
    found = calibrate_camera(seen, CameraOptions(folds=folds))
    assert found.rms_px == pytest.approx(rms_px, abs=2e-4)
    assert found.camera.fx_px == pytest.approx(fx_px, abs=0.02)
    assert (found.camera.cx_px, found.camera.cy_px) == pytest.approx(
        centre_px, abs=0.02
    )
    rms, matrix, distortion = opencv_answer(seen)
    assert found.rms_px == pytest.approx(rms, rel=1e-6)
    np.testing.assert_allclose(found.camera.matrix, matrix, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(found.camera.distortion, distortion, atol=1e-4)
    if folds:
        assert found.out_of_sample_px is not None
        assert rms_px < found.out_of_sample_px < 1.3 * rms_px


def test_a_picture_whose_corners_were_refined_too_widely_is_named():
    found = calibrate_camera(opencv_board("left", 11), CameraOptions(folds=0))
    assert found.verdict.grade == "marginal"
    assert found.verdict.codes() == {"view-does-not-fit"}
    assert "left02" in found.verdict.next_action


def test_derivatives_of_the_bundle_agree_with_finite_differences():
    rng = np.random.default_rng(0)
    poses = tilted_views(rng, 3)
    seen = seen_by(CAMERA, poses, board(4, 3), rng)
    free = freedom(CAMERA, FREE, tied_focal=True)
    problem = BundleProblem(seen, free, 0.2, (("cx_px", 800.0, 3.0),))
    state = BundleState(CAMERA, *poses)
    count = len(problem.names)
    for column, size in enumerate(1e-3 * problem.scales):
        step = np.zeros(count)
        step[column] = size
        ahead = problem.residuals(problem.moved(state, step))
        behind = problem.residuals(problem.moved(state, -step))
        slope = (ahead - behind) / (2 * size)
        np.testing.assert_allclose(
            problem.jacobian(state)[:, [column]].toarray()[:, 0],
            slope,
            rtol=1e-5,
            atol=1e-5 * np.abs(slope).max(),
        )


def test_perfect_pictures_give_the_exact_camera():
    rng = np.random.default_rng(1)
    seen = seen_by(CAMERA, tilted_views(rng, 5), board(), rng, sigma_px=0.0)
    found = calibrate_camera(seen, CameraOptions(folds=0, sigma_px=0.1))
    np.testing.assert_allclose(found.camera.values, CAMERA.values, atol=1e-7, rtol=1e-9)


def errors_in_sigmas(trials, views, camera, options):
    """(trials, n) errors, and stated sigmas."""
    index = [CAMERA_NAMES.index(name) for name in options.free]
    errors, sigmas = [], []
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        seen = seen_by(camera, tilted_views(rng, views), board(), rng)
        found = calibrate_camera(seen, options)
        assert found.verdict.grade == "go"
        errors.append((found.camera.values - camera.values)[index])
        sigmas.append([found.sigma_of(name) for name in options.free])
    return np.array(errors), np.array(sigmas)


def check_spread(errors, sigmas):
    """Spread within 1.15 of the bound, 55 to 80 % within one sigma.

    Both are widened by two standard errors of so many trials.
    """
    scaled = errors / sigmas
    trials = len(scaled)
    spread = np.sqrt((scaled**2).mean())
    assert spread < 1.15 + 2 / np.sqrt(2 * trials * 2)
    slack = 2 * 0.47 / np.sqrt(2 * trials) if trials < 30 else 0.0
    assert 0.55 - slack < (np.abs(scaled) < 1).mean() < 0.80 + slack


KNOWN_NOISE = CameraOptions(free=FREE, sigma_px=SIGMA_PX, folds=0)
ONE_RADIAL = CameraOptions(
    free=("fx_px", "cx_px", "cy_px", "k1"), tied_focal=True, sigma_px=SIGMA_PX, folds=0
)


def test_a_few_views_reach_the_bound_and_say_so():
    errors, sigmas = errors_in_sigmas(6, 5, CAMERA, KNOWN_NOISE)
    check_spread(errors, sigmas)


@pytest.mark.full
def test_many_trials_reach_the_bound_and_say_so():
    check_spread(*errors_in_sigmas(40, 6, CAMERA, KNOWN_NOISE))


@pytest.mark.full
@pytest.mark.parametrize(
    ("views", "focal", "centre_px"), [(5, 1.6e-4, 0.5), (10, 0.9e-4, 0.35)]
)
def test_many_tilted_views_reach_the_accuracy_of_the_table(views, focal, centre_px):
    camera = replace(CAMERA, k2=0.0)
    errors, sigmas = errors_in_sigmas(30, views, camera, ONE_RADIAL)
    check_spread(errors, sigmas)
    rms = np.sqrt((errors**2).mean(axis=0))
    assert rms[0] / CAMERA.fx_px < focal
    assert rms[1:3].max() < centre_px


def test_the_stated_bound_is_that_of_the_true_camera():
    rng = np.random.default_rng(5)
    poses = tilted_views(rng, 6)
    seen = seen_by(CAMERA, poses, board(), rng)
    found = calibrate_camera(seen, CameraOptions(free=FREE, sigma_px=SIGMA_PX, folds=0))
    jacobian = np.zeros((len(seen.view), 2, 6 + 36))
    for row, view in enumerate(seen.view):
        truth = project_with_derivatives(
            CAMERA, poses[0][view], poses[1][view], seen.points_target_mm[row]
        )
        jacobian[row, :, :6] = truth.d_camera[:, :6]
        jacobian[row, :, 6 + 6 * view : 12 + 6 * view] = truth.d_pose
    flat = jacobian.reshape(-1, 42) / SIGMA_PX
    bound = np.sqrt(np.diag(np.linalg.pinv(flat.T @ flat, rcond=1e-18)))[:6]
    np.testing.assert_allclose([found.sigma_of(n) for n in FREE], bound, rtol=0.02)


def test_a_target_parallel_to_the_sensor_is_refused_whatever_the_residual():
    rng = np.random.default_rng(2)
    seen = seen_by(CAMERA, tilted_views(rng, 5, tilt_deg=(0.5, 2)), board(), rng)
    found = calibrate_camera(seen, CameraOptions(free=FREE, sigma_px=SIGMA_PX))
    assert found.rms_px < 0.15
    assert found.verdict.grade == "no-go"
    assert "target nearly parallel to sensor" in " ".join(found.verdict.reasons)
    assert "tilt the target" in " ".join(c.action for c in found.verdict.causes)


def test_a_mirrored_target_is_refused():
    rng = np.random.default_rng(3)
    seen = seen_by(CAMERA, tilted_views(rng, 4), board(), rng)
    swapped = seen.points_target_mm * [-1, 1, 1]
    found = calibrate_camera(
        replace(seen, points_target_mm=swapped), CameraOptions(free=FREE)
    )
    assert "target-mirrored" in found.verdict.codes()
    assert found.verdict.grade == "no-go"


def test_noise_above_the_stated_one_is_said():
    rng = np.random.default_rng(4)
    seen = seen_by(CAMERA, tilted_views(rng, 4), board(), rng, sigma_px=0.25)
    found = calibrate_camera(seen, CameraOptions(free=FREE, sigma_px=SIGMA_PX, folds=0))
    assert found.verdict.codes() == {"residuals-above-noise"}
    assert found.estimate.inflated


def test_a_picture_at_another_lens_setting_is_noticed():
    rng = np.random.default_rng(6)
    poses = tilted_views(rng, 6)
    seen = seen_by(CAMERA, poses, board(), rng)
    other = replace(CAMERA, fx_px=2480.0, fy_px=2480.0, cy_px=560.0, k1=0.1)
    strange = seen_by(other, poses, board(), rng)
    rows = seen.view == 4
    pixels = np.where(rows[:, None], strange.pixels, seen.pixels)
    found = calibrate_camera(
        replace(seen, pixels=pixels), CameraOptions(free=FREE, sigma_px=SIGMA_PX)
    )
    assert found.verdict.grade != "go"


def test_a_prior_holds_what_the_views_do_not_tell():
    rng = np.random.default_rng(7)
    seen = seen_by(CAMERA, tilted_views(rng, 1), board(), rng)
    free = CameraOptions(free=FREE, sigma_px=SIGMA_PX)
    held = replace(free, priors=(("cx_px", 806.0, 0.5), ("cy_px", 595.0, 0.5)))
    alone, helped = calibrate_camera(seen, free), calibrate_camera(seen, held)
    assert helped.sigma_of("cx_px") < 0.5 < alone.sigma_of("cx_px")
    assert abs(helped.camera.cx_px - 806) < 1.5


def test_a_tied_focal_length_keeps_its_ratio():
    rng = np.random.default_rng(8)
    stretched = replace(CAMERA, fy_px=CAMERA.fx_px * 1.2)
    seen = seen_by(stretched, tilted_views(rng, 4), board(), rng)
    options = CameraOptions(
        free=FREE, tied_focal=True, aspect=1.2, sigma_px=SIGMA_PX, folds=0
    )
    found = calibrate_camera(seen, options)
    assert found.camera.fy_px / found.camera.fx_px == pytest.approx(1.2, rel=1e-12)
    assert found.sigma_of("fy_px") == pytest.approx(1.2 * found.sigma_of("fx_px"))
    assert abs(found.camera.fx_px - CAMERA.fx_px) < 4 * found.sigma_of("fx_px")


def test_outlying_corners_move_a_robust_fit_little():
    rng = np.random.default_rng(9)
    seen = seen_by(CAMERA, tilted_views(rng, 5), board(), rng)
    pixels = seen.pixels.copy()
    pixels[::40] += rng.normal(0, 5, pixels[::40].shape)
    spoilt = replace(seen, pixels=pixels)
    options = CameraOptions(free=FREE, sigma_px=SIGMA_PX, folds=0)
    plain = calibrate_camera(spoilt, options)
    robust = calibrate_camera(spoilt, replace(options, huber=2.0))
    assert abs(robust.camera.fx_px - CAMERA.fx_px) < 2.0
    assert abs(robust.camera.fx_px - CAMERA.fx_px) < abs(
        plain.camera.fx_px - CAMERA.fx_px
    )


def test_outlying_corners_are_weighed_down_without_a_stated_noise_too():
    rng = np.random.default_rng(9)
    seen = seen_by(CAMERA, tilted_views(rng, 5), board(), rng)
    pixels = seen.pixels.copy()
    pixels[::40] += rng.normal(0, 5, pixels[::40].shape)
    spoilt = replace(seen, pixels=pixels)
    found = calibrate_camera(spoilt, CameraOptions(free=FREE, huber=2.0, folds=0))
    assert found.sigma_px == pytest.approx(SIGMA_PX, rel=0.25)
    assert abs(found.camera.fx_px - CAMERA.fx_px) < 2.0


def test_perfect_pictures_of_unknown_noise_are_no_contradiction():
    rng = np.random.default_rng(12)
    seen = seen_by(CAMERA, tilted_views(rng, 4), board(), rng, sigma_px=0.0)
    found = calibrate_camera(seen, CameraOptions(free=FREE))
    assert found.verdict.grade == "go"
    assert found.camera.fx_px == pytest.approx(CAMERA.fx_px, rel=1e-9)


def test_two_views_are_too_few_for_a_go():
    rng = np.random.default_rng(13)
    seen = seen_by(CAMERA, tilted_views(rng, 2), board(), rng)
    found = calibrate_camera(seen, CameraOptions(free=FREE, sigma_px=SIGMA_PX))
    assert "few-views" in found.verdict.codes()
    assert found.verdict.grade == "marginal"


def test_points_on_a_line_name_their_picture():
    points = np.column_stack([np.arange(12.0), np.zeros(12), np.zeros(12)])
    pixels = np.column_stack([100 + 10 * np.arange(12.0), np.full(12, 300.0)])
    seen = Observations.from_views(
        [points], [pixels], size_px=(640, 480), names=["view A"]
    )
    with pytest.raises(CalibrationError, match="view A: the points lie on a line"):
        calibrate_camera(seen)


def test_the_projection_uncertainty_is_that_of_a_monte_carlo():
    rng = np.random.default_rng(10)
    seen = seen_by(CAMERA, tilted_views(rng, 6), board(), rng)
    found = calibrate_camera(seen, CameraOptions(free=FREE, sigma_px=SIGMA_PX, folds=0))
    stated = projection_uncertainty(
        found.camera,
        found.camera_covariance,
        size_px=(1600, 1200),
        distance_mm=500.0,
        grid=(3, 3),
    )
    rays = (
        stated.pixels - [found.camera.cx_px, found.camera.cy_px]
    ) / found.camera.fx_px
    point = np.append(rays[1, 1], 1.0) * 500
    draws = rng.multivariate_normal(found.camera.values, found.camera_covariance, 4000)
    there = [
        project(PinholeCamera.from_values(draw), np.eye(3), np.zeros(3), point)
        for draw in draws
    ]
    worst = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(there).T))[-1])
    assert stated.direct_px[1, 1] == pytest.approx(worst, rel=0.05)
    assert (stated.refitted_px < stated.direct_px).all()
    assert stated.direct_mm[1, 1] == pytest.approx(worst * 500 / 2376.4, rel=0.06)


def test_a_motion_leaves_no_refitted_uncertainty():
    turned = project_with_derivatives(
        CAMERA.without_distortion(), np.eye(3), np.zeros(3), np.array([0, 0, 500.0])
    )
    assert moved_pose(np.eye(3), np.zeros(3), np.zeros(6))[1].tolist() == [0, 0, 0]
    covariance = np.zeros((9, 9))
    covariance[2, 2] = 4.0
    stated = projection_uncertainty(
        CAMERA.without_distortion(),
        covariance,
        size_px=(1600, 1200),
        distance_mm=500.0,
    )
    assert turned.pixels[0] == CAMERA.cx_px
    assert stated.direct_px == pytest.approx(2.0)
    assert stated.refitted_px.max() < 0.5
    assert len(CAMERA_NAMES) == 9


@pytest.mark.parametrize("tilt_deg", [0.0, 3.0, 8.0, 20.0, 45.0])
def test_of_the_two_poses_of_a_flat_target_the_right_one_is_found(tilt_deg):
    rng = np.random.default_rng(int(tilt_deg))
    rotation, shift = tilted_views(rng, 4, tilt_deg=(tilt_deg, tilt_deg))
    for turn, place in zip(rotation, shift, strict=True):
        pixels = project(CAMERA, turn, place, board())
        found, moved = planar_pose(CAMERA, board(), pixels)
        np.testing.assert_allclose(found, turn, atol=1e-5)
        np.testing.assert_allclose(moved, place, atol=1e-2)
