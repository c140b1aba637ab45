"""A new result beside the one before: the change on the work, and whether it is chance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from calibration.projection import CAMERA_NAMES, PinholeCamera, project
from calibration.wizard.comparison import (
    compare_cameras,
    compare_lens_tables,
    compare_rigid,
)
from mvp.calibrated import (
    AxisTable,
    CameraCalibration,
    LensTableCalibration,
    NamedCovariance,
    Provenance,
    Quality,
    RigidCalibration,
    ZoomTable,
)
from mvp.geometry import Pose

SIGMAS = np.array([0.9, 0.9, 0.4, 0.4, 2e-3, 0.0, 0.0, 0.0, 0.0])
CAMERA = PinholeCamera(2376.4, 2376.4, 806.0, 595.0, k1=-0.1)
EYE = Pose.from_rotvec("tool", "camera", [0.02, -0.03, 1.5], [10.0, 60.0, 90.0])
SIX = np.diag([0.05, 0.05, 0.08, 2e-4, 2e-4, 3e-4]) ** 2
GO = Quality(verdict="go")


def made(serial="S-1", origin="measured", date="2026-01-02"):
    return Provenance(date=date, device_serial=serial, method="test", origin=origin)


def camera_file(camera=CAMERA, spread=SIGMAS, **provenance):
    covariance = None
    if spread is not None:
        covariance = NamedCovariance(
            parameters=list(CAMERA_NAMES), matrix=np.diag(spread**2).tolist()
        )
    return CameraCalibration(
        schema="mvp-cell/camera/1",
        provenance=made(**provenance),
        quality=GO,
        width_px=1600,
        height_px=1200,
        pitch_x_um=5.5,
        pitch_y_um=5.5,
        centre_x_px=camera.cx_px,
        centre_y_px=camera.cy_px,
        k1=camera.k1,
        reference_fx_px=camera.fx_px,
        reference_fy_px=camera.fy_px,
        covariance=covariance,
    )


def shifted(rng, factor=1.0):
    values = CAMERA.values + factor * rng.normal(0, SIGMAS)
    return PinholeCamera.from_values(values)


def rigid_file(pose=EYE, covariance=SIX, d_mm=13.0, kind="hand-eye", **provenance):
    return RigidCalibration(
        schema=f"mvp-cell/{kind}/1",
        provenance=made(**provenance),
        quality=GO,
        target=pose.target,
        source=pose.source,
        matrix=pose.matrix.tolist(),
        covariance=None if covariance is None else covariance.tolist(),
        reference_d_mm=d_mm,
    )


def nudged(rng, factor=1.0):
    step = factor * rng.multivariate_normal(np.zeros(6), SIX)
    turn = Rotation.from_rotvec(step[3:]).as_matrix() @ EYE.rotation
    return Pose("tool", "camera", turn, EYE.translation_mm + step[:3])


def lens_file(f=1.0, x=0.0, a=1.0, e=2.4, approach="from_below", first=0, **provenance):
    steps = [first, first + 1000, first + 2000, first + 3000]

    def axis(values):
        return AxisTable(steps=steps, values_mm=values, approach=approach)

    return LensTableCalibration(
        schema="mvp-cell/lens-table/1",
        provenance=made(**provenance),
        quality=GO,
        zoom_f_mm=axis([8 * f, 12 * f, 18 * f, 25 * f]),
        focus_extension_mm=axis([0.1 + x, 0.4 + x, 0.8 + x, 1.2 + x]),
        iris_a_mm=axis([0.5 * a, 1 * a, 2 * a, 4 * a]),
        pupil_offset_mm=e,
        d_standard_deviation_mm=0.003,
        f_standard_deviation_mm=0.003,
        a_standard_deviation_mm=0.02,
        pupil_offset_standard_deviation_mm=0.05,
    )


def test_the_same_camera_twice_does_not_differ():
    found = compare_cameras(camera_file(), camera_file(), distance_mm=400.0)
    assert not found.alarm
    assert found.sigmas == 0
    assert all(one.change == 0 for one in found.differences)
    assert "agree" in found.words


def test_the_shift_of_a_camera_is_that_of_its_points():
    other = PinholeCamera(2380.0, 2380.0, 807.0, 594.0, k1=-0.1)
    found = compare_cameras(camera_file(), camera_file(other), distance_mm=400.0)
    corner = np.array([0.0, 0.0])
    x, y = (corner - [806, 595]) / 2376.4
    r2 = 0.0
    for _ in range(50):  # undistort the corner by iteration
        r2 = (x * x + y * y) if r2 == 0.0 else r2
        ideal = (corner - [806, 595]) / 2376.4 / (1 - 0.1 * r2)
        r2 = float((ideal**2).sum())
    point = np.array([[*ideal, 1.0]]) * 400
    apart = [project(c, np.eye(3), np.zeros(3), point)[0] for c in (CAMERA, other)]
    size = np.linalg.norm(apart[1] - apart[0])
    assert found.differences[1].unit == "px"
    assert found.differences[1].change >= size - 1e-6
    assert found.differences[0].change == pytest.approx(
        found.differences[1].change * 400 / 2380.0
    )
    assert found.alarm == (found.sigmas > 3)


@pytest.mark.parametrize("kind", ["camera", "hand-eye"])
def test_chance_gives_an_alarm_as_rarely_as_three_sigmas_should(kind):
    rng = np.random.default_rng(0)
    sigmas = []
    for _ in range(100):
        if kind == "camera":
            one, two = (camera_file(shifted(rng)) for _ in range(2))
            found = compare_cameras(one, two, distance_mm=400.0)
        else:
            one, two = (rigid_file(nudged(rng)) for _ in range(2))
            found = compare_rigid(one, two, at_source_mm=(0, 0, 400))
        sigmas.append(found.sigmas)
    sigmas = np.sort(sigmas)
    expected = norm.isf((1 - (np.arange(100) + 0.5) / 100) / 2)
    assert np.abs(sigmas - expected)[:90].max() < 0.35
    assert (sigmas > 3).sum() <= 3


def test_a_real_change_of_a_camera_is_an_alarm_in_mm():
    moved = replace(CAMERA, cx_px=CAMERA.cx_px + 9)
    found = compare_cameras(camera_file(), camera_file(moved), distance_mm=400.0)
    assert found.alarm
    assert found.differences[0].change == pytest.approx(9 * 400 / 2376.4, rel=0.02)
    assert found.differences[2].change < 0.2 * found.differences[0].change
    assert "something has changed since 2026-01-02" in found.words


def test_a_nominal_camera_is_told_as_such():
    moved = replace(CAMERA, cx_px=CAMERA.cx_px + 9)
    before = camera_file(serial="datasheet", origin="nominal")
    found = compare_cameras(before, camera_file(moved), distance_mm=400.0)
    assert found.alarm
    assert "data sheet" in found.words
    assert any("nominal" in remark for remark in found.remarks)


def test_without_a_covariance_nobody_can_tell():
    found = compare_cameras(camera_file(spread=None), camera_file(), distance_mm=400.0)
    assert found.sigmas is None
    assert not found.alarm
    assert "nobody can tell" in found.words


def test_another_lens_setting_is_asked_about():
    zoomed = PinholeCamera(2500.0, 2500.0, 806.0, 595.0, k1=-0.1)
    found = compare_cameras(camera_file(), camera_file(zoomed), distance_mm=400.0)
    assert any("same lens setting" in remark for remark in found.remarks)


def test_other_devices_and_sizes_are_not_compared():
    found = compare_cameras(camera_file(), camera_file(serial="S-2"), distance_mm=400.0)
    assert not found.differences
    assert "device S-1, not S-2" in found.words
    small = camera_file().model_copy(update={"width_px": 800})
    assert "size" in compare_cameras(small, camera_file(), distance_mm=400.0).words


def test_a_turn_of_the_hand_eye_shows_at_the_working_distance():
    turn = Rotation.from_rotvec(EYE.rotation @ [0.0, 5e-3, 0.0]).as_matrix()
    other = Pose("tool", "camera", turn @ EYE.rotation, EYE.translation_mm)
    found = compare_rigid(rigid_file(), rigid_file(other), at_source_mm=(0, 0, 400))
    assert found.differences[0].change == pytest.approx(2.0, rel=1e-3)
    assert found.differences[1].change == pytest.approx(0.0, abs=1e-9)
    assert found.differences[2].change == pytest.approx(np.degrees(5e-3), rel=1e-6)
    assert found.differences[2].sigmas > 10
    assert found.alarm


def test_the_pupil_is_taken_to_one_lens_setting_before_hand_eyes_are_compared():
    along = EYE.translation_mm + EYE.rotation @ [0, 0, 0.4]
    other = Pose("tool", "camera", EYE.rotation, along)
    found = compare_rigid(
        rigid_file(d_mm=13.0), rigid_file(other, d_mm=13.4), at_source_mm=(0, 0, 400)
    )
    assert found.differences[0].change == pytest.approx(0.0, abs=1e-9)


def test_a_part_that_stands_elsewhere_is_told_so():
    part = Pose.from_rotvec("base", "part", [0.1, 0, 0], [400.0, 0, 0])
    moved = Pose.from_rotvec("base", "part", [0.1, 0, 0], [403.0, 0, 0])
    before = rigid_file(part, kind="part-pose")
    found = compare_rigid(
        before, rigid_file(moved, kind="part-pose", serial="x"), at_source_mm=(0, 0, 0)
    )
    assert found.kind == "part"
    assert found.alarm
    assert "the part stands elsewhere" in found.words


def test_results_of_other_frames_are_a_misuse():
    part = Pose.from_rotvec("base", "part", [0.1, 0, 0], [400.0, 0, 0])
    with pytest.raises(ValueError, match="same two frames"):
        compare_rigid(rigid_file(), rigid_file(part), at_source_mm=(0, 0, 0))


@pytest.mark.parametrize(
    ("change", "name"), [({"f": 1.002}, "f,"), ({"x": 0.02}, "d,"), ({"a": 1.1}, "a,"),
                         ({"e": 2.8}, "pupil offset")],
)  # fmt: skip
def test_what_changed_in_a_lens_is_found(change, name):
    found = compare_lens_tables(
        lens_file(), lens_file(**change), distance_mm=400.0, half_field_mm=100.0
    )
    assert found.alarm
    worst = max(found.differences[2:], key=lambda one: one.sigmas)
    assert worst.name.startswith(name)


def test_the_same_lens_has_no_alarm_and_a_shift_on_the_work():
    same = compare_lens_tables(
        lens_file(), lens_file(), distance_mm=400.0, half_field_mm=100.0
    )
    assert not same.alarm
    longer = compare_lens_tables(
        lens_file(), lens_file(f=1.001), distance_mm=400.0, half_field_mm=100.0
    )
    assert longer.differences[0].change == pytest.approx(0.1, rel=0.05)
    assert longer.differences[0].unit == "mm"


def with_zoom(file, **values):
    """The same table with what the zoom changes, at its first and last zoom."""
    table = ZoomTable(
        steps=[0, 3000],
        standard_deviation=dict.fromkeys(values, 0.05),
        **values,
    )
    return file.model_copy(update={"by_zoom": table})


def test_a_pupil_offset_that_follows_the_zoom_is_compared_by_zoom():
    steady = with_zoom(lens_file(), pupil_offset_mm=[2.4, 2.4])
    same = compare_lens_tables(
        lens_file(), steady, distance_mm=400.0, half_field_mm=100.0
    )
    assert not same.alarm
    assert same.differences[-1].change == pytest.approx(0.0)
    tilted = with_zoom(lens_file(), pupil_offset_mm=[2.4, 3.0])
    other = compare_lens_tables(steady, tilted, distance_mm=400.0, half_field_mm=100.0)
    assert other.alarm
    assert other.differences[-1].name == "pupil offset e, worst at zoom 3000"
    assert other.differences[-1].change == pytest.approx(0.6)
    assert other.differences[-1].sigma == pytest.approx(np.hypot(0.05, 0.05))


def test_a_shift_of_the_focus_by_the_zoom_is_a_change_of_d():
    shifted = with_zoom(lens_file(), focus_shift_mm=[0.0, -0.02])
    found = compare_lens_tables(
        lens_file(), shifted, distance_mm=400.0, half_field_mm=100.0
    )
    d = found.differences[3]
    assert d.name.startswith("d, worst at step")
    assert d.name.endswith("of zoom 3000")
    assert d.change == pytest.approx(-0.02)
    assert found.alarm


def test_tables_of_another_side_or_range_are_not_compared():
    sides = compare_lens_tables(
        lens_file(), lens_file(approach="from_above"), distance_mm=400, half_field_mm=90
    )
    assert "approached from_below, now from_above" in sides.words
    apart = compare_lens_tables(
        lens_file(), lens_file(first=9000), distance_mm=400.0, half_field_mm=100.0
    )
    assert "no steps in common" in apart.words
