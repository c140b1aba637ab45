"""Targets that are bent or stretched: found with the camera, said, and not believed far."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.bundle import BundleProblem, BundleState, freedom
from calibration.camera import CameraOptions, calibrate_camera
from calibration.observations import Observations
from calibration.projection import PinholeCamera, project
from calibration.target_shape import (
    SHAPE_NAMES,
    ShapedProblem,
    ShapedState,
    ShapePrior,
    TargetShape,
)
from calibration.wizard.camera_views import camera_options
from calibration.wizard.lens_shape import LENS_NAMES, shared
from tools.bench_calibration_real import DATA, SIDES, chessboards

CAMERA = PinholeCamera(1500.0, 1500.0, 645.0, 475.0, k1=-0.1)
SIZE = (1280, 960)
NOISE_PX = 0.1
FREE = ("fx_px", "fy_px", "cx_px", "cy_px", "k1")


def board():
    x, y = np.meshgrid(np.arange(9), np.arange(6))
    flat = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * 25.0
    return flat - flat.mean(axis=0)


def bowed(points, bow_mm):
    share = points[:, 0] / points[:, 0].max()
    return points + np.outer(bow_mm * (1 - share**2), [0, 0, 1.0])


def stretched(points, share):
    return points * [1.0, 1.0 + share, 1.0]


def tilted(rng, count):
    about = rng.uniform(0, 1) + 2 * np.pi * np.arange(count) / count
    axis = np.stack([np.cos(about), np.sin(about), 0 * about], axis=1)
    roll = Rotation.from_rotvec(np.outer(0.7 * np.cos(3 * about), [0, 0, 1.0]))
    turn = Rotation.from_rotvec(np.radians(32.0) * axis) * roll
    place = np.array([0, 0, 420.0]) + rng.uniform(-8, 8, (count, 3))
    return turn.as_matrix(), place


def views(rng, printed, count=14):
    """Pictures of a board as it is, told to be as it should be."""
    pixels = [
        project(CAMERA, turn, place, printed)
        + rng.normal(0, NOISE_PX, (len(printed), 2))
        for turn, place in zip(*tilted(rng, count), strict=True)
    ]
    return Observations.from_views([board()] * count, pixels, size_px=SIZE)


def calibrated(seen, folds=0):
    """As the camera wizard does it."""
    options = camera_options(1.0, ShapePrior.of_a_print(board()))
    return calibrate_camera(seen, replace(options, folds=folds))


def in_sigmas(found):
    names = ("fx_px", "cx_px", "cy_px")
    return np.array(
        [
            (getattr(found.camera, name) - getattr(CAMERA, name)) / found.sigma_of(name)
            for name in names
        ]
    )


def test_derivatives_for_the_shape_agree_with_finite_differences():
    rng = np.random.default_rng(0)
    poses = tilted(rng, 3)
    seen = views(rng, board(), 3)
    flat = BundleProblem(seen, freedom(CAMERA, FREE), 0.2, (("k1", 0.0, 0.5),))
    problem = ShapedProblem(flat, ShapePrior(1.0, 0.01))
    shape = replace(
        TargetShape.flat(board()), values=np.array([0.6, -0.2, 0.1, 4e-3, -2e-3])
    )
    state = ShapedState(BundleState(CAMERA, *poses), shape)
    jacobian = problem.jacobian(state).toarray()
    assert jacobian.shape == (len(problem.residuals(state)), len(problem.names))
    for column, size in enumerate(1e-3 * problem.scales):
        step = np.zeros(len(problem.names))
        step[column] = size
        ahead = problem.residuals(problem.moved(state, step))
        behind = problem.residuals(problem.moved(state, -step))
        slope = (ahead - behind) / (2 * size)
        np.testing.assert_allclose(
            jacobian[:, column], slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max()
        )


def test_one_view_alone_has_the_same_derivatives_as_several():
    rng = np.random.default_rng(1)
    turn, place = tilted(rng, 2)
    seen = views(rng, board(), 2)
    both = ShapedProblem(
        BundleProblem(seen, freedom(CAMERA, FREE), 0.2), ShapePrior(1.0, 0.01)
    )
    alone = replace(both, flat=replace(both.flat, seen=seen.of_views([0])))
    shape = TargetShape.flat(board())
    state = ShapedState(BundleState(CAMERA, turn, place), shape)
    first = replace(state, bundle=state.bundle.of_views([0]))
    own = np.r_[0:11, 17:22]
    rows = np.r_[0 : 2 * len(board()), -5:0]
    np.testing.assert_allclose(
        alone.jacobian(first), both.jacobian(state).toarray()[np.ix_(rows, own)]
    )


@pytest.mark.parametrize(
    ("printed", "grade", "words"),
    [
        pytest.param(lambda p: p, "go", "", marks=pytest.mark.full),
        (lambda p: bowed(p, 0.3), "go", "bow 0.3"),
        pytest.param(
            lambda p: bowed(p, 0.6), "marginal", "bow 0.6", marks=pytest.mark.full
        ),
        (lambda p: bowed(p, 1.0), "marginal", "bow 1.0"),
        pytest.param(
            lambda p: stretched(p, 0.002),
            "go",
            "% longer along y",
            marks=pytest.mark.full,
        ),
        pytest.param(
            lambda p: stretched(p, 0.005),
            "marginal",
            "% longer along y",
            marks=pytest.mark.full,
        ),
        (lambda p: stretched(p, -0.01), "marginal", "% longer along x"),
    ],
)
def test_a_bent_or_stretched_board_is_said_and_the_camera_stays_right(
    printed, grade, words
):
    found = calibrated(views(np.random.default_rng(3), printed(board())))
    assert np.abs(in_sigmas(found)).max() < 1.96
    assert found.sigma_of("fx_px") < 0.6
    assert found.verdict.grade == grade
    assert found.shape is not None
    assert words in found.shape.words
    assert bool(found.shape.words) is bool(words)


@pytest.mark.parametrize(
    ("printed", "code"),
    [
        (lambda p: bowed(p, 2.0), "target-not-flat"),
        (lambda p: stretched(p, 0.02), "target-stretched"),
    ],
)
def test_what_is_too_far_from_the_stated_target_is_refused(printed, code):
    found = calibrated(views(np.random.default_rng(3), printed(board()), 6))
    assert found.verdict.grade == "no-go"
    assert found.verdict.codes() == {code}
    assert "check" in found.verdict.next_action or "glass" in found.verdict.next_action


def test_a_flat_target_taken_at_its_word_and_bent_gives_a_wrong_camera_unnoticed():
    """Why the shape is sought: without it neither residual nor sigma shows the error."""
    seen = views(np.random.default_rng(3), bowed(board(), 0.6))
    told = camera_options(1.0, ShapePrior.of_a_print(board()))
    flat = calibrate_camera(
        seen, replace(told, shape=None, largest_noise_px=None, folds=0)
    )
    assert flat.verdict.grade == "go"
    assert in_sigmas(flat)[0] > 6.0


def test_a_target_bent_in_another_way_shows_as_noise_that_corners_do_not_have():
    points = board()
    share = points[:, 0] / points[:, 0].max()
    wave = points + np.outer(0.8 * (share**3 - share), [0, 0, 1.0])
    found = calibrated(views(np.random.default_rng(4), wave))
    assert "residuals-above-noise" in found.verdict.codes()
    assert "the target" in found.verdict.next_action


def test_held_out_views_of_a_bent_board_are_foretold_with_its_shape():
    seen = views(np.random.default_rng(5), bowed(board(), 0.6), 6)
    found = calibrated(seen, folds=2)
    assert found.out_of_sample_px is not None
    assert found.out_of_sample_px < 1.4 * found.rms_px


def test_where_noise_is_known_the_shape_is_found_with_it():
    seen = views(np.random.default_rng(6), bowed(board(), 0.3), 5)
    prior = ShapePrior.of_a_print(board())
    found = calibrate_camera(
        seen, CameraOptions(free=FREE, sigma_px=NOISE_PX, folds=0, shape=prior)
    )
    assert found.shape is not None
    assert found.shape.found == ("bow_x_mm",)
    assert not found.estimate.inflated
    bow = found.shape.shape.values[0]
    assert abs(bow - 0.3) < 4 * found.shape.sigmas[0]


@pytest.mark.full
@pytest.mark.parametrize("bow_mm", [0.0, 0.6])
def test_errors_beside_a_found_shape_are_as_large_as_stated(bow_mm):
    printed = bowed(board(), bow_mm)
    scaled = np.array(
        [
            in_sigmas(calibrated(views(np.random.default_rng([9, seed]), printed)))
            for seed in range(40)
        ]
    )
    assert np.sqrt((scaled**2).mean()) < 1.15
    assert 0.55 < (np.abs(scaled) < 1).mean() < 0.80


def test_a_prior_without_width_is_refused():
    with pytest.raises(ValueError, match="positive"):
        ShapePrior(0.0, 0.001)
    assert len(SHAPE_NAMES) == len(ShapePrior(1.0, 0.01).sigmas)


def nodes_of_one_lens(rng, printed):
    """The same board at several principal distances, five views each."""
    prior = ShapePrior.of_a_print(board())
    for f_px in (1200.0, 1500.0, 1900.0):
        lens = replace(CAMERA, fx_px=f_px, fy_px=f_px)
        turns, places = tilted(rng, 5)
        pixels = [
            project(lens, turn, place * [1, 1, f_px / 1500.0], printed)
            + rng.normal(0, NOISE_PX, (len(printed), 2))
            for turn, place in zip(turns, places, strict=True)
        ]
        seen = Observations.from_views([board()] * 5, pixels, size_px=SIZE)
        options = CameraOptions(free=FREE, tied_focal=True, folds=0, shape=prior)
        yield f_px, calibrate_camera(seen, options)


def test_nodes_of_a_lens_share_what_they_know_of_the_target():
    rng, prior = np.random.default_rng(8), ShapePrior.of_a_print(board())
    truth, found = zip(*nodes_of_one_lens(rng, bowed(board(), 0.4)), strict=True)
    told = shared(found, prior)
    for f_px, alone, together in zip(truth, found, told, strict=True):
        sigma = float(np.sqrt(together.covariance[0, 0]))
        assert sigma < alone.sigma_of("fx_px")
        assert abs(together.values[0] - f_px) < 2.5 * sigma
        np.testing.assert_allclose(
            together.shape.shape.values, told[0].shape.shape.values, atol=1e-9
        )
        assert alone.shape is not None
        assert (together.shape.sigmas < alone.shape.sigmas).all()
    assert told[0].shape.found == ("bow_x_mm",)
    assert abs(told[0].shape.shape.values[0] - 0.4) < 3 * told[0].shape.sigmas[0]


def test_a_node_alone_knows_what_it_knew():
    rng, prior = np.random.default_rng(8), ShapePrior.of_a_print(board())
    _, found = next(nodes_of_one_lens(rng, board()))
    (told,) = shared([found], prior)
    assert told.values[0] == pytest.approx(found.camera.fx_px)
    np.testing.assert_allclose(
        told.covariance, found.estimate.block(LENS_NAMES), rtol=1e-6, atol=1e-12
    )


@pytest.mark.full
@pytest.mark.parametrize("side", SIDES)
def test_both_cameras_see_the_same_bow_of_a_real_board(side):
    """mrcal's two warp terms for the left pictures are 0.03 mm and 0.18 mm."""
    if not (DATA / "opencv_chessboard").is_dir():
        pytest.skip("the OpenCV chessboard pictures are not here")
    seen = chessboards(side)
    prior = ShapePrior.of_a_print(seen.points_target_mm)
    found = calibrate_camera(seen, CameraOptions(folds=0, shape=prior))
    assert found.shape is not None
    across, along, *_ = np.abs(found.shape.shape.values)
    assert across == pytest.approx(0.03, abs=0.05)
    assert along == pytest.approx(0.18, abs=0.04)
    assert "bow_y_mm" in found.shape.found
    assert "bow_x_mm" not in found.shape.found
    assert found.rms_px < calibrate_camera(seen, CameraOptions(folds=0)).rms_px


def test_a_board_that_was_measured_is_known_better_and_the_camera_with_it():
    seen = views(np.random.default_rng(3), board(), 5)
    unknown = ShapePrior.of_a_print(board())
    measured = unknown.known(flat_mm=0.02, stretch=3e-4)
    found = [
        calibrate_camera(seen, replace(camera_options(1.0, prior), folds=0))
        for prior in (unknown, measured)
    ]
    for one, prior in zip(found, (unknown, measured), strict=True):
        assert (one.shape.sigmas <= 1.001 * prior.sigmas).all()
        assert np.abs(in_sigmas(one)).max() < 3
    assert found[1].sigma_of("fx_px") < found[0].sigma_of("fx_px")
    assert (found[1].shape.sigmas[:4] < found[0].shape.sigmas[:4]).all()


def test_a_measured_board_that_is_stretched_after_all_is_still_found_out():
    measured = ShapePrior.of_a_print(board()).known(stretch=3e-4)
    seen = views(np.random.default_rng(3), stretched(board(), 0.005))
    options = replace(camera_options(1.0, measured), folds=0)
    found = calibrate_camera(seen, options)
    assert "stretch_y" in found.shape.found
    assert np.abs(in_sigmas(found)).max() < 3
