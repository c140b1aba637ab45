"""The paper's weighted sum ends at admissible KKT points, checked from outside."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import nnls

from mvp.planning import PAPER_1, PAPER_2, PRESETS, evaluate, solve_paper
from mvp.planning.chart import Chart
from mvp.planning.paper_objective import paper_merit
from mvp.planning.paper_table import PaperTable
from mvp.testing.planning_scenes import PlanningScene, race_scene, table_views

_ACTIVE = 1e-4


@cache
def race() -> PlanningScene:
    return race_scene()


def _kkt_residual(problem, weights, view) -> tuple[float, float]:
    """Norm of the best combination of gradients, relative, and its complementarity.

    Unknowns >= 0: shares of the rows of each term (they sum to 1), multipliers of the
    constraints that are active, and of active bounds of d. Slopes are differences of
    the table's own values along the chart, so only the retraction is shared.
    """
    table, chart = PaperTable.of(problem, weights), Chart.of(problem)
    merit = paper_merit(table)
    value = table.linearise(view, chart)
    rows, slope = value.index[0], value.slope[0] * chart.shape
    columns, sums = [], []
    for g in range(len(merit.caps)):
        member = np.flatnonzero(merit.groups == g)
        close = member[rows[member] <= rows[member].min() + _ACTIVE]
        for i in close:
            columns.append(slope[i])
            sums.append(np.eye(len(merit.caps))[g])
    none = np.zeros(len(merit.caps))
    for i in np.flatnonzero(rows - merit.floors <= _ACTIVE):
        columns.append(slope[i])
        sums.append(none)
    by_d = value.jacobian[0, 6] * chart.shape
    for side, gap in ((by_d, view.d_mm[0] - 12.6), (-by_d, 15.0 - view.d_mm[0])):
        if gap < 1e-6:
            columns.append(side)
            sums.append(none)
    strong = 1e3
    matrix = np.vstack([np.array(columns).T, strong * np.array(sums).T])
    target = np.concatenate([np.zeros(chart.n), strong * np.ones(len(merit.caps))])
    weights_found, residual = nnls(matrix, target)
    size = np.linalg.norm(np.array(columns) * weights_found[:, None], axis=1).sum()
    return float(residual / size), float(rows.min())


def test_the_presets_are_those_of_the_experiments():
    assert PRESETS["paper-1"] == PAPER_1
    assert (PAPER_1.resolution, PAPER_1.near, PAPER_1.field) == (1e3, 1e-2, 1e-1)
    assert (PAPER_2.resolution, PAPER_2.far, PAPER_2.field) == (1e2, 1e-2, 1.0)
    assert (PAPER_1.visibility, PAPER_2.visibility) == (0.0, 1.0)


@pytest.mark.parametrize("preset", ["paper-1", "paper-2"])
def test_the_weighted_sum_ends_at_an_admissible_kkt_point(preset):
    start = table_views()["V_i"]
    problem = race().problem(candidates=10_000, user_starts=start)
    best = solve_paper(problem, PRESETS[preset], seed=0)[0]
    assert best.admissible
    assert best.kept == "final"
    assert best.stationarity < 1e-4
    residual, worst = _kkt_residual(problem, PRESETS[preset], best.view)
    assert residual < 1e-3
    assert worst > -1e-6
    assert evaluate(problem, best.view).t > -1e-6


def test_d_stays_away_from_the_hyperfocal_setting_because_d1_is_capped():
    start = table_views()["V_f1"]
    problem = race().problem(candidates=5_000, user_starts=start)
    best = solve_paper(problem, PAPER_2, seed=0)[0]
    hyperfocal = 12.5 + 0.0135 * 12.5 / 0.78125
    assert best.view.d_mm[0] > hyperfocal + 0.01
    table = PaperTable.of(problem, PAPER_2)
    rows = table.index(best.view)[0]
    far = rows[[kind == "focus_far" for kind in table.kinds]]
    assert far.max() <= PAPER_2.far * problem.farthest_mm


def test_the_sum_is_the_one_of_the_paper():
    problem = race().problem()
    table = PaperTable.of(problem, PAPER_2)
    view = table_views()["V_f"]
    rows = table.index(view)[0]
    terms = {
        kind: rows[[k == kind for k in table.kinds]].min() for kind in set(table.kinds)
    }
    assert terms["focus_near"] == pytest.approx(1e-2 * 138.77, rel=1e-3)
    assert terms["focus_far"] == pytest.approx(1e-2 * 99.47, rel=1e-3)
    assert terms["visibility"] == pytest.approx(11.41, abs=0.01)
    total = paper_merit(table).group_values(rows[None]).sum()
    edges = total - sum(v for k, v in terms.items() if k != "resolution")
    assert edges >= 2 * terms["resolution"]


def test_experiment_one_keeps_the_best_admissible_iterate():
    start = table_views()["V_i"]
    problem = race().problem(candidates=10_000, user_starts=start)
    checked = solve_paper(problem, PAPER_1, seed=0, visibility="checked")[0]
    if checked.admissible:
        assert evaluate(problem, checked.view).t > -1e-6
    from_inside = replace(problem, user_starts=table_views()["V_f1"])
    kept = solve_paper(from_inside, PAPER_1, seed=0, visibility="checked")[0]
    assert kept.admissible
    assert kept.kept == "iterate"
    assert evaluate(from_inside, kept.view).t > -1e-6
    first = PaperTable.of(problem, PAPER_1)
    begin = paper_merit(first).group_values(first.index(table_views()["V_f1"])).sum()
    assert kept.value >= begin


def test_its_optimum_lies_on_constraints_that_the_default_keeps_away_from():
    start = table_views()["V_i"]
    problem = race().problem("tight", candidates=10_000, user_starts=start)
    best = solve_paper(problem, PAPER_2, seed=0)[0]
    assert best.admissible
    assert evaluate(problem, best.view).t < 1.0
