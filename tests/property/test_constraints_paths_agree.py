"""Smooth rows and the paper's forms describe the same admissible sets."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mvp.constraints import (
    FieldOfViewCircle,
    FieldOfViewRectangle,
    FocusFar,
    FocusNear,
    Resolution,
    paper_forms,
)
from mvp.optics import Sensor, Views

SENSOR = Sensor(543, 480, 0.0162476, 0.0135)
EDGE = np.array([[[-12.7, 0, 12.7], [12.7, 2, 10.7]]])
POINTS = np.array([[-12.7, 0, 12.7], [12.7, 0, 12.7], [12.7, 0, -12.7]])


def reals(low, high):
    return st.floats(low, high, allow_nan=False)


@st.composite
def views(draw):
    """Aimed roughly at the part, from any side; sometimes looking away."""
    turn = draw(st.tuples(*[reals(-3.2, 3.2)] * 3))
    rotation = Rotation.from_rotvec(turn).as_matrix()
    aim = draw(st.tuples(reals(-150, 150), reals(-150, 150), reals(-100, 900)))
    f = draw(reals(6, 30))
    d = f * draw(reals(0.99, 1.25))
    a = draw(reals(0.3, 6))
    e = draw(st.sampled_from([0.0, 2.4, -1.5]))
    return Views(rotation[None], [-rotation @ np.array(aim)], d, f, a, e)


def same_sign(smooth, form, scale):
    """Equal verdicts but for rounding next to the boundary."""
    return abs(smooth) < 1e-9 * scale or (smooth >= 0) == (form >= 0)


def parts(view):
    return view.position_mm[0], view.direction[0], float(view.f_cal_mm[0])


@given(views(), reals(0.2, 30))
@settings(max_examples=120, deadline=None)
def test_resolution_rows_equal_the_papers_image_length(view, pixels):
    rows = Resolution.of_segments(EDGE, detail_mm=2.54, pixels=pixels, sensor=SENSOR)
    smooth = float(rows.report(view).value[0])
    r, nu, f_cal = parts(view)
    w = paper_forms.required_length(SENSOR.pitch_x_mm, SENSOR.pitch_y_mm, pixels)
    ends = [EDGE[0], EDGE[0, ::-1]]
    pieces = [
        (p[0], p[0] + 2.54 * (p[1] - p[0]) / np.linalg.norm(p[1] - p[0])) for p in ends
    ]
    form = min(paper_forms.g1_image(r, nu, *piece, w, f_cal) for piece in pieces)
    ratio = min(paper_forms.g1(r, nu, *piece, w, f_cal) for piece in pieces)
    assert same_sign(smooth, form, 1.0)
    assert same_sign(smooth, ratio, 1.0)
    depth = view.camera_points(EDGE[0])[0, :, 2]
    if (depth > 1).all():
        assert np.isclose(smooth * w / pixels, form, rtol=1e-7, atol=1e-9)
        deep = paper_forms.farthest_piece(r, nu, *EDGE[0], np.array(2.54))
        worst = paper_forms.g1_image(r, nu, *deep, w, f_cal)
        assert np.isclose(worst, form, rtol=1e-9, atol=1e-12)


@given(views())
@settings(max_examples=120, deadline=None)
def test_pixels_along_the_image_are_never_fewer_than_by_the_worst_direction(view):
    worst, along = (
        Resolution.of_segments(EDGE, detail_mm=2.54, pixels=1, sensor=SENSOR, rule=rule)
        .rows(view, gradient=False)
        .value
        for rule in ("worst", "along")
    )
    assert (along >= worst - 1e-9 * np.abs(worst)).all()


@given(views())
@settings(max_examples=120, deadline=None)
def test_pixels_along_the_image_agree_with_the_required_length_in_that_direction(view):
    along = Resolution.of_segments(
        EDGE, detail_mm=100, pixels=40, sensor=SENSOR, rule="along"
    )
    q = view.camera_points(EDGE[0])[0]
    if (q[:, 2] < 1).any():
        return
    image = float(view.f_cal_mm[0]) * np.diff(q[:, :2] / q[:, 2:], axis=0)[0]
    share = np.linalg.norm(EDGE[0, 1] - EDGE[0, 0]) / 100
    w = paper_forms.required_length_along(
        image, SENSOR.pitch_x_mm, SENSOR.pitch_y_mm, 40 * share
    )
    slack = np.linalg.norm(image) - w
    assert same_sign(float(along.report(view).value[0]), slack, 1.0)


@given(views(), reals(0.002, 0.1))
@settings(max_examples=120, deadline=None)
def test_focus_in_blur_form_and_in_depth_form_accept_the_same_views(view, c):
    r, nu, _ = parts(view)
    lens = (view.d_mm[0], view.f_mm[0], view.a_mm[0], c, view.e_mm[0])
    near, far = FocusNear(POINTS, c), FocusFar(POINTS, c)
    rows = near.rows(view).value.min(), far.rows(view).value.min()
    forms = (
        paper_forms.g2a(r, nu, POINTS, paper_forms.near_limit(*lens), lens[4]),
        paper_forms.g2b(r, nu, POINTS, paper_forms.far_limit(*lens), lens[4]),
    )
    reports = near.report(view).value[0], far.report(view).value[0]
    for row, form, reported in zip(rows, forms, reports, strict=True):
        assert same_sign(row, form, c)
        assert same_sign(row, reported, c)
    assert far.report(view).unbounded[0] == np.isposinf(forms[1])


@given(views(), reals(1, 60))
@settings(max_examples=120, deadline=None)
def test_the_circular_field_of_view_accepts_the_same_views_in_all_forms(view, radius):
    circle = FieldOfViewCircle(np.array([3.0, -4, 5]), radius, 3.2)
    r, nu, f_cal = parts(view)
    alpha = paper_forms.field_of_view_angle(6.4, f_cal)
    smooth = float(circle.rows(view, gradient=False).value.min())
    arguments = (r, nu, circle.centre_mm, radius, alpha)
    assert same_sign(smooth, paper_forms.g3(*arguments), 1e3)
    assert same_sign(smooth, paper_forms.g3_cosine(*arguments), 1e3)
    assert same_sign(smooth, circle.report(view).value[0], 1e3)


@given(views())
@settings(max_examples=120, deadline=None)
def test_the_rectangle_accepts_exactly_what_projects_onto_the_sensor(view):
    extents = np.array([3.0, 4.0, 2.0, 3.5])
    rectangle = FieldOfViewRectangle(POINTS, extents)
    smooth = float(rectangle.rows(view, gradient=False).value.min())
    q = view.camera_points(POINTS)[0]
    image = view.f_cal_mm[0] * q[:, :2] / q[:, 2:]
    room = np.hstack([image + extents[[0, 2]], extents[[1, 3]] - image]).min()
    form = room if (q[:, 2] > 0).all() else -1.0
    assert same_sign(smooth, form, 1e3)
    assert same_sign(smooth, rectangle.report(view).value[0], 1e3)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_rays_never_undercut_the_exact_distance_to_a_boundary(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(5, 95, (6, 3))
    directions = rng.normal(size=(64, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    exact = np.minimum(points, 100 - points).min(axis=1)
    inside = np.ones(6, bool)
    approximate = paper_forms.g4_rays(out_of_cube(points, directions), inside)
    assert (approximate >= paper_forms.g4(exact, inside) - 1e-9).all()
    straight = out_of_cube(points, np.vstack([np.eye(3), -np.eye(3)]))
    assert np.allclose(paper_forms.g4_rays(straight, inside), exact)
    assert (paper_forms.g4_rays(straight, inside, on_boundary=inside) == 0).all()
    assert (paper_forms.g4_rays(straight, ~inside) < 0).all()


def out_of_cube(points, directions):
    """Length of rays (n, r) from inside a cube of 100 mm to its walls."""
    with np.errstate(divide="ignore"):
        walls = np.where(directions > 0, 100.0, 0.0) - points[:, None]
        lengths = np.where(directions == 0, np.inf, walls / directions)
    return lengths.min(axis=2)
