"""Linear programmes, sensitivity, extension tubes, problem data, reports."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mvp.constraints import SHIFT, TURN, Visibility
from mvp.geometry import Box
from mvp.optics import LensTable
from mvp.planning import (
    LensBounds,
    PlanningProblem,
    Uncertainty,
    evaluate,
    sensitivity,
    tube_needed,
)
from mvp.planning.chance import perturbed
from mvp.planning.components import component_numbers
from mvp.planning.linear import HighsSolver, Programme, ScipySolver
from mvp.planning.rows import RowTable
from mvp.testing.planning_scenes import PlanningScene, race_scene, table_views
from mvp.visibility import prepare, visibility_region


@cache
def race() -> PlanningScene:
    return race_scene()


def test_both_linear_solvers_agree_on_optimum_and_duals():
    rng = np.random.default_rng(0)
    highs, scipy = HighsSolver(), ScipySolver()
    for _ in range(20):
        rows = np.hstack([rng.normal(size=(30, 6)), -np.ones((30, 1))])
        low = -rng.uniform(0, 3, 30)
        cost = np.array([0.0] * 6 + [1.0])
        box = np.array([0.1] * 6 + [1e3])
        programme = Programme(cost, rows, low, -box, box)
        a, b = highs.maximise(programme), scipy.maximise(programme)
        assert cost @ a.x == pytest.approx(cost @ b.x, abs=1e-9)
        assert a.row_duals.sum() == pytest.approx(-1.0, abs=1e-6) or np.abs(
            a.row_duals
        ).sum() == pytest.approx(1.0, abs=1e-6)
        assert np.allclose(np.abs(a.row_duals), np.abs(b.row_duals), atol=1e-7)


def test_a_linear_programme_without_a_solution_says_so():
    rows, low = np.array([[1.0], [-1.0]]), np.array([1.0, 1.0])
    for solver in (HighsSolver(), ScipySolver()):
        programme = Programme(np.ones(1), rows, low, -np.ones(1), np.ones(1))
        assert solver.maximise(programme) is None


def _loss_by_trying(problem, view, part: slice, size: float) -> float:
    table = RowTable.of(problem)
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(4_000, part.stop - part.start))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    errors = np.zeros((len(direction), 9))
    errors[:, part] = size * direction
    worst = table.worst(table.index(perturbed(view, errors))).min()
    return float(table.worst(table.index(view))[0] - worst)


@pytest.mark.parametrize("name", ["V_f", "V_f1", "V_f2"])
def test_sensitivity_is_the_loss_that_the_worst_small_error_causes(name):
    problem, view = race().problem(), table_views()[name]
    told = sensitivity(problem, view)
    tried = {
        "position_1_mm": _loss_by_trying(problem, view, SHIFT, 1.0),
        "angle_1_deg": _loss_by_trying(problem, view, TURN, np.deg2rad(1.0)),
        "d_10_um": _loss_by_trying(problem, view, slice(6, 7), 0.01),
    }
    for key, loss in tried.items():
        assert told[key] == pytest.approx(loss, rel=0.12, abs=0.06), key


def _lens_table() -> LensTable:
    from mvp.calibrated.models import LensTableCalibration

    provenance = {"date": "2026-01-01", "device_serial": "1", "method": "made up"}

    def axis(low: float, high: float) -> dict[str, object]:
        return {"steps": [0, 500, 1000], "values_mm": [low, (low + high) / 2, high]}

    return LensTable.from_calibration(
        LensTableCalibration.model_validate(
            {
                "schema": "mvp-cell/lens-table/1",
                "provenance": provenance,
                "quality": {"verdict": "go"},
                "zoom_f_mm": axis(12.0, 13.0),
                "focus_extension_mm": axis(0.1, 0.4),
                "iris_a_mm": axis(0.5, 8.0),
            }
        )
    )


def test_the_plan_says_which_extension_tube_a_setting_needs():
    table = _lens_table()
    none = tube_needed(table, d_mm=12.75, f_mm=12.5, tubes_mm=(0.5, 1.0))
    assert (none.tube_mm, none.text) == (0.0, "")
    one = tube_needed(table, d_mm=13.25, f_mm=12.5, tubes_mm=(1.0, 0.5))
    assert one.tube_mm == 0.5
    assert "d = 13.250 mm needs the 0.5 mm extension tube" in one.text
    assert "from d = 12.600 to 12.900 mm" in one.text
    missing = tube_needed(table, d_mm=15.0, f_mm=12.5, tubes_mm=(0.5,))
    assert missing.tube_mm is None
    assert "needs a tube of about 2.10 mm" in missing.text
    below = tube_needed(table, d_mm=12.55, f_mm=12.5, tubes_mm=(0.5,))
    assert below.tube_mm is None
    assert "below its range" in below.text


def test_margins_are_given_in_the_units_of_the_plan():
    margins = evaluate(race().problem(), table_views()["V_f"]).margins
    assert {kind: m.unit for kind, m in margins.items()} == {
        "resolution": "px",
        "focus_near": "mm",
        "focus_far": "mm",
        "field_of_view": "deg",
        "visibility": "mm",
    }
    assert margins["focus_far"].value == pytest.approx(99.47, abs=0.1)
    assert margins["focus_far"].index == pytest.approx(5.95, rel=0.02)


def test_lens_bounds_and_problems_refuse_nonsense():
    with pytest.raises(ValueError, match="low <= high"):
        LensBounds.of(f_mm=12.5, d_mm=(15, 13), a_mm=1.0)
    with pytest.raises(ValueError, match="exceed f"):
        LensBounds.of(f_mm=12.5, d_mm=(10, 12), a_mm=1.0)
    problem = race().problem()
    with pytest.raises(ValueError, match="needs constraints"):
        PlanningProblem(
            (),
            problem.key_points_mm,
            problem.target_centre_mm,
            1.0,
            problem.lens,
            problem.workspace,
        )
    assert Uncertainty().scaled(2.0).sigma == pytest.approx(2 * Uncertainty().sigma)


def test_pieces_of_a_disconnected_region_are_numbered_by_size():
    scene = race()
    cut = Box(np.array([-650.0, -650.0, 80.0]), np.array([650.0, 650.0, 650.0]))
    pieces = [piece for edge in scene.edges for piece in edge.sight_pieces()]
    region = visibility_region(prepare(scene.mesh), pieces, cut)
    count = len(region.solid.decompose())
    problem = replace(scene.problem(), constraints=(Visibility(region),), workspace=cut)
    views = table_views()
    positions = np.concatenate(
        [views[n].position_mm for n in ("V_f", "V_f1", "V_f2", "V_i2")]
    )
    numbers = component_numbers(problem, positions)
    assert count > 1
    assert numbers[0] != numbers[1]
    assert numbers[1] == numbers[2]
    assert numbers[3] is None
    assert component_numbers(scene.problem(), positions[:1]) in ([None], [1], [2])
