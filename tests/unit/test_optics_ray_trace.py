"""Thick-lens formulas against rays through two thin lenses and a stop.

The lens here is a set of ray-transfer steps; its focal length, nodal points, pupils and
blur are found by tracing rays, not by any formula of the product. Object side left;
lengths in mm, positions along the axis from the first lens.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import brentq

from mvp.optics import (
    Views,
    depth_limits_mm,
    equal_blur_image_distance_mm,
    focus_distance_mm,
    principal_distance_mm,
    signed_blur_mm,
)


@dataclass(frozen=True)
class TwoLenses:
    """Two thin lenses, a gap apart, and a stop between or behind them."""

    f_1: float
    f_2: float
    gap: float
    stop_at: float
    stop_radius: float

    def elements(self):
        parts = [(0.0, self.f_1), (self.gap, self.f_2), (self.stop_at, None)]
        return sorted(parts, key=lambda part: part[0])

    def trace(self, height, slope, start, end, *, at_stop=False):
        """Heights and slopes at ``end`` of rays that leave ``start``."""
        here, stop_height = start, np.nan * height
        for position, focal in self.elements():
            height = height + slope * (position - here)
            here = position
            if focal is None:
                stop_height = height
            else:
                slope = slope - height / focal
        arrived = height + slope * (end - here)
        return (arrived, slope, stop_height) if at_stop else (arrived, slope)

    def cardinal(self):
        """Focal length, front and back nodal (principal) points."""
        last = self.elements()[-1][0]
        height, slope = self.trace(1.0, 0.0, -1.0, last)
        focal = -1.0 / slope
        back_principal = last - height / slope - focal
        # The same from behind: which slope leaves parallel at height 1?
        at_zero, at_one = (self.trace(0.0, s, -1.0, last) for s in (0.0, 1.0))
        unit = self.trace(1.0, 0.0, -1.0, last)
        needed = -(unit[1] - at_zero[1]) / (at_one[1] - at_zero[1])
        front_focus = -1.0 - 1.0 / needed
        return focal, front_focus + focal, back_principal

    def entrance_pupil(self):
        """Position and diameter, from rays that pass the stop's centre and edge."""

        def slope_to(point, height, target):
            def miss(slope):
                return self.trace(height, slope, point, 50.0, at_stop=True)[2] - target

            return brentq(miss, -2.0, 2.0)

        far, near = -200.0, -100.0
        heights = [20.0, 10.0]
        through = [slope_to(far, heights[0], 0.0), slope_to(near, heights[1], 0.0)]
        # Both rays, prolonged straight, meet the axis in the pupil's centre.
        centre = np.mean(
            [far - heights[0] / through[0], near - heights[1] / through[1]]
        )
        edge = slope_to(far, 0.0, self.stop_radius)
        return float(centre), 2 * abs(edge * (centre - far))


LENSES = {
    "stop behind the front lens": TwoLenses(24.0, 22.0, 6.0, 1.8, 1.1),
    "stop near the rear lens": TwoLenses(30.0, 18.0, 7.0, 6.0, 0.8),
    "telephoto": TwoLenses(10.0, -30.0, 4.0, 2.0, 0.9),
}


@pytest.fixture(params=LENSES, ids=lambda name: name.replace(" ", "-"))
def lens(request):
    return LENSES[request.param]


def spot(lens, object_at, height, sensor_at):
    """Extent and chief-ray height of the picture of a point, by random rays."""
    rng = np.random.default_rng(3)
    to_first = -object_at
    slopes = (rng.uniform(-9, 9, 20_000) - height) / to_first
    slopes = np.append(slopes, (np.linspace(-9, 9, 20_001) - height) / to_first)
    picture, _, at_stop = lens.trace(
        np.full(slopes.shape, height), slopes, object_at, sensor_at, at_stop=True
    )
    # Linear optics: stop height fixes image height, so the edge is extrapolated exactly.
    line = np.polyfit(at_stop, picture, 1)
    passed = np.abs(at_stop) <= lens.stop_radius
    extent = np.ptp(picture[passed])
    exact = 2 * lens.stop_radius * line[0]
    assert extent == pytest.approx(abs(exact), rel=2e-3, abs=1e-6)
    return exact, line[1]


def setting(lens, sharp_at):
    """f, d, a, e of this lens with its sensor where a point is sharp."""
    focal, front, back = lens.cardinal()
    pupil, diameter = lens.entrance_pupil()
    distance = front - sharp_at
    image = 1 / (1 / focal - 1 / distance)
    return focal, image, diameter, front - pupil, back + image


def test_some_of_the_lenses_have_their_pupil_in_front_of_the_nodal_point():
    offsets = [setting(each, -300.0)[3] for each in LENSES.values()]
    assert max(offsets) > 1.0
    assert min(offsets) < 0.0 or min(offsets) < max(offsets)


def test_the_sensor_is_where_a_point_is_sharp(lens):
    _, _, _, _, sensor = setting(lens, -300.0)
    blur, _ = spot(lens, -300.0, 0.0, sensor)
    assert blur == pytest.approx(0, abs=1e-9)
    f, d, _, _, _ = setting(lens, -300.0)
    front = lens.cardinal()[1]
    assert focus_distance_mm(d, f) == pytest.approx(front + 300.0)


@pytest.mark.parametrize("object_at", [-150.0, -240.0, -300.0, -500.0, -2000.0])
def test_blur_is_the_extent_of_the_traced_spot(lens, object_at):
    f, d, a, e, sensor = setting(lens, -300.0)
    pupil = lens.entrance_pupil()[0]
    traced, _ = spot(lens, object_at, 0.0, sensor)
    predicted = signed_blur_mm(pupil - object_at, d, f, a, e)
    assert abs(predicted) == pytest.approx(abs(traced), rel=1e-6, abs=1e-9)
    assert np.sign(np.round(predicted, 9)) == np.sign(-300.0 - object_at)


@pytest.mark.parametrize("object_at", [-150.0, -300.0, -2000.0])
def test_perspective_of_blurred_points_too_is_that_of_the_pupil_and_f_cal(
    lens, object_at
):
    f, d, _, e, sensor = setting(lens, -300.0)
    pupil = lens.entrance_pupil()[0]
    _, chief = spot(lens, object_at, 2.0, sensor)
    f_cal = principal_distance_mm(d, f, e)
    assert -chief == pytest.approx(f_cal * 2.0 / (pupil - object_at), rel=1e-6)
    view = Views(np.eye(3), np.zeros(3), d, f, 1.0, e)
    assert view.f_cal_mm[0] == pytest.approx(float(f_cal))


@pytest.mark.parametrize("c_mm", [0.004, 0.0135])
def test_depth_limits_are_where_the_traced_spot_reaches_c(lens, c_mm):
    f, d, a, e, sensor = setting(lens, -300.0)
    front = lens.cardinal()[1]
    near, far = depth_limits_mm(d, f, a, c_mm, e)

    def excess(distance):
        return abs(spot(lens, front - distance, 0.0, sensor)[0]) - c_mm

    sharp = front + 300.0
    assert brentq(excess, 120, sharp - 1e-6, xtol=1e-7) == pytest.approx(near, rel=1e-5)
    if np.isfinite(far) and far < 1e4:
        found = brentq(excess, sharp + 1e-6, 2e4, xtol=1e-7)
        assert found == pytest.approx(far, rel=1e-5)
    else:
        assert excess(1e6) < 0


def test_the_equal_blur_setting_blurs_both_depths_alike(lens):
    f, _, a, e, _ = setting(lens, -300.0)
    back = lens.cardinal()[2]
    pupil = lens.entrance_pupil()[0]
    d = float(equal_blur_image_distance_mm(200.0, 500.0, f, e))
    near, _ = spot(lens, pupil - 200.0, 0.0, back + d)
    far, _ = spot(lens, pupil - 500.0, 0.0, back + d)
    assert abs(near) == pytest.approx(abs(far), rel=1e-6)
    assert near * far < 0
    assert abs(near) == pytest.approx(abs(signed_blur_mm(200.0, d, f, a, e)), rel=1e-6)
