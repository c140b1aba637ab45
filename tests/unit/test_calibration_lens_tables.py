"""From nodes to the table that the planner reads, with a verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.lens_table import (
    BothSides,
    Conditions,
    LensIdentity,
    LensMeasurements,
    LensNode,
    Measured,
    build_tables,
    calibration_file,
    judge_lens,
    measure_hysteresis,
)
from calibration.wizard.lens_result import without_table
from mvp.calibrated import LensTableCalibration
from mvp.errors import CalibrationError, InputError
from mvp.optics import LensTable
from mvp.testing.paraxial_lens import ParaxialLens

ZOOMS = np.linspace(0, 3200, 8).astype(int)
FOCUSES = np.linspace(0, 8000, 7).astype(int)
IRISES = np.linspace(0, 600, 9).astype(int)
IDENTITY = LensIdentity("L-1", "2026-01-01", simulated=True)
WARM = Conditions(21.5, "operator")


def focal(step):
    return 8 * (25 / 8) ** (np.asarray(step) / 3200)


def extension(step):
    return 0.1 + 1.375e-4 * np.asarray(step)


def pupil(step):
    return 0.4 * 10 ** (np.asarray(step) / 600)


def lens_at(zoom, focus):
    f = float(focal(zoom))
    d = f + float(extension(focus))
    return ParaxialLens.thin(f_mm=f, d_mm=d, e_mm=2.4, a_mm=1.0)


def nodes(rng, *, zooms=ZOOMS, focuses=FOCUSES, f_cal_sd=0.002, sharp_share=0.005):
    found = []
    for zoom in zooms:
        for focus in focuses:
            lens = lens_at(zoom, focus)
            sigma = np.array([f_cal_sd, 0.35, 0.35, 1e-5])
            values = np.array([float(lens.scale(99.0)) * 99.0, 800, 600, 1e-3])
            far = lens.sharp_from_pupil_mm()
            sharp = Measured(far * (1 + rng.normal(0, sharp_share)), far * sharp_share)
            values = values + rng.normal(0, sigma)
            cov = np.diag(sigma**2)
            found.append(LensNode(int(zoom), int(focus), values, cov, sharp))
    return found


def sides(rng, width):
    steps = np.array([100, 300, 500])
    slope = np.full(3, 1e-4)
    below = 1e-4 * (steps[:, None] + rng.normal(0, 1, (3, 4)))
    above = 1e-4 * (steps[:, None] + width + rng.normal(0, 1, (3, 4)))
    return measure_hysteresis(BothSides(steps, below, above, slope))


def measured(rng, **options):
    a = pupil(IRISES)
    return LensMeasurements(
        nodes(rng, **options),
        {
            int(s): Measured(v * (1 + rng.normal(0, 0.005)), v * 0.005)
            for s, v in zip(IRISES, a, strict=True)
        },
        blur_limit_mm=0.0135,
        hysteresis={
            "zoom": sides(rng, 30),
            "focus": sides(rng, 40),
            "iris": sides(rng, 6),
        },
        conditions=WARM,
    )


@pytest.fixture(scope="module")
def good():
    return measured(np.random.default_rng(1))


@pytest.fixture(scope="module")
def tables(good):
    return build_tables(good)


def test_a_well_measured_zoom_lens_meets_every_bar(tables):
    truth = np.array(
        [focal(n.zoom) + extension(n.focus) for n in tables.fit.seen.nodes]
    )
    error = np.abs(tables.fit.d_mm - truth)
    assert (error < 0.0005 * truth).all()
    assert (tables.fit.d_sigma_mm < 0.1 * tables.depth_of_focus_mm).all()
    assert abs(tables.fit.e_mm - 2.4) < 0.1
    assert tables.round_trip_steps <= 1
    assert all(curve.left_out_sigmas < 2 for curve in tables.curves.values())
    assert judge_lens(tables).grade == "go"


def test_between_nodes_the_planner_reads_the_true_lens(tables):
    rng = np.random.default_rng(2)
    for _ in range(50):
        zoom, focus, iris = (int(rng.integers(0, n)) for n in (3201, 8001, 601))
        found = tables.table.setting(zoom, focus, iris)
        assert found.f_mm == pytest.approx(float(focal(zoom)), abs=0.006)
        d = float(focal(zoom) + extension(focus))
        assert found.d_mm == pytest.approx(d, rel=0.0005)
        assert found.a_mm == pytest.approx(float(pupil(iris)), rel=0.02)
        back = tables.table.steps(found.f_mm, found.d_mm, found.a_mm)
        off = np.abs(
            np.subtract([back.zoom, back.focus, back.iris], [zoom, focus, iris])
        )
        assert off.max() <= 1


def test_the_file_is_what_the_planner_reads(tables):
    model = calibration_file(tables, IDENTITY)
    again = LensTableCalibration.model_validate_json(
        model.model_dump_json(by_alias=True)
    )
    assert again == model
    table = LensTable.from_calibration(again)
    assert table.setting(1600, 4000, 300).d_mm == pytest.approx(
        tables.table.setting(1600, 4000, 300).d_mm, abs=1e-12
    )
    assert model.focus_extension_mm.backlash_steps in range(39, 43)
    assert len(model.nodes) == len(ZOOMS) * len(FOCUSES)
    assert model.validity.temperature_min_c == 16.5
    assert model.validity.temperature_max_c == 26.5
    assert model.quality.verdict == "go"
    assert model.quality.chi_square_probability > 1e-3
    assert model.quality.out_of_sample_mm < 0.01
    assert model.covariance.parameters[0] == "f_mm at zoom 0"
    assert len(model.provenance.input_sha256) == 64


def test_an_unknown_temperature_is_said_and_is_no_cause(good):
    unknown = build_tables(replace(good, conditions=Conditions()))
    model = calibration_file(unknown, IDENTITY)
    assert model.quality.verdict == "go"
    assert "temperature is unknown" in model.quality.reasons[0]
    assert not model.quality.causes
    assert model.validity.temperature_source == "unknown"
    assert model.validity.temperature_min_c is None


def test_the_achievable_set_is_that_of_traced_lenses(tables):
    reach = calibration_file(tables, IDENTITY).achievable
    row = next(zoom for zoom in reach.zooms if zoom.zoom == 3200)
    near, far = (lens_at(3200, focus).sharp_from_pupil_mm() for focus in (8000, 0))
    assert row.sharp_near_mm == pytest.approx(near, rel=0.003)
    assert row.sharp_far_mm == pytest.approx(far, rel=0.03)
    assert row.d_high_mm == pytest.approx(25 + 1.2, abs=0.01)
    assert reach.x_per_step_mm == pytest.approx(1.375e-4, rel=0.1)


def test_the_hash_follows_the_numbers_and_not_their_order(good):
    shuffled = replace(good, nodes=list(reversed(good.nodes)))
    other = replace(good, nodes=list(good.nodes)[:-1])
    assert shuffled.digest() == good.digest()
    assert other.digest() != good.digest()


def few(seed=1, **noise):
    """Three zooms, three focuses: enough for a verdict."""
    grid = {"zooms": ZOOMS[[0, 3, 7]], "focuses": FOCUSES[::3], **noise}
    return nodes(np.random.default_rng(seed), **grid)


def blurred(rng, share):
    return {int(s): Measured(float(pupil(s)), share * float(pupil(s))) for s in IRISES}


CASES = {
    "noisy pictures": (
        lambda good, rng: {"nodes": few(f_cal_sd=0.06)},
        "no-go",
        {"d-uncertain", "d-against-depth-of-focus", "pupil-offset-uncertain"},
    ),
    "vague sharp distances": (
        lambda good, rng: {"nodes": few(sharp_share=0.15)},
        "marginal",
        {"d-uncertain", "d-against-depth-of-focus"},
    ),
    "two focuses close together": (
        lambda good, rng: {"nodes": few(focuses=FOCUSES[:2], sharp_share=0.1)},
        "marginal",
        {"d-uncertain", "interpolation-untested"},
    ),
    "one side only": (
        lambda good, rng: {"hysteresis": {}},
        "marginal",
        {"hysteresis-not-measured"},
    ),
    "no thermometer": (
        lambda good, rng: {"conditions": Conditions(), "nodes": good.nodes},
        "go",
        {"temperature-unknown"},
    ),
    "sides mixed up": (
        lambda good, rng: {"hysteresis": {**good.hysteresis, "focus": sides(rng, -40)}},
        "no-go",
        {"sides-swapped"},
    ),
    "two zooms": (
        lambda good, rng: {"nodes": few(zooms=ZOOMS[[0, -1]])},
        "marginal",
        {"interpolation-untested"},
    ),
    "vague blur": (
        lambda good, rng: {"iris": blurred(rng, 0.05)},
        "marginal",
        {"iris-uncertain"},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_with_the_data_is_named(good, case):
    change, grade, codes = CASES[case]
    changed = change(good, np.random.default_rng(3))
    verdict = judge_lens(build_tables(replace(good, **{"nodes": few(), **changed})))
    assert verdict.grade == grade
    assert verdict.codes() >= codes
    assert all(cause.action for cause in verdict.causes)


def test_an_iris_that_turns_back_gives_no_file(good):
    short = nodes(np.random.default_rng(4), zooms=ZOOMS[::3], focuses=FOCUSES[::3])
    iris = {**good.iris, 300: Measured(3.9, 0.01)}
    tables = build_tables(replace(good, nodes=short, iris=iris))
    assert tables.table is None
    verdict = judge_lens(tables)
    assert verdict.grade == "no-go"
    outcome = without_table(tables, ())
    causes = {cause.code: cause.grade for cause in outcome.quality.causes}
    assert causes == {c.code: c.grade for c in verdict.causes if c.grade != "go"}
    assert outcome.quality.next_action == verdict.next_action
    assert outcome.document is None
    with pytest.raises(CalibrationError, match="rise or fall"):
        calibration_file(tables, IDENTITY)


def test_a_motor_measured_at_one_step_is_refused(good):
    one = {300: good.iris[300]}
    with pytest.raises(CalibrationError, match="iris at 1"):
        build_tables(replace(good, iris=one))


def test_a_lens_measured_at_one_zoom_is_a_lens_without_zoom(good):
    one = nodes(np.random.default_rng(5), zooms=ZOOMS[2:3], sharp_share=0.004)
    tables = build_tables(replace(good, nodes=one))
    assert judge_lens(tables).grade == "go"
    model = calibration_file(tables, IDENTITY)
    assert model.validity.zoom_steps == (ZOOMS[2], ZOOMS[2])
    assert model.achievable.f_per_step_mm == 0
    table = LensTable.from_calibration(model)
    found = table.setting(int(ZOOMS[2]), 4000, 300)
    assert found.d_mm == pytest.approx(focal(ZOOMS[2]) + extension(4000), rel=0.0005)
    back = table.steps(found.f_mm, found.d_mm, found.a_mm)
    assert (back.zoom, back.focus, back.iris) == (ZOOMS[2], 4000, 300)
    with pytest.raises(InputError, match="zoom step 0"):
        table.setting(0, 4000, 300)
    with pytest.raises(InputError, match="f = 12"):
        table.steps(12.0, found.d_mm, found.a_mm)
