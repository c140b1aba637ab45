"""A lens whose zoom changes more than f; the truth is a lens traced ray by ray."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.lens_table import (
    Conditions,
    LensIdentity,
    LensMeasurements,
    LensNode,
    Measured,
    build_tables,
    calibration_file,
    judge_lens,
)
from calibration.lens_table.left_out_zooms import left_out_zooms
from calibration.lens_table.lens_models import ZoomFreedom
from calibration.lens_table.nodes import NodeSet
from mvp.calibrated import LensTableCalibration
from mvp.geometry import Pose
from mvp.kinematics import MountedCamera
from mvp.optics import Intrinsics, LensTable, Sensor
from mvp.testing.paraxial_lens import ParaxialLens

ZOOMS = np.linspace(0, 3000, 5).astype(int)
FOCUSES = np.linspace(0, 8000, 5).astype(int)
IRISES = (0, 200, 400, 600)
STEADY = {
    "e_of": lambda f: 2.4,
    "shift_of": lambda f: 0.0,
    "centre_of": lambda f: (800.0, 600.0),
    "k1_of": lambda f: -0.05,
}
REAL = {
    "e_of": lambda f: 2.4 + 0.2 * (f - 8),
    "shift_of": lambda f: 0.01 * (f - 8),
    "centre_of": lambda f: (806.0 - 0.7 * f, 597.0 + 0.4 * f),
    "k1_of": lambda f: -0.10 + 0.004 * f,
}


def focal(step):
    return 8 * (25 / 8) ** (np.asarray(step) / 3000)


def d_of(truth, zoom, focus):
    f = float(focal(zoom))
    return f + 0.2 + 1.25e-4 * focus + truth["shift_of"](f)


def node(truth, zoom, focus, rng):
    f = float(focal(zoom))
    lens = ParaxialLens.thin(
        f_mm=f, d_mm=d_of(truth, zoom, focus), e_mm=truth["e_of"](f), a_mm=1.0
    )
    f_cal, sharp = float(lens.scale(99.0)) * 99.0, lens.sharp_from_pupil_mm()
    sigma = np.array([0.002, 0.35, 0.35, 0.003 / f_cal**2])
    values = [f_cal, *truth["centre_of"](f), truth["k1_of"](f) / f_cal**2]
    seen = Measured(sharp * (1 + rng.normal(0, 0.005)), 0.005 * sharp)
    return LensNode(
        int(zoom),
        int(focus),
        values + sigma * rng.normal(0, 1, 4),
        np.diag(sigma**2),
        seen,
    )


def tables_of(truth, seed, *, zooms=ZOOMS):
    rng = np.random.default_rng(seed)
    nodes = [node(truth, zoom, focus, rng) for zoom in zooms for focus in FOCUSES]
    iris = {s: Measured(0.4 * 10 ** (s / 600), 0.002) for s in IRISES}
    return build_tables(
        LensMeasurements(nodes, iris, 0.0135, conditions=Conditions(21.0, "operator"))
    )


@pytest.fixture(scope="module")
def real():
    return tables_of(REAL, 1)


def by_zoom(tables):
    return tables.by_zoom.curves


def test_a_steady_lens_has_no_curves_and_the_file_of_before():
    tables = tables_of(STEADY, 2)
    assert not by_zoom(tables)
    model = calibration_file(tables, LensIdentity("L", "2026-01-01"))
    assert model.by_zoom is None
    assert tables.table.by_zoom is None


def test_whatever_the_zoom_changes_is_within_the_stated_intervals(real):
    fit = real.fit
    f = focal(fit.seen.zoom_steps)
    e_off = fit.e_of_zoom_mm - REAL["e_of"](f)
    assert (np.abs(e_off) < 3 * fit.e_of_zoom_sigma_mm).all()
    assert fit.e_sigma_mm < 0.2
    truth = [d_of(REAL, n.zoom, n.focus) for n in fit.seen.nodes]
    assert (np.abs(fit.d_mm - truth) < 3.5 * fit.d_sigma_mm).all()
    assert (np.abs(fit.d_mm - truth) < 0.0005 * np.array(truth)).all()
    for name, wanted in (
        ("centre_x_px", REAL["centre_of"](f)[0]),
        ("centre_y_px", REAL["centre_of"](f)[1]),
        ("k1", REAL["k1_of"](f)),
    ):
        nodes = by_zoom(real)[name].nodes
        assert (np.abs(nodes.values_mm - wanted) < 3.5 * nodes.sigma_mm).all()


def test_such_a_lens_is_not_refused(real):
    verdict = judge_lens(real)
    assert verdict.codes() >= {
        "zoom-changes-e",
        "zoom-changes-focus",
        "zoom-changes-centre",
        "zoom-changes-k1",
    }
    grades = {c.code: c.grade for c in verdict.causes}
    assert {c for c, grade in grades.items() if grade == "marginal"} == {
        "hysteresis-not-measured"
    }
    assert "no-go" not in grades.values()
    assert all(cause.action for cause in verdict.causes)


def test_the_planner_reads_what_the_zoom_changes_also_between_zooms(real):
    model = calibration_file(real, LensIdentity("L", "2026-01-01"))
    again = LensTableCalibration.model_validate_json(
        model.model_dump_json(by_alias=True)
    )
    assert again == model
    table = LensTable.from_calibration(again)
    for zoom, focus in ((300, 1000), (1100, 5000), (2600, 7000)):
        f, found = float(focal(zoom)), table.setting(zoom, focus, 300)
        assert found.d_mm == pytest.approx(d_of(REAL, zoom, focus), rel=0.0007)
        assert found.e_mm == pytest.approx(REAL["e_of"](f), abs=0.15)
        np.testing.assert_allclose(found.centre_px, REAL["centre_of"](f), atol=0.8)
        assert found.k1 == pytest.approx(REAL["k1_of"](f), abs=0.006)
        back = table.steps(found.f_mm, found.d_mm, found.a_mm)
        assert abs(back.zoom - zoom) <= 1
        assert abs(back.focus - focus) <= 1
        here = table.at_focal_length(found.f_mm)
        same = here.setting(zoom, focus, 300)
        assert same.d_mm == pytest.approx(found.d_mm, abs=1e-9)
        assert same.e_mm == pytest.approx(found.e_mm, abs=1e-9)
        assert table.d_range_mm(found.f_mm) == pytest.approx(
            here.d_range_mm(found.f_mm)
        )
    for name, error in again.by_zoom.left_out.items():
        assert error < 4 * again.by_zoom.standard_deviation[name]


def test_a_focus_that_the_zoom_stretches_is_not_believed_to_be_known():
    """No table of one shift for each zoom holds it; what is stated covers the error."""
    stretched = {**STEADY, "e_of": lambda f: 2.4}
    rng = np.random.default_rng(3)
    nodes = [node(stretched, zoom, focus, rng) for zoom in ZOOMS for focus in FOCUSES]

    def d_stretched(zoom, focus):
        f = float(focal(zoom))
        return f + (0.2 + 1.25e-4 * focus) * (1 + 0.01 * (f - 8))

    for i, one in enumerate(nodes):
        f = float(focal(one.zoom))
        lens = ParaxialLens.thin(
            f_mm=f, d_mm=d_stretched(one.zoom, one.focus), e_mm=2.4, a_mm=1.0
        )
        sharp = lens.sharp_from_pupil_mm() * (1 + rng.normal(0, 0.005))
        values = one.values.copy()
        values[0] = float(lens.scale(99.0)) * 99.0 + rng.normal(0, 0.002)
        nodes[i] = LensNode(
            one.zoom,
            one.focus,
            values,
            one.covariance,
            Measured(sharp, 0.005 * sharp),
        )
    iris = {s: Measured(0.4 * 10 ** (s / 600), 0.002) for s in IRISES}
    tables = build_tables(LensMeasurements(nodes, iris, 0.0135))
    verdict = judge_lens(tables)
    assert "one-table" in verdict.codes()
    assert verdict.grade == "no-go"
    truth = [d_stretched(n.zoom, n.focus) for n in tables.fit.seen.nodes]
    assert (np.abs(tables.fit.d_mm - truth) < 3 * tables.fit.d_sigma_mm).all()


def test_a_pupil_that_the_zoom_moves_takes_the_hand_eye_along():
    model = calibration_file(tables_of(STEADY, 2), LensIdentity("L", "2026-01-01"))
    moved = {"steps": [0, 3000], "pupil_shift_mm": [1.0, 4.0]}
    model = LensTableCalibration.model_validate(
        {**model.model_dump(by_alias=True), "by_zoom": moved}
    )
    table = LensTable.from_calibration(model)
    at = table.setting(1500, 4000, 300), table.setting(3000, 4000, 300)
    eye = Pose("tool", "camera", np.eye(3), np.array([1.0, 2.0, 90.0]))
    own = Intrinsics(Sensor(1600, 1200, 0.0055, 0.0055), 799.5, 599.5)
    mounted = MountedCamera(own, table, eye, at[0].d_mm, at[0].f_mm)
    same, other = (mounted.tool_from_camera_at(lens) for lens in at)
    np.testing.assert_allclose(same.matrix, eye.matrix, atol=1e-9)
    shift = other.translation_mm[2] - same.translation_mm[2]
    assert shift == pytest.approx(at[1].d_mm - at[0].d_mm + 1.5, abs=1e-6)
    assert mounted.intrinsics_at(20.0) == own


def test_a_zoom_with_two_settings_close_together_leans_on_the_others():
    """As an arm in a cell can see them: no zoom has all focuses, the long one has two."""
    pairs = [(0, 0, 1, 2), (750, 0, 1, 2), (1500, 1, 2, 3), (2250, 2, 3, 4)]
    pairs.append((3000, 3, 4))
    linear = {
        **STEADY,
        "e_of": lambda f: 2.0 + 1.5 * np.log(f / 8),
        "shift_of": lambda f: 0.07 * np.log(f / 8),
    }
    rng = np.random.default_rng(4)
    nodes = [
        node(linear, zoom, FOCUSES[k], rng) for zoom, *which in pairs for k in which
    ]
    iris = {s: Measured(0.4 * 10 ** (s / 600), 0.002) for s in IRISES}
    tables = build_tables(LensMeasurements(nodes, iris, 0.0135))
    fit = tables.fit
    assert fit.freedom.own_e <= 2
    assert fit.freedom.shifted <= 2
    assert fit.freedom
    truth = np.array([d_of(linear, n.zoom, n.focus) for n in fit.seen.nodes])
    assert (np.abs(fit.d_mm - truth) < 3 * fit.d_sigma_mm).all()
    assert (fit.d_sigma_mm < 0.002 * truth).all()
    e_off = fit.e_of_zoom_mm - linear["e_of"](focal(fit.seen.zoom_steps))
    assert (np.abs(e_off) < 3 * fit.e_of_zoom_sigma_mm).all()
    assert "no-go" not in judge_lens(tables).grade


def nodes_of(truth, seed):
    rng = np.random.default_rng(seed)
    return NodeSet.of(
        [node(truth, zoom, focus, rng) for zoom in ZOOMS for focus in FOCUSES]
    )


LINE = {**STEADY, "e_of": lambda f: 2.4 + 0.08 * (f - 8)}
CURVED = {**STEADY, "e_of": lambda f: 2.4 + 0.6 * np.sin((f - 8) / 2.2)}


def test_a_zoom_that_was_left_out_tells_whether_a_low_degree_does():
    scored = []
    for seed in range(3):
        seen = nodes_of(LINE, seed)
        found = left_out_zooms(seen, None, ZoomFreedom(own_e=2), "pupil_offset_mm")
        assert len(found[0]) == len(ZOOMS) - 2
        scored.append(found[1])
    assert 0.4 < np.sqrt(np.mean(np.square(scored))) < 1.6
    wrong = left_out_zooms(
        nodes_of(CURVED, 0), None, ZoomFreedom(own_e=1), "pupil_offset_mm"
    )
    assert wrong[1] > 5
    truth = CURVED["e_of"](focal(ZOOMS))
    straight = np.polyfit(ZOOMS[[0, 1, 3, 4]], truth[[0, 1, 3, 4]], 1)
    miss = np.polyval(straight, ZOOMS[2]) - truth[2]
    assert wrong[0][1] == pytest.approx(miss, abs=0.25)


def test_a_shift_that_is_a_line_over_the_zoom_is_left_out_too():
    seen = nodes_of({**STEADY, "shift_of": lambda f: 0.01 * (f - 8)}, 2)
    freedom = ZoomFreedom(shifted=2)
    errors, sigmas = left_out_zooms(seen, None, freedom, "focus_shift_mm")
    assert len(errors) == len(ZOOMS) - 2
    assert np.abs(errors).max() < 0.01
    assert sigmas < 2


def test_too_few_zooms_to_leave_one_out_are_no_error():
    seen = nodes_of(LINE, 0)
    two = NodeSet.of([n for n in seen.nodes if n.zoom in ZOOMS[[0, 4]]])
    found = left_out_zooms(two, None, ZoomFreedom(own_e=1), "pupil_offset_mm")
    assert len(found[0]) == 0
