"""Visibility, workspace and lens range: bounds that do not depend on the features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mvp.constraints import (
    FieldOfViewCircle,
    FieldOfViewRectangle,
    FocusFar,
    LensRange,
    Resolution,
    Uncertainty,
    Visibility,
    Workspace,
    half_extents_mm,
    margin_report,
    rows_index,
    sigma_index,
)
from mvp.geometry import Box, Pose
from mvp.optics import Intrinsics, LensTable, MotorAxis, Sensor, Views


@dataclass(frozen=True)
class Near:
    distance: np.ndarray
    direction: np.ndarray


@dataclass(frozen=True)
class HalfSpace:
    """Everything above z = 0; one facet, or none at all."""

    facets: int = 1

    def signed_distance(self, points):
        return points[:, 2]

    def signed_distance_gradient(self, points):
        return points[:, 2], np.tile([0.0, 0, 1], (len(points), 1))

    def nearest_facets(self, points, k):
        count = min(k, self.facets)
        direction = np.sign(points[:, 2])[:, None, None] * np.array([0.0, 0, 1])
        return Near(
            np.tile(np.abs(points[:, 2:]), (1, count)),
            np.tile(direction, (1, count, 1)),
        )


def views_at(positions, d=13.0, f=12.5, a=0.8, e=0.0):
    positions = np.atleast_2d(np.asarray(positions, float))
    rotation = np.tile(np.diag([1.0, -1, -1]), (len(positions), 1, 1))
    return Views(rotation, positions, d, f, a, e)


def lens_table(tube_mm=0.0):
    return LensTable(
        MotorAxis("zoom", np.array([0, 1000]), np.array([8.0, 16.0])),
        MotorAxis("focus", np.array([0, 500, 2000]), np.array([1.2, 0.9, 0.1])),
        MotorAxis("iris", np.array([0, 100]), np.array([4.0, 0.5])),
        1.5,
        tube_mm,
    )


def test_missing_facets_are_far_away_and_do_not_pull():
    visibility = Visibility(HalfSpace(), facets=3)
    rows = visibility.rows(views_at([0, 0, 40]))
    assert rows.value[0, 0] == 40
    assert (rows.value[0, 1:] >= 1e6).all()
    assert (rows.gradient[0, 1:] == 0).all()


def test_outside_the_region_every_row_is_the_signed_distance():
    visibility = Visibility(HalfSpace(), facets=3)
    rows = visibility.rows(views_at([[0, 0, -7], [0, 0, 3]]))
    assert (rows.value[0] == -7).all()
    assert (rows.gradient[0, :, 2] == 1).all()
    assert visibility.report(views_at([0, 0, -7])).value[0] == -7


def test_a_region_without_facets_leaves_finite_margins():
    visibility = Visibility(HalfSpace(facets=0), facets=2)
    rows = visibility.rows(views_at([0, 0, 5]))
    index = rows_index(rows, Uncertainty().sigma)
    assert np.isfinite(rows.value).all()
    assert (index == 1e6).all()


def test_visibility_asks_for_at_least_one_facet():
    with pytest.raises(ValueError, match="at least one"):
        Visibility(HalfSpace(), facets=0)


def test_the_workspace_counts_distances_in_its_own_frame():
    base_from_part = Pose.from_rotvec("base", "part", [0, 0, np.pi / 2], [100, 0, 0])
    workspace = Workspace(Box(np.zeros(3), np.array([200.0, 50, 80])), base_from_part)
    report = workspace.report(views_at([20, -90, 30]))
    # part (20, -90, 30) is base (190, 20, 30)
    assert report.value[0] == pytest.approx(10)
    assert report.label() == "wall x high"
    assert workspace.report(views_at([20, -110, 30])).value[0] == pytest.approx(-10)


def test_the_lens_range_is_reported_in_motor_steps():
    lens = LensRange.within(table=lens_table())
    # x = d - f = 0.9 is step 500 of 0 .. 2000, f = 12 the middle, a half way
    report = lens.report(views_at([0, 0, 1], d=12.9, f=12.0, a=2.25))
    assert report.unit == "steps"
    assert report.value[0] == pytest.approx(50)
    focus_only = LensRange.within(table=lens_table(), axes=["focus"])
    assert focus_only.report(views_at([0, 0, 1], d=12.9, f=12.0)).value[
        0
    ] == pytest.approx(500)


def test_steps_left_are_negative_out_of_range_and_agree_with_the_rows():
    lens = LensRange.within(table=lens_table(), axes=["focus"])
    for d in (11.9, 12.05, 12.5, 13.15, 13.3):
        view = views_at([0, 0, 1], d=d, f=12.0)
        left = lens.report(view).value[0]
        assert np.sign(left) == np.sign(lens.rows(view).value.min())


def test_a_tube_moves_the_range_of_d():
    bare, tube = (
        LensRange.within(table=lens_table(t), axes=["focus"]) for t in (0, 1.0)
    )
    near = views_at([0, 0, 1], d=13.9, f=12.0)
    assert bare.report(near).value[0] < 0
    assert tube.report(near).value[0] == pytest.approx(500)


def test_the_tasks_own_bounds_count_beside_those_of_the_lens():
    lens = LensRange.within(table=lens_table(), axes=["focus"], d_mm=(12.2, 12.95))
    report = lens.report(views_at([0, 0, 1], d=12.9, f=12.0))
    assert report.label() == "d <= 12.95 mm"
    assert 0 < report.value[0] < 100


def test_without_a_table_the_lens_range_is_reported_in_mm():
    lens = LensRange.within(d_mm=(12.6, 13.7), f_mm=(12, 13), a_mm=(0.7, 0.9))
    report = margin_report(lens, views_at([0, 0, 1], d=13.65))
    assert report.unit == "mm"
    assert report.value[0] == pytest.approx(0.05)
    assert report.label() == "d <= 13.7 mm"


def test_a_lens_range_without_bounds_is_refused():
    with pytest.raises(ValueError, match="at least one bound"):
        LensRange.within()


def test_far_focus_beyond_the_hyperfocal_setting_is_unbounded():
    far = FocusFar(np.array([[0.0, 0, 0]]), 0.0135)
    views = views_at([[0, 0, 900], [0, 0, 900]], d=[12.70, 12.80], a=0.78125)
    report = far.report(views)
    assert list(report.unbounded) == [True, False]
    assert np.isposinf(report.value[0])
    assert np.isfinite(report.value[1])
    assert np.isfinite(far.rows(views).value).all()


def test_the_field_of_view_follows_an_off_centre_principal_point_and_a_guard_band():
    sensor = Sensor(101, 81, 0.01, 0.02)
    extents = half_extents_mm(Intrinsics(sensor, 40.0, 50.0), guard_px=5)
    assert extents == pytest.approx([0.35, 0.55, 0.90, 0.50])
    circle = FieldOfViewCircle.for_sensor(
        np.zeros(3), 1.0, Intrinsics(sensor, 40.0, 50.0), guard_px=5
    )
    assert circle.image_radius_mm == pytest.approx(0.35)


def test_points_at_the_border_pixels_have_no_margin():
    sensor = Sensor(101, 81, 0.01, 0.02)
    intrinsics = Intrinsics(sensor, 40.0, 50.0)
    view = views_at([0, 0, 500], d=13.0, e=2.4)
    corners = np.array([[0.0, 0.0], [100, 80], [0, 80], [100, 0]])
    normalised = intrinsics.to_normalised(corners, float(view.f_cal_mm[0]))
    in_camera = np.column_stack([normalised * 300, np.full(4, 300.0)])
    points = view.part_from_camera().apply(in_camera)
    rectangle = FieldOfViewRectangle.for_sensor(points, intrinsics)
    value = rectangle.rows(view).value.reshape(4, 4)
    assert value.min() == pytest.approx(0, abs=1e-9)
    assert (np.sort(np.abs(value), axis=1)[:, :2] < 1e-9).all()
    assert rectangle.labels[1] == "point 1, right"


@pytest.mark.parametrize("k1", [-0.25, 0.2])
def test_what_lies_in_the_extents_falls_on_a_distorting_sensor(k1):
    sensor = Sensor(1280, 1024, 0.0053, 0.0053)
    lens = Intrinsics(sensor, 650.0, 500.0, k1=k1, p1=0.002)
    left, right, top, bottom = half_extents_mm(lens, guard_px=3, f_cal_mm=12.5)
    rng = np.random.default_rng(1)
    inside = rng.uniform([-left, -top], [right, bottom], (20_000, 2))
    corners = np.array([[-left, -top], [right, -top], [-left, bottom], [right, bottom]])
    pixels = lens.to_pixels(np.vstack([inside, corners]) / 12.5, 12.5)
    assert (pixels >= 3 - 0.01).all()
    assert (pixels <= np.array([1279, 1023]) - 3 + 0.01).all()
    plain = half_extents_mm(lens, guard_px=3)
    assert np.sign(plain - [left, right, top, bottom]).tolist() == [np.sign(k1)] * 4


def test_degrees_of_field_of_view_are_how_far_the_camera_may_turn():
    circle = FieldOfViewCircle(np.array([5.0, -3, 2]), 20.0, 3.2)
    view = views_at([0, 0, 300])
    slack = np.deg2rad(circle.report(view).value[0])
    centre = view.camera_points(circle.centre_mm[None])[0, 0]
    axis = np.array([centre[1], -centre[0], 0]) / np.hypot(centre[0], centre[1])
    for share, sign in ((0.999, 1), (1.001, -1)):
        turn = Pose.from_rotvec("camera", "camera", axis * slack * share, np.zeros(3))
        turned = Views(
            view.rotation @ turn.rotation, view.position_mm, 13, 12.5, 0.8, 0
        )
        assert np.sign(circle.rows(turned).value.min()) == sign


def test_a_short_feature_needs_its_share_of_the_pixels():
    sensor = Sensor(1280, 1024, 0.005, 0.005)
    segments = np.array([[[0, 0, 0], [1.0, 0, 0]]])
    whole = Resolution.of_segments(segments, detail_mm=4.0, pixels=8, sensor=sensor)
    assert whole.labels == ("segment 1, whole",)
    assert whole.required_px == pytest.approx([2.0])
    with pytest.raises(ValueError, match="positive length"):
        Resolution.of_segments(segments * 0, detail_mm=4.0, pixels=8, sensor=sensor)


def test_points_alone_ask_for_no_resolution():
    nothing = Resolution.of_segments(
        [], detail_mm=[], pixels=[], sensor=Sensor(64, 64, 0.005, 0.005)
    )
    views = views_at([[0, 0, 10], [0, 0, 20]])
    assert nothing.rows(views).value.shape == (2, 0)
    assert nothing.rows(views).gradient.shape == (2, 0, 9)
    assert nothing.report(views).unbounded.all()
    assert nothing.report(views).label(1) == "nothing asked"


def test_resolution_loses_exactly_what_distance_takes():
    sensor = Sensor(1280, 1024, 0.005, 0.005)
    segments = np.array([[[0, 0, 0], [10.0, 0, 0]]])
    fine = Resolution.of_segments(segments, detail_mm=2.0, pixels=3, sensor=sensor)
    value = fine.report(views_at([[5, 0, 200], [5, 0, 400]])).value + 3
    assert value[0] == pytest.approx(13.0 * 2 / 200 / (0.005 * np.sqrt(2)))
    assert value[1] == pytest.approx(value[0] / 2)


def test_an_index_is_margin_over_deviation_and_stays_finite_without_any():
    gradient = np.zeros((1, 3, 9))
    gradient[0, 0, 0], gradient[0, 0, 6] = 3.0, 400.0
    value = np.array([[10.0, 2.0, 0.0]])
    index = sigma_index(value, gradient, Uncertainty(1.0, 0.0, 0.01).sigma)
    assert index[0] == pytest.approx([10 / 5, 1e6, 0.0])


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_an_uncertainty_must_be_finite_and_not_negative(bad):
    with pytest.raises(ValueError, match="finite"):
        Uncertainty(1.0, 0.01, bad)
