"""Motor steps to f, d, a and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mvp.calibrated.models import LensTableCalibration
from mvp.errors import CalibrationError, InputError
from mvp.optics import LensSteps, LensTable, MotorAxis, pupil_shift_mm


@st.composite
def axes(draw, name, low, high):
    """Strictly monotone, unevenly spaced, rising or falling."""
    count = draw(st.integers(2, 9))
    gaps = draw(st.lists(st.integers(20, 900), min_size=count, max_size=count))
    steps = draw(st.integers(-4000, 4000)) + np.cumsum(gaps)
    rises = draw(st.lists(st.floats(0.02, 1.0), min_size=count - 1, max_size=count - 1))
    share = np.concatenate([[0.0], np.cumsum(rises)]) / sum(rises)
    values = low + share * (high - low)
    return MotorAxis(name, steps, values[::-1] if draw(st.booleans()) else values)


@st.composite
def tables(draw):
    return LensTable(
        draw(axes("zoom", 8.0, 24.0)),
        draw(axes("focus", 0.05, 1.3)),
        draw(axes("iris", 0.5, 6.0)),
        draw(st.floats(-2, 5)),
        draw(st.sampled_from([0.0, 0.5, 1.0])),
    )


@st.composite
def tables_with_steps(draw):
    table = draw(tables())
    steps = [
        draw(st.integers(*axis.range_steps))
        for axis in (table.zoom, table.focus, table.iris)
    ]
    return table, LensSteps(*steps)


@given(tables_with_steps())
@settings(max_examples=100, deadline=None)
def test_a_setting_comes_back_to_its_own_steps(case):
    table, steps = case
    setting = table.at(steps)
    back = table.steps(setting.f_mm, setting.d_mm, setting.a_mm)
    assert abs(back.zoom - steps.zoom) <= 1
    assert abs(back.focus - steps.focus) <= 1
    assert abs(back.iris - steps.iris) <= 1
    assert setting.e_mm == table.pupil_offset_mm


@given(tables(), st.floats(0, 1), st.floats(0.02, 0.98), st.floats(0, 1))
@settings(max_examples=100, deadline=None)
def test_rounded_steps_give_the_nearest_value_of_every_axis(table, s, t, u):
    f = np.interp(s, [0, 1], table.f_range_mm)
    a = np.interp(u, [0, 1], table.a_range_mm)
    zoomed = float(table.zoom.value_mm(table.zoom.nearest_step(float(f))))
    d = zoomed + np.interp(t, [0, 1], table.extension_range_mm)
    assume(table.reaches(float(f), float(d), float(a)))
    steps = table.steps(float(f), float(d), float(a))
    given_back = table.at(steps)
    for axis, step, wanted in (
        (table.zoom, steps.zoom, f),
        (table.focus, steps.focus, d - given_back.f_mm - table.tube_mm),
        (table.iris, steps.iris, a),
    ):
        around = np.clip(np.arange(step - 3, step + 4), *axis.range_steps)
        errors = np.abs(axis.value_mm(around) - wanted)
        mine = abs(float(axis.value_mm(step)) - wanted)
        assert mine <= errors.min() + 1e-12


@given(axes("focus", 0.05, 1.3), st.floats(-0.3, 1.3))
@settings(max_examples=100, deadline=None)
def test_fractional_steps_invert_the_curve_also_beyond_its_ends(axis, share):
    low, high = axis.range_mm
    value = low + share * (high - low)
    assert float(axis.value_mm(axis.fractional_steps(value))) == pytest.approx(
        value, abs=1e-8
    )


@given(axes("focus", 0.05, 1.3))
@settings(max_examples=100, deadline=None)
def test_the_curve_passes_its_nodes_and_never_turns_back(axis):
    assert np.allclose(axis.value_mm(axis.steps), axis.values_mm)
    every = np.arange(axis.range_steps[0], axis.range_steps[1] + 1)
    assert (np.diff(axis.value_mm(every)) * axis.sense > 0).all()


def plain_table():
    return LensTable(
        MotorAxis("zoom", np.array([0, 1000]), np.array([12.0, 13.0])),
        MotorAxis("focus", np.array([0, 1200]), np.array([0.1, 1.2])),
        MotorAxis("iris", np.array([0, 100]), np.array([4.0, 0.5])),
    )


def test_an_unreachable_setting_is_refused_with_the_nearest_reachable_values():
    with pytest.raises(InputError, match=r"d = 14\.5000 mm is outside") as refused:
        plain_table().steps(12.5, 14.5, 0.8)
    assert "d = 13.7000" in refused.value.hint
    assert plain_table().nearest(12.5, 14.5, 0.8).d_mm == pytest.approx(13.7)
    with pytest.raises(InputError, match="iris step 101") as refused:
        plain_table().setting(0, 0, 101)
    assert "100" in refused.value.hint


@pytest.mark.parametrize(
    ("d", "tube"), [(13.07, 0.0), (13.8, 0.5), (14.4, 1.0), (12.55, None), (16.0, None)]
)
def test_the_shortest_tube_that_reaches_d_is_named(d, tube):
    table = plain_table()
    assert table.tube_for(d, 12.5, [5.0, 1.0, 0.5]) == tube
    if tube is not None:
        assert table.with_tube(tube).reaches(12.5, d, 0.8)
        got = table.with_tube(tube).nearest(12.5, d, 0.8)
        assert got.d_mm == pytest.approx(d, abs=0.001)


def test_focus_makes_good_what_rounding_did_to_zoom():
    coarse = LensTable(
        MotorAxis("zoom", np.array([0, 10]), np.array([12.0, 13.0])),
        MotorAxis("focus", np.array([0, 12000]), np.array([0.1, 1.2])),
        MotorAxis("iris", np.array([0, 100]), np.array([4.0, 0.5])),
    )
    given_back = coarse.nearest(12.54, 13.1, 0.8)
    assert given_back.f_mm == pytest.approx(12.5)
    assert given_back.d_mm == pytest.approx(13.1, abs=1e-4)


def test_the_pupil_moves_towards_the_object_as_d_grows():
    assert pupil_shift_mm(13.16, 12.5) == pytest.approx(0.66)


def test_a_table_that_turns_back_is_a_calibration_error():
    with pytest.raises(CalibrationError, match="focus"):
        MotorAxis("focus", np.array([0, 10, 20]), np.array([0.1, 0.3, 0.2]))
    with pytest.raises(CalibrationError, match="two or more"):
        MotorAxis("iris", np.array([0]), np.array([0.1]))


def test_a_table_is_read_from_its_calibration_file():
    model = LensTableCalibration.model_validate(
        {
            "schema": "mvp-cell/lens-table/1",
            "provenance": {"date": "2026-01-01", "device_serial": "1", "method": "t"},
            "quality": {"verdict": "go"},
            "zoom_f_mm": {"steps": [0, 100], "values_mm": [12.0, 13.0]},
            "focus_extension_mm": {"steps": [0, 100], "values_mm": [0.1, 1.2]},
            "iris_a_mm": {"steps": [100, 0], "values_mm": [0.5, 4.0]},
            "pupil_offset_mm": 2.4,
        }
    )
    table = LensTable.from_calibration(model, tube_mm=0.5)
    setting = table.setting(50, 0, 100)
    assert setting.f_mm == pytest.approx(12.5)
    assert setting.d_mm == pytest.approx(13.1)
    assert setting.a_mm == pytest.approx(0.5)
    assert setting.e_mm == 2.4
    assert table.d_range_mm(12.5) == pytest.approx((13.1, 14.2))
