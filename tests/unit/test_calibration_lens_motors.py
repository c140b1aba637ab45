"""Pupil from blur, hysteresis from both sides, curves through nodes."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.lens_table import (
    AxisNodes,
    BlurShots,
    BothSides,
    best_curve,
    defocus,
    measure_aperture,
    measure_hysteresis,
)
from mvp.errors import CalibrationError
from mvp.testing.paraxial_lens import ParaxialLens

LENS = ParaxialLens.thin(f_mm=12.5, d_mm=13.07, e_mm=8.0, a_mm=3.1)
F_CAL = float(LENS.scale(100.0)) * 100.0
SHARP = LENS.sharp_from_pupil_mm()


def swept(rng, distances, *, share=0.02, rest_mm=0.006):
    blur = np.hypot(LENS.blur_mm(distances), rest_mm)
    at = defocus(distances, F_CAL, 0.57 / 12.5)
    sigma = share * blur + 1e-4
    return BlurShots(at, blur + rng.normal(0, sigma), sigma)


def test_blur_on_both_sides_gives_the_traced_pupil():
    rng = np.random.default_rng(1)
    distances = SHARP * np.linspace(0.6, 1.8, 15)
    found = [measure_aperture(swept(rng, distances)) for _ in range(40)]
    error = np.array([one.a_mm for one in found]) - 3.1
    sigma = np.array([one.a_sigma_mm for one in found])
    assert np.sqrt((error**2).mean()) < 0.03
    assert 0.55 < np.mean(np.abs(error) < sigma) < 0.80
    assert np.mean([one.sharp_at for one in found]) == pytest.approx(0, abs=1e-4)
    assert np.mean([one.least_blur_mm for one in found]) == pytest.approx(
        0.006, abs=1e-3
    )


def test_blur_on_one_side_gives_the_pupil_too():
    rng = np.random.default_rng(2)
    found = measure_aperture(swept(rng, SHARP * np.linspace(1.0, 2.5, 12)))
    assert abs(found.a_mm - 3.1) < 4 * found.a_sigma_mm
    assert found.a_sigma_mm < 0.15


@pytest.mark.parametrize(
    ("distances", "words"),
    [(np.linspace(0.6, 1.5, 3), "3 pictures"), (np.linspace(0.99, 1.01, 9), "hardly")],
)
def test_sweeps_that_cannot_tell_are_refused(distances, words):
    with pytest.raises(CalibrationError, match=words):
        measure_aperture(
            swept(np.random.default_rng(3), SHARP * distances, share=0.001)
        )


def approached(rng, width, *, sd=(2.0, 2.0), repeats=4, slope=-1.3e-4):
    steps = np.arange(0, 8000, 1000)
    truth = 13 + slope * steps[:, None]
    shape = (len(steps), repeats)
    below = truth + slope * rng.normal(0, sd[0], shape)
    above = truth + slope * (np.broadcast_to(width, steps.shape)[:, None])
    above = above + slope * rng.normal(0, sd[1], shape)
    return BothSides(steps, below, above, np.full(len(steps), slope))


def test_width_and_repeatability_come_back_in_steps():
    rng = np.random.default_rng(4)
    found = [measure_hysteresis(approached(rng, 40.0)) for _ in range(60)]
    width = np.array([one.width_steps for one in found])
    inside = np.abs(width - 40) < [one.width_sigma_steps for one in found]
    assert 0.55 < np.mean(inside) < 0.80
    assert np.mean([one.repeatability_steps for one in found]) == pytest.approx(
        2, rel=0.1
    )
    assert found[0].backlash_steps == pytest.approx(40, abs=2)
    assert found[0].overshoot_steps > 45
    assert found[0].side == "from_below"


def test_a_motor_without_play_has_none():
    rng = np.random.default_rng(5)
    found = [measure_hysteresis(approached(rng, 0.0)) for _ in range(40)]
    assert np.mean([one.backlash_steps == 0 for one in found]) > 0.85


def test_the_side_that_repeats_better_is_proposed():
    found = measure_hysteresis(approached(np.random.default_rng(6), 30, sd=(8.0, 1.0)))
    assert found.side == "from_above"
    assert found.repeatability_steps == pytest.approx(1, rel=0.4)


def test_a_width_that_changes_over_the_range_counts_where_it_is_widest():
    widths = np.linspace(10, 60, 8)
    found = measure_hysteresis(approached(np.random.default_rng(7), widths))
    assert not found.uniform
    assert found.backlash_steps >= 56


def axis_nodes(rng, truth, sigma, count=9, last=3200):
    steps = np.linspace(0, last, count).astype(np.int64)
    spread = np.full(count, sigma)
    return AxisNodes(steps, truth(steps) + rng.normal(0, spread), spread)


def focal(steps):
    """A zoom: exponential, with a little that is not."""
    t = np.asarray(steps) / 3200
    return 8 * np.exp(t * np.log(25 / 8) + 0.03 * t * (1 - t))


def linear(steps):
    return 0.1 + 1.375e-4 * np.asarray(steps)


@pytest.mark.parametrize("trials", [15, pytest.param(30, marks=pytest.mark.full)])
@pytest.mark.parametrize(("truth", "last"), [(focal, 3200), (linear, 8000)])
def test_left_out_nodes_are_foretold_within_two_sigma(truth, last, trials):
    rng = np.random.default_rng(8)
    nodes = [axis_nodes(rng, truth, 0.003, last=last) for _ in range(trials)]
    curves = [best_curve(one) for one in nodes]
    assert np.mean([c.left_out_sigmas < 2 for c in curves]) > 0.9
    between = np.arange(0, last + 1, 40)
    for curve in curves:
        found = np.interp(between, curve.table_steps, curve.table_mm)
        if truth is linear:
            assert np.abs(found - truth(between)).max() < 4 * 0.003


def test_a_zoom_is_better_foretold_by_a_smooth_logarithm_than_by_the_plain_cubic():
    curve = best_curve(axis_nodes(np.random.default_rng(9), focal, 0.003))
    assert curve.kind.logarithmic
    assert curve.kind.shape == "polynomial"
    assert len(curve.table_steps) == 33
    assert curve.monotone


def test_a_curve_of_two_nodes_cannot_be_tested():
    curve = best_curve(AxisNodes(np.array([0, 10]), np.array([1.0, 2.0]), np.ones(2)))
    assert np.isnan(curve.left_out_sigmas)
    assert curve.monotone


def test_values_that_turn_back_are_not_smoothed_over():
    values = np.array([1.0, 2.0, 1.9, 3.0, 4.0])
    curve = best_curve(AxisNodes(np.arange(5), values, np.full(5, 0.01)))
    assert not curve.monotone
