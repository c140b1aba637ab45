"""Tsai's method on seeded scenes, on Willson's data, and at its limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibration.observations import Observations
from calibration.projection import moved_pose, project
from calibration.tsai import (
    Sampling,
    TsaiCamera,
    TsaiOptions,
    pinhole_from_tsai,
    tsai_calibrate,
    tsai_from_pinhole,
    two_stage,
)
from mvp.errors import CalibrationError

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "tsai_3.0b3"
A = TsaiCamera(0.0055, 0.0055, 13.07, 799.5, 599.5, 1.0, 2e-3)
A_SIZE = (1600, 1200)
B = TsaiCamera(0.01625, 0.0135, 13.07, 255.5, 239.5, 1.0, 2e-3)
B_SIZE = (512, 480)


def target(camera, size_px, distance_mm, *, depth_mm=0.0, planes=1, fill=0.8):
    """12 x 9 points that fill part of the short side, on planes one behind another."""
    side = fill * min(size_px[0] * camera.pitch_x_mm, size_px[1] * camera.pitch_y_mm)
    square = side * distance_mm / camera.f_mm / 8
    flat = (np.mgrid[0:12, 0:9].T.reshape(-1, 2) - [5.5, 4]) * square
    levels = (np.arange(planes) - (planes - 1) / 2) * depth_mm
    return np.concatenate(
        [np.column_stack([flat, np.full(len(flat), z)]) for z in levels]
    )


def one_view(camera, size_px, points, rng, *, tilt_deg, distance_mm, sigma_px=0.1):
    about = rng.uniform(0, 2 * np.pi)
    axis = np.array([np.cos(about), np.sin(about), 0.0])
    rotation = (
        Rotation.from_rotvec(np.radians(tilt_deg) * axis)
        * Rotation.from_rotvec([0, 0, rng.uniform(-0.5, 0.5)])
    ).as_matrix()
    shift = np.array([*rng.uniform(-8, 8, 2), distance_mm])
    pixels = camera.project(rotation, shift, points)
    pixels = pixels + rng.normal(0, 1, pixels.shape) * sigma_px
    return Observations.from_views([points], [pixels], size_px=size_px), rotation, shift


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def robust_sigma(values):
    return float(1.4826 * np.median(np.abs(values)))


def trials(camera, size_px, distance_mm, count, *, tilt_deg, stage, size=rms, **layout):
    """Errors: f and k1 relative, rotation deg, Tz relative, sx."""
    points = target(camera, size_px, distance_mm, **layout)
    rows = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        seen, rotation, shift = one_view(
            camera, size_px, points, rng, tilt_deg=tilt_deg, distance_mm=distance_mm
        )
        if stage == "full":
            full = tsai_calibrate(camera, seen, TsaiOptions(sigma_px=0.1))
            found, turned = full.camera, full.state.rotation[0]
            moved = full.state.translation_mm[0]
        else:
            two = two_stage(camera, *seen.of_view(0))
            found, turned, moved = two.camera, two.rotation, two.translation_mm
        between = Rotation.from_matrix(turned @ rotation.T).magnitude()
        rows.append(
            [
                found.f_mm / camera.f_mm - 1,
                found.k1_per_mm2 / camera.k1_per_mm2 - 1,
                np.degrees(between),
                (moved[2] - shift[2]) / distance_mm,
                found.sx - camera.sx,
            ]
        )
    return [size(column) for column in np.array(rows).T]


def check_flat(count, stage):
    f, k1, turn, depth, _ = trials(A, A_SIZE, 500.0, count, tilt_deg=30, stage=stage)
    assert f <= 0.0008
    assert k1 <= 0.006
    assert turn <= 0.03
    assert depth <= 0.0008


def check_deep(count, stage):
    f, _, turn, _, sx = trials(
        A, A_SIZE, 500.0, count, tilt_deg=30, stage=stage, depth_mm=60.0, planes=3
    )
    assert f <= 0.0005
    assert turn <= 0.015
    assert sx <= 1.5e-4


@pytest.mark.parametrize("stage", ["two", "full"])
def test_a_flat_target_tilted_by_30_deg_gives_the_camera(stage):
    check_flat(6, stage)


@pytest.mark.parametrize("stage", ["two", "full"])
def test_planes_in_depth_give_the_camera_and_its_scale(stage):
    check_deep(6, stage)


@pytest.mark.full
@pytest.mark.parametrize("stage", ["two", "full"])
def test_thirty_trials_keep_the_same_limits(stage):
    check_flat(30, stage)
    check_deep(30, stage)


@pytest.mark.full
@pytest.mark.parametrize(
    ("tilt_deg", "stage", "limit"),
    [
        (10, "two", 0.0019),
        (10, "full", 0.0013),
        (20, "full", 0.00048),
        (45, "two", 0.00034),
        (45, "full", 0.00025),
    ],
)
def test_camera_a_reaches_the_table_of_tilts(tilt_deg, stage, limit):
    found = trials(
        A, A_SIZE, 500.0, 60, tilt_deg=tilt_deg, stage=stage, size=robust_sigma
    )
    assert found[0] <= 1.4 * limit


@pytest.mark.full
@pytest.mark.parametrize(
    ("tilt_deg", "stage", "limit"),
    [(10, "two", 0.0053), (30, "two", 0.0014), (30, "full", 0.00077)],
)
def test_the_camera_of_the_paper_reaches_its_table(tilt_deg, stage, limit):
    found = trials(
        B, B_SIZE, 300.0, 60, tilt_deg=tilt_deg, stage=stage, size=robust_sigma
    )
    assert found[0] <= 1.4 * limit


@pytest.mark.parametrize("planes", [1, 3])
@pytest.mark.parametrize("k1", [0.0, 2e-3, -2e-3])
def test_perfect_pictures_give_the_exact_camera(planes, k1):
    camera = A.with_values(A.values * [1, 1, 1, 1, 0] + [0, 0, 0, 0, k1])
    points = target(camera, A_SIZE, 500.0, planes=planes, depth_mm=40.0)
    rng = np.random.default_rng(1)
    seen, rotation, shift = one_view(
        camera, A_SIZE, points, rng, tilt_deg=25, distance_mm=500.0, sigma_px=0.0
    )
    two = two_stage(camera, *seen.of_view(0))
    full = tsai_calibrate(camera, seen, TsaiOptions(sigma_px=0.1))
    for found in (two.camera, full.camera):
        assert found.f_mm == pytest.approx(camera.f_mm, rel=1e-6)
        assert found.k1_per_mm2 == pytest.approx(k1, abs=1e-8)
    np.testing.assert_allclose(full.state.rotation[0], rotation, atol=1e-8)
    np.testing.assert_allclose(full.state.translation_mm[0], shift, atol=1e-5)


def test_stated_sigmas_cover_the_errors():
    points = target(A, A_SIZE, 500.0)
    scaled = []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        seen, *_ = one_view(A, A_SIZE, points, rng, tilt_deg=30, distance_mm=500.0)
        found = tsai_calibrate(A, seen, TsaiOptions(sigma_px=0.1))
        error = found.camera.values - A.values
        scaled.append(
            [
                error[0] / found.estimate.sigma_of("f_mm"),
                error[4] / found.estimate.sigma_of("k1_per_mm2"),
            ]
        )
    assert rms(scaled) < 1.15 + 2 / np.sqrt(2 * 15)
    assert 0.45 < np.mean(np.abs(scaled) < 1) < 0.9


@pytest.mark.parametrize(
    ("tilt_deg", "grade"), [(2, "no-go"), (7, "no-go"), (15, "marginal"), (30, "go")]
)
def test_tilt_decides_while_the_residual_stays_perfect(tilt_deg, grade):
    rng = np.random.default_rng(4)
    points = target(A, A_SIZE, 500.0)
    seen, *_ = one_view(A, A_SIZE, points, rng, tilt_deg=tilt_deg, distance_mm=500.0)
    found = tsai_calibrate(A, seen, TsaiOptions(sigma_px=0.1))
    assert found.rms_px < 0.17
    assert found.verdict.grade == grade
    if grade != "go":
        assert "target nearly parallel to sensor" in " ".join(found.verdict.reasons)


def test_a_scale_of_the_sampling_is_found_from_planes_in_depth():
    camera = A.with_values(A.values * [1, 1, 1, 0.98, 1])
    rng = np.random.default_rng(6)
    points = target(camera, A_SIZE, 500.0, depth_mm=60.0, planes=3)
    seen, *_ = one_view(camera, A_SIZE, points, rng, tilt_deg=30, distance_mm=500.0)
    assert tsai_calibrate(A, seen).camera.sx == pytest.approx(0.98, abs=2e-4)


def test_several_views_share_one_camera():
    rng = np.random.default_rng(7)
    points = target(A, A_SIZE, 500.0)
    views = [
        one_view(A, A_SIZE, points, rng, tilt_deg=30, distance_mm=500.0)[0]
        for _ in range(4)
    ]
    seen = Observations.from_views(
        [points] * 4, [view.pixels for view in views], size_px=A_SIZE
    )
    options = TsaiOptions(free_centre=True, sigma_px=0.1)
    found = tsai_calibrate(A, seen, options)
    assert found.camera.f_mm == pytest.approx(13.07, rel=4e-4)
    assert (found.camera.cx_px, found.camera.cy_px) == pytest.approx(
        (799.5, 599.5), abs=1.5
    )


def turned_views(camera, tilts, rng, sigma_px=0.1):
    """Flat views tilted about the given axes (deg about x, y and z of the camera)."""
    points = target(camera, A_SIZE, 500.0)
    pixels = [
        camera.project(
            Rotation.from_euler("xyz", tilt, degrees=True).as_matrix(),
            np.array([3.0, -4.0, 500.0]),
            points,
        )
        for tilt in tilts
    ]
    noisy = [found + rng.normal(0, sigma_px, found.shape) for found in pixels]
    return Observations.from_views([points] * len(tilts), noisy, size_px=A_SIZE)


DIFFERENT = [(35, 0, 10), (0, 35, -20), (-30, 20, 60), (25, 30, 0)]


@pytest.mark.parametrize("sx", [0.98, 1.0617])
def test_several_flat_views_tell_the_scale_of_the_sampling(sx):
    camera = A.with_values(A.values * [1, 1, 1, sx, 1])
    scaled = []
    for seed in range(5):
        seen = turned_views(camera, DIFFERENT, np.random.default_rng(seed))
        found = tsai_calibrate(A, seen, TsaiOptions(sigma_px=0.1))
        assert "sx" in found.free
        assert found.camera.sx == pytest.approx(sx, abs=4e-4)
        assert found.camera.f_mm == pytest.approx(A.f_mm, rel=1e-3)
        scaled.append((found.camera.sx - sx) / found.estimate.sigma_of("sx"))
    assert rms(scaled) < 2


def test_one_flat_view_keeps_the_scale_and_says_so():
    camera = A.with_values(A.values * [1, 1, 1, 1.0617, 1])
    seen = turned_views(camera, [(35, 5, 10)], np.random.default_rng(2))
    found = tsai_calibrate(camera, seen, TsaiOptions(sigma_px=0.1))
    assert found.camera.sx == 1.0617
    assert "sx" not in found.free
    assert found.verdict.grade == "go"
    assert "kept at 1.0617" in " ".join(found.verdict.reasons)
    with pytest.raises(CalibrationError, match="does not tell sx") as refused:
        tsai_calibrate(camera, seen, TsaiOptions(scale="free"))
    assert "clocks" in refused.value.hint


def test_flat_views_from_one_side_do_not_tell_the_scale():
    seen = turned_views(A, [(30, 0, 0), (31, 0, 0)], np.random.default_rng(3), 0.5)
    found = tsai_calibrate(A, seen, TsaiOptions(sigma_px=0.5))
    assert found.camera.sx == 1.0
    assert "scale-kept" in found.verdict.codes()
    with pytest.raises(CalibrationError, match="tell sx"):
        tsai_calibrate(A, seen, TsaiOptions(scale="free", sigma_px=0.5))


ONE_SIDE = [(30, 0, 0), (25, 5, 0)]


def test_a_scale_that_the_views_contradict_is_not_kept():
    camera = A.with_values(A.values * [1, 1, 1, 1.005, 1])
    scaled = []
    for seed in range(6):
        seen = turned_views(camera, ONE_SIDE, np.random.default_rng(seed), 0.3)
        found = tsai_calibrate(A, seen, TsaiOptions(sigma_px=0.3))
        assert "sx" in found.free
        assert "scale-contradicted" in found.verdict.codes()
        assert "tell it only to 0.05" in " ".join(found.verdict.reasons)
        off = found.camera.values - camera.values
        scaled.append(
            [
                off[0] / found.estimate.sigma_of("f_mm"),
                off[3] / found.estimate.sigma_of("sx"),
            ]
        )
    assert rms(scaled) < 1.7


def test_a_contradicting_scale_that_is_coarse_is_marginal_by_itself():
    camera = A.with_values(A.values * [1, 1, 1, 1.0617, 1])
    tilts = [(30, 0, 0), (31, 0, 0)]
    seen = turned_views(camera, tilts, np.random.default_rng(3), 0.5)
    found = tsai_calibrate(A, seen, TsaiOptions(sigma_px=0.5))
    causes = {cause.code: cause for cause in found.verdict.causes}
    assert causes["scale-contradicted"].grade == "marginal"
    assert found.verdict.grade == "no-go"


def test_a_scale_that_is_kept_leaves_its_doubt_in_f():
    seen = turned_views(A, ONE_SIDE, np.random.default_rng(1), 0.3)
    kept, held = (
        tsai_calibrate(A, seen, TsaiOptions(scale=scale, sigma_px=0.3))
        for scale in ("where-seen", "held")
    )
    free = tsai_calibrate(A, seen, TsaiOptions(scale="free", sigma_px=0.3))
    assert kept.camera == held.camera
    assert "counts in the doubt of f" in " ".join(kept.verdict.reasons)
    doubt = [one.estimate.sigma_of("f_mm") for one in (kept, free, held)]
    assert doubt[0] == pytest.approx(doubt[1], rel=0.02)
    assert doubt[0] > 2 * doubt[2]


def test_a_scale_that_is_held_stays_also_in_depth():
    points = target(A, A_SIZE, 500.0, depth_mm=60.0, planes=3)
    rng = np.random.default_rng(6)
    seen, *_ = one_view(A, A_SIZE, points, rng, tilt_deg=30, distance_mm=500.0)
    found = tsai_calibrate(A, seen, TsaiOptions(scale="held", sigma_px=0.1))
    assert found.camera.sx == 1.0
    assert "as asked" in " ".join(found.verdict.reasons)


JAVELIN = Sampling(0.023, 0.0135, elements=384, samples=512)


def test_the_sampling_of_the_paper_gives_its_numbers():
    assert JAVELIN.pitch_x_mm == pytest.approx(0.01725)
    # The paper states the ratio of the two spacings, which is that of the two clocks.
    sx = JAVELIN.scale_of_clocks(0.70642, 1.0)
    assert sx == pytest.approx(1.0617, abs=5e-5)
    assert JAVELIN.spacing_mm(sx) == pytest.approx(0.023 * 0.70642)
    assert 1000 * JAVELIN.diagonal_mm(sx) == pytest.approx(21.124, abs=5e-4)
    assert JAVELIN.camera((255.5, 239.5), sx=sx).on_sensor(
        np.array([256.5, 240.5])
    ) == pytest.approx([0.023 * 0.70642, 0.0135])


def test_the_sampling_of_willsons_data_gives_his_pitch():
    for name in ("cc", "ncc"):
        willson(name)
        ncx, nfx, dx, dy, dpx, dpy = np.loadtxt(DATA / f"{name}_cpcc.dat")[:6]
        sampling = Sampling(dx, dy, int(ncx), int(nfx))
        assert (sampling.pitch_x_mm, sampling.element_y_mm) == (dpx, dpy)
        assert sampling.camera((262.0, 212.0)) == SAMPLED


@pytest.mark.parametrize("wrong", [(0.0, 1.0, 3, 3), (1.0, 1.0, 0, 3)])
def test_a_sampling_without_elements_is_refused(wrong):
    with pytest.raises(ValueError, match=r"positive|one element"):
        Sampling(*wrong)


def test_what_is_known_of_the_centre_holds_a_weak_view():
    points = target(A, A_SIZE, 500.0, fill=0.3)
    free = TsaiOptions(free_centre=True, sigma_px=0.1)
    scaled, errors = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        seen, *_ = one_view(A, A_SIZE, points, rng, tilt_deg=30, distance_mm=500.0)
        told = [
            ("cx_px", 799.5 + rng.normal(), 1.0),
            ("cy_px", 599.5 + rng.normal(), 1.0),
        ]
        known = TsaiOptions(True, sigma_px=0.1, priors=tuple(told))
        weak, held = (tsai_calibrate(A, seen, how) for how in (free, known))
        names = ("f_mm", "cx_px", "cy_px")
        sigmas = [
            [one.estimate.sigma_of(name) for name in names] for one in (weak, held)
        ]
        assert min(sigmas[0][1:]) > 5
        assert max(sigmas[1][1:]) <= 1.0
        assert sigmas[1][0] < sigmas[0][0]
        off = held.camera.values[:3] - A.values[:3]
        scaled.append(off / sigmas[1])
        errors.append([abs(one.camera.cx_px - 799.5) for one in (weak, held)])
    assert rms(scaled) < 1.35
    assert np.mean(errors, axis=0)[1] < 0.3 * np.mean(errors, axis=0)[0]


def test_a_prior_on_a_number_that_is_none_of_the_cameras_is_refused():
    seen = turned_views(A, [(35, 5, 10)], np.random.default_rng(2))
    with pytest.raises(ValueError, match="focal"):
        tsai_calibrate(A, seen, TsaiOptions(priors=(("focal", 1.0, 1.0),)))


def test_a_target_whose_origin_is_on_the_optical_axis_is_no_trap():
    points = target(A, A_SIZE, 500.0)
    rotation = Rotation.from_rotvec([0.5, 0, 0]).as_matrix()
    pixels = A.project(rotation, np.array([0, 0, 500.0]), points)
    found = two_stage(A, points, pixels)
    assert found.camera.f_mm == pytest.approx(13.07, rel=1e-6)
    np.testing.assert_allclose(found.translation_mm, [0, 0, 500], atol=1e-4)


def test_a_mirrored_target_in_depth_is_refused():
    rng = np.random.default_rng(8)
    points = target(A, A_SIZE, 500.0, depth_mm=60.0, planes=3)
    seen, *_ = one_view(A, A_SIZE, points, rng, tilt_deg=20, distance_mm=500.0)
    with pytest.raises(CalibrationError) as refused:
        two_stage(A, points * [-1, 1, 1], seen.pixels)
    assert "mirrored" in refused.value.hint


@pytest.mark.parametrize("points", [4, 12])
def test_too_few_points_or_points_on_a_line_are_refused(points):
    line = np.column_stack(
        [np.arange(points) * 9.0, np.zeros(points), np.zeros(points)]
    )
    pixels = np.column_stack([100.0 + 40 * np.arange(points), 300 + np.zeros(points)])
    with pytest.raises(CalibrationError):
        two_stage(A, line, pixels)


def willson(name):
    if not DATA.is_dir():
        pytest.skip("Willson's Tsai data are not here")
    rows = np.loadtxt(DATA / f"{name}_cd.dat")
    numbers = np.loadtxt(DATA / f"{name}_cpcc.dat")
    seen = Observations.from_views([rows[:, :3]], [rows[:, 3:]], size_px=(576, 432))
    return seen, dict(
        zip(
            "cx cy sx f k1 tx ty tz rx ry rz".split(),
            numbers[6:17].tolist(),
            strict=True,
        )
    )


def angles_deg(rotation):
    return Rotation.from_matrix(rotation).as_euler("xyz", degrees=True)


SAMPLED = TsaiCamera(0.023, 0.023, 1.0, 262.0, 212.0)


def test_willsons_flat_data_give_his_answer():
    seen, his = willson("cc")
    found = tsai_calibrate(SAMPLED, seen, TsaiOptions(free_centre=True))
    shift = found.state.translation_mm[0]
    assert found.camera.f_mm / shift[2] == pytest.approx(his["f"] / his["tz"], rel=1e-4)
    assert found.camera.k1_per_mm2 == pytest.approx(his["k1"], rel=0.02)
    assert shift[:2] == pytest.approx([his["tx"], his["ty"]], abs=0.3)
    turn = np.degrees([his["rx"], his["ry"], his["rz"]])
    np.testing.assert_allclose(angles_deg(found.state.rotation[0]), turn, atol=0.05)
    assert found.rms_px <= 0.12
    assert found.verdict.grade == "no-go"
    assert "focal length" in found.verdict.reasons[0]
    assert "tz_mm" in found.estimate.weakest.words


def test_willsons_data_in_depth_give_his_answer():
    seen, his = willson("ncc")
    found = tsai_calibrate(SAMPLED, seen, TsaiOptions(free_centre=True))
    assert found.camera.f_mm == pytest.approx(his["f"], abs=0.35)
    assert found.camera.k1_per_mm2 == pytest.approx(his["k1"], rel=0.02)
    assert found.camera.sx == pytest.approx(his["sx"], abs=3e-5)
    shift = found.state.translation_mm[0]
    assert shift[:2] == pytest.approx([his["tx"], his["ty"]], abs=0.3)
    assert shift[2] == pytest.approx(his["tz"], abs=7)
    turn = np.degrees([his["rx"], his["ry"], his["rz"]])
    np.testing.assert_allclose(angles_deg(found.state.rotation[0]), turn, atol=0.05)
    assert found.rms_px <= 0.09


def test_willsons_centre_moved_by_some_pixels_moves_f_as_it_should():
    seen, _ = willson("ncc")
    right = two_stage(SAMPLED, *seen.of_view(0)).camera.f_mm
    wrong = TsaiCamera(0.023, 0.023, 1.0, 258.0, 204.0)
    moved = two_stage(wrong, *seen.of_view(0)).camera.f_mm
    assert right == pytest.approx(69.655, abs=0.05)
    assert abs(moved - right) == pytest.approx(1.6, abs=0.3)


def test_derivatives_agree_with_finite_differences():
    rotation = Rotation.from_rotvec([0.4, 0.2, 1.0]).as_matrix()
    shift = np.array([5.0, -3.0, 400.0])
    points = np.random.default_rng(2).uniform(-80, 80, (20, 3))
    found = A.project_with_derivatives(rotation, shift, points)
    for index, size in enumerate([1e-4, 1e-3, 1e-3, 1e-6, 1e-7]):
        step = np.zeros(5)
        step[index] = size
        ahead = A.with_values(A.values + step).project(rotation, shift, points)
        behind = A.with_values(A.values - step).project(rotation, shift, points)
        slope = (ahead - behind) / (2 * size)
        np.testing.assert_allclose(
            found.d_camera[..., index],
            slope,
            rtol=1e-6,
            atol=1e-6 * np.abs(slope).max(),
        )
    for index, size in enumerate([1e-3] * 3 + [1e-6] * 3):
        step = np.zeros(6)
        step[index] = size
        ahead = A.project(*moved_pose(rotation, shift, step), points)
        behind = A.project(*moved_pose(rotation, shift, -step), points)
        slope = (ahead - behind) / (2 * size)
        np.testing.assert_allclose(
            found.d_pose[..., index], slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max()
        )


@given(st.floats(-8e-3, 2e-2), st.floats(0, 5.4), st.floats(0, 6.28))
@settings(max_examples=60, deadline=None)
def test_distortion_is_undone(k1, radius, angle):
    camera = A.with_values(np.array([13.07, 800, 600, 1, k1]))
    point = radius * np.array([np.cos(angle), np.sin(angle)])
    inside = radius < 0.99 * camera.fold_mm
    there, seen = camera.distort(camera.undistort(point))
    if inside:
        assert seen
        np.testing.assert_allclose(there, point, atol=1e-9)


def test_a_point_beyond_the_fold_is_flagged_and_kept_on_it():
    camera = A.with_values(np.array([13.07, 800, 600, 1, -0.01]))
    there, seen = camera.distort(np.array([[9.0, 0.0]]))
    assert not seen[0]
    assert there[0] == pytest.approx([camera.fold_mm, 0])


@pytest.mark.parametrize("k1", [2e-3, -2e-3])
def test_conversion_to_opencv_and_back_keeps_the_picture(k1):
    camera = A.with_values(np.array([13.07, 790.0, 610.0, 1.01, k1]))
    there, error = pinhole_from_tsai(camera, A_SIZE)
    assert error.worst_px < 0.05
    assert there.k1 == pytest.approx(-k1 * 13.07**2, rel=0.05)
    points = np.array([[40.0, -60, 0], [0, 0, 0], [100, 80, 5]])
    pose = (np.eye(3), np.array([0, 0, 500.0]))
    np.testing.assert_allclose(
        project(there, *pose, points), camera.project(*pose, points), atol=0.05
    )
    back, error = tsai_from_pinhole(there, A_SIZE, (0.0055, 0.0055))
    assert error.worst_px < 0.1
    np.testing.assert_allclose(back.values, camera.values, rtol=2e-3)
