"""Analytic gradients of every row against fourth-order central differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mvp.constraints import (
    FieldOfViewCircle,
    FieldOfViewRectangle,
    FocusFar,
    FocusNear,
    LensRange,
    Resolution,
    Visibility,
    Workspace,
    rows_index,
    sigma_index,
)
from mvp.geometry import Box, Pose
from mvp.optics import Intrinsics, Sensor, Views

SENSOR = Sensor(543, 480, 0.0162476, 0.0135)
INTRINSICS = Intrinsics(SENSOR, 280.0, 225.0)
SEGMENTS = np.array(
    [[[-12.7, 0, 12.7], [12.7, 0, 12.7]], [[12.7, 0, -12.7], [12.7, 3, 12.7]]]
)
POINTS = SEGMENTS.reshape(-1, 3)[:3]
# A natural size of every error coordinate: gradients are compared in these units.
NATURAL = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01])


@dataclass(frozen=True)
class Near:
    distance: np.ndarray
    direction: np.ndarray


@dataclass(frozen=True)
class BoxRegion:
    """A box whose six rectangles are the facets: distances by clipping."""

    low: np.ndarray
    high: np.ndarray

    def nearest_facets(self, points, k):
        closest = np.repeat(np.clip(points, self.low, self.high)[:, None], 6, axis=1)
        for side in range(6):
            closest[:, side, side % 3] = (self.low, self.high)[side // 3][side % 3]
        offset = points[:, None] - closest
        distance = np.linalg.norm(offset, axis=-1)
        order = np.argsort(distance, axis=1)[:, :k]
        rows = np.arange(len(points))[:, None]
        return Near(distance[rows, order], (offset / distance[..., None])[rows, order])

    def signed_distance(self, points):
        return self.signed_distance_gradient(points)[0]

    def signed_distance_gradient(self, points):
        inside = ((points > self.low) & (points < self.high)).all(axis=1)
        near = self.nearest_facets(points, 1)
        sign = np.where(inside, 1.0, -1.0)[:, None]
        return sign[:, 0] * near.distance[:, 0], sign * near.direction[:, 0]


REGION = BoxRegion(np.array([-700.0, -650, -600]), np.array([710.0, 660, 800]))
CONSTRAINTS = {
    "resolution": Resolution.of_segments(
        SEGMENTS, detail_mm=2.54, pixels=[1, 4], sensor=SENSOR
    ),
    "resolution along": Resolution.of_segments(
        SEGMENTS, detail_mm=2.54, pixels=1, sensor=SENSOR, rule="along"
    ),
    "focus near": FocusNear(POINTS, 0.0135),
    "focus far": FocusFar(POINTS, 0.0135),
    "circle": FieldOfViewCircle(np.array([1.0, -2, 3]), 18.0, 3.2),
    "rectangle": FieldOfViewRectangle.for_sensor(POINTS, INTRINSICS, guard_px=4),
    "visibility": Visibility(REGION, facets=4),
    "workspace": Workspace(
        Box(np.full(3, -900.0), np.full(3, 900.0)),
        Pose.from_rotvec("base", "part", [0.3, -0.2, 1.1], [10, 20, 30]),
    ),
    "lens range": LensRange.within(d_mm=(12.6, 15), f_mm=(8, 25), a_mm=(0.4, 4)),
}


def random_views(count, e_mm, seed=7):
    rng = np.random.default_rng(seed)
    nu = rng.normal(size=(count, 3))
    nu /= np.linalg.norm(nu, axis=1, keepdims=True)
    rotation = Rotation.random(count, random_state=rng).as_matrix()
    side = np.cross(nu, rotation[:, :, 0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    rotation = np.stack([side, np.cross(nu, side), nu], axis=2)
    rotation = (
        rotation @ Rotation.from_rotvec(rng.normal(0, 0.1, (count, 3))).as_matrix()
    )
    position = -nu * rng.uniform(150, 800, (count, 1)) + rng.normal(0, 30, (count, 3))
    f = rng.uniform(8, 25, count)
    d = f * rng.uniform(0.999, 1.3, count)
    return Views(rotation, position, d, f, rng.uniform(0.4, 4, count), e_mm)


def moved(views, coordinate, step):
    shift = np.zeros(9)
    shift[coordinate] = step
    turn = Rotation.from_rotvec(shift[3:6]).as_matrix()
    return Views(
        views.rotation @ turn,
        views.position_mm + shift[:3],
        views.d_mm + shift[6],
        views.f_mm + shift[7],
        views.a_mm + shift[8],
        views.e_mm,
    )


def differences(constraint, views):
    columns = []
    for coordinate in range(9):
        h = 0.05 * NATURAL[coordinate]

        def at(times, coordinate=coordinate, h=h):
            other = moved(views, coordinate, times * h)
            return constraint.rows(other, gradient=False).value

        columns.append((8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h))
    return np.stack(columns, axis=-1)


def away_from_kinks(name, constraint, views):
    """Rows without a kink nearby.

    Kinks: the true direction of the circle at rho = 0; a piece seen end on; the pixel
    diagonal of the rule "along"; the boundary of the region and a change of order of
    its facets.
    """
    value = constraint.rows(views, gradient=False).value
    keep = np.ones(value.shape, bool)
    if name == "resolution along":
        worst = constraint.rows(moved(views, 5, 0.003), gradient=True).gradient
        other = constraint.rows(moved(views, 5, -0.003), gradient=True).gradient
        keep = np.isclose(worst, other, rtol=0.2, atol=0.3).all(axis=-1)
    if name == "circle":
        centre = views.camera_points(constraint.centre_mm[None])[:, 0]
        keep[:, 0] = np.hypot(centre[:, 0], centre[:, 1]) > 15
    if name == "visibility":
        near = constraint.region.nearest_facets(views.position_mm, 6).distance
        gaps = np.diff(near, axis=1)
        apart = ((gaps > 0.3) | (gaps == 0)).all(axis=1)
        keep = (apart & (near[:, 0] > 0.3))[:, None] & keep
    return keep


@pytest.mark.parametrize("e_mm", [0.0, 2.4])
@pytest.mark.parametrize("name", CONSTRAINTS)
def test_every_gradient_agrees_with_central_differences_to_one_in_1e5(name, e_mm):
    constraint = CONSTRAINTS[name]
    views = random_views(200, e_mm)
    keep = away_from_kinks(name, constraint, views)
    assert keep.mean() > 0.75
    analytic = constraint.rows(views).gradient * NATURAL
    numeric = differences(constraint, views) * NATURAL
    largest = np.abs(numeric).max(axis=-1, keepdims=True)
    allowed = 1e-5 * np.abs(numeric) + 1e-8 * largest + 1e-11
    excess = (np.abs(analytic - numeric) / allowed)[keep]
    assert excess.max() < 1


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_values_do_not_depend_on_whether_gradients_are_asked_for(name):
    constraint = CONSTRAINTS[name]
    views = random_views(20, 2.4)
    with_gradient = constraint.rows(views)
    without = constraint.rows(views, gradient=False)
    assert without.gradient is None
    assert np.array_equal(with_gradient.value, without.value)
    assert with_gradient.gradient.shape == (20, len(constraint.labels), 9)


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_the_unit_of_a_row_does_not_change_its_index(name):
    rows = CONSTRAINTS[name].rows(random_views(20, 2.4))
    index = rows_index(rows, NATURAL)
    scaled = sigma_index(rows.value * 1e3, rows.gradient * 1e3, NATURAL)
    assert np.allclose(index, scaled)


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_views_that_look_away_give_finite_negative_margins_and_finite_slopes(name):
    views = random_views(50, 2.4)
    backwards = views.rotation * np.array([1, -1, -1])
    away = Views(
        backwards, views.position_mm, views.d_mm, views.f_mm, views.a_mm, views.e_mm
    )
    rows = CONSTRAINTS[name].rows(away)
    assert np.isfinite(rows.value).all()
    assert np.isfinite(rows.gradient).all()
    if name not in ("visibility", "workspace", "lens range"):
        assert (rows.value.min(axis=1) < 0).all()
        report = CONSTRAINTS[name].report(away)
        assert (report.value < 0).all()
        assert not report.unbounded.any()
        assert np.isfinite(report.value).all()


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_a_pupil_in_a_feature_point_or_its_plane_gives_finite_rows(name):
    at = np.vstack(
        [POINTS, POINTS + np.array([0, 0, 1e-9]), [[1.0, -2, 3]], [[0, 0, 12.7]]]
    )
    views = Views(np.tile(np.eye(3), (len(at), 1, 1)), at, 13.0, 12.5, 0.78, 2.4)
    rows = CONSTRAINTS[name].rows(views)
    assert np.isfinite(rows.value).all()
    assert np.isfinite(rows.gradient).all()
    assert not np.isnan(CONSTRAINTS[name].report(views).value).any()
