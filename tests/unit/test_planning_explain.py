"""Why nothing is admissible: who conflicts, and cures that work when applied."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvp.constraints import Visibility
from mvp.geometry import Box
from mvp.planning import (
    Amount,
    Attempt,
    Explanation,
    LensBounds,
    attempt,
    evaluate,
    explain,
    relaxed,
    solve,
)
from mvp.planning.blockers import blocking_faces
from mvp.planning.rows import RowTable
from mvp.testing.clutter_scene import ClutterBox, clutter_scene
from mvp.testing.planning_scenes import (
    IMAGE_DIAMETER_MM,
    PlanningScene,
    paper_view,
    race_scene,
)
from mvp.visibility import prepare, visibility_region

if TYPE_CHECKING:
    from mvp.planning.problem import PlanningProblem


SEED = 1


@cache
def race() -> PlanningScene:
    return race_scene()


def _lens(low: float, high: float, a_mm: float = 0.78125) -> LensBounds:
    return LensBounds.of(f_mm=12.5, d_mm=(low, high), a_mm=a_mm)


@cache
def too_far_focus() -> tuple[PlanningProblem, Attempt, Explanation]:
    problem = race().problem(
        stricter=6, lens=_lens(12.75, 12.80), starts=8, candidates=20_000
    )
    failed = attempt(problem, seed=SEED)
    return problem, failed, explain(problem, failed, seed=SEED)


@cache
def too_near_focus() -> tuple[PlanningProblem, Attempt, Explanation]:
    return _too_near_focus(ClutterBox(hole_sides=8), starts=6, candidates=10_000)


def _too_near_focus(
    sizes: ClutterBox, *, starts: int, candidates: int
) -> tuple[PlanningProblem, Attempt, Explanation]:
    problem = clutter_scene(sizes).problem(
        lens=_lens(14.6, 15.0, a_mm=3.125), starts=starts, candidates=candidates
    )
    failed = attempt(problem, seed=SEED)
    return problem, failed, explain(problem, failed, seed=SEED)


def test_the_conflict_names_the_lens_bound_and_the_requirements_that_meet():
    _, failed, why = too_far_focus()
    assert failed.solutions[0].status == "infeasible"
    assert failed.solutions[0].t == pytest.approx(-12.4, abs=0.1)
    weight = {c.name: c.weight for c in why.conflicts}
    assert set(weight) == {
        "d_max",
        "focus_near",
        "resolution",
        "visibility",
        "field_of_view",
    }
    assert weight["focus_near"] == pytest.approx(0.68, abs=0.03)
    assert weight["resolution"] == pytest.approx(0.14, abs=0.03)
    assert "focus cannot be set closer than d = 12.800 mm" in why.reason
    assert "focus near, resolution, " in why.reason
    assert " cannot be kept together: " in why.reason
    assert "lens range is the cause" in why.reason
    assert "20000 candidates" in why.searched


def test_the_dual_of_a_lens_bound_is_what_a_wider_bound_gains():
    problem, failed, why = too_far_focus()
    wider = replace(problem, lens=_lens(12.75, 12.801))
    gain = attempt(wider, seed=SEED).solutions[0].t - failed.solutions[0].t
    dual = next(c.weight for c in why.conflicts if c.name == "d_max")
    assert gain / 0.001 == pytest.approx(dual, rel=0.05)


def test_the_smallest_relaxations_are_found_in_the_users_words():
    _, _, why = too_far_focus()
    cures = {cure.kind: cure for cure in why.cures}
    assert cures["resolution"].value == pytest.approx(0.625, abs=0.015)
    assert "ask 3.7 px instead of 6 px per detail" in cures["resolution"].text
    assert "a detail of 4.1 mm instead of 2.54 mm" in cures["resolution"].text
    assert 1e3 * 0.0135 * cures["blur"].value == pytest.approx(34.2, rel=0.02)
    assert "c = 34 um instead of 13.5" in cures["blur"].text
    assert cures["lens"].value > 12.80
    assert "instead of 12.800" in cures["lens"].text
    assert "visibility" in why.no_help
    assert why.fix


@pytest.mark.parametrize("example", [too_far_focus, too_near_focus])
def test_every_cure_makes_the_task_possible_when_planned_again(example):
    _, _, why = example()
    assert why.cures
    for cure in why.cures:
        assert cure.index >= 0
        assert evaluate(cure.problem, cure.view).status == "admissible"
        again = replace(cure.problem, starts=4, candidates=5_000, user_starts=cure.view)
        assert solve(again, seed=3)[0].status == "admissible"


def test_a_slightly_smaller_relaxation_does_not_help():
    problem, _, why = too_far_focus()
    factor = next(c.value for c in why.cures if c.kind == "resolution")
    almost = relaxed(problem, Amount("resolution", 1.03 * factor))
    start = next(c.view for c in why.cures if c.kind == "resolution")
    again = replace(almost, user_starts=start, starts=4, candidates=10_000)
    assert solve(again, seed=0)[0].status == "infeasible"


def test_the_nearest_view_is_plain_data_for_the_plan():
    _, _, why = too_far_focus()
    data = why.nearest_data
    assert data["smallest_index"] == why.nearest.t
    assert len(data["position_mm"]) == 3
    assert data["d_mm"] == pytest.approx(12.8)


def test_a_fast_lens_that_only_focuses_near_cannot_hold_both_ends_sharp():
    _, failed, why = too_near_focus()
    assert failed.solutions[0].status == "infeasible"
    assert failed.solutions[0].t == pytest.approx(-1.8, abs=0.4)
    weight = {c.name: c.weight for c in why.conflicts}
    assert set(weight) == {
        "d_min",
        "focus_near",
        "focus_far",
        "visibility",
        "field_of_view",
    }
    assert weight["focus_far"] == pytest.approx(0.48, abs=0.08)
    assert weight["focus_near"] == pytest.approx(0.42, abs=0.08)
    assert weight["visibility"] < 0.15
    assert weight["field_of_view"] < 0.15
    assert "focus cannot be set farther than d = 14.600 mm (sharp at 87" in why.reason
    assert "lens range is the cause" in why.reason


def test_what_helps_the_fast_lens_is_said_in_the_users_words():
    _, _, why = too_near_focus()
    cures = {cure.kind: cure for cure in why.cures}
    assert set(cures) == {"lens", "blur", "field_of_view"}
    assert cures["lens"].value < 14.6
    assert "needs d down to" in cures["lens"].text
    assert "instead of 14.600" in cures["lens"].text
    # Near and far share one c, so that less is needed than where one gives way alone.
    assert 13.5 < 13.5 * cures["blur"].value < 38.7
    assert "um instead of 13.5" in cures["blur"].text
    assert "mm wide instead of 6.47" in cures["field_of_view"].text
    assert set(why.no_help) == {"resolution", "visibility"}


def test_the_field_that_helps_the_fast_lens_is_wider_by_the_features_own_size():
    """The camera looks level from above: the features lie at the picture's edge."""
    _, _, why = too_near_focus()
    cure = next(cure for cure in why.cures if cure.kind == "field_of_view")
    wider_mm = (cure.value - 1) * IMAGE_DIAMETER_MM
    at_part_mm = wider_mm * 86.9 / float(cure.view.f_cal_mm[0])
    assert at_part_mm == pytest.approx(36, abs=8)


@pytest.mark.full
def test_round_holes_change_nothing_about_the_fast_lens():
    _, failed, why = _too_near_focus(ClutterBox(), starts=24, candidates=40_000)
    assert failed.solutions[0].t == pytest.approx(-1.8, abs=0.4)
    assert {cure.kind for cure in why.cures} == {"lens", "blur", "field_of_view"}
    assert set(why.no_help) == {"resolution", "visibility"}


@pytest.mark.full
def test_a_lens_that_cannot_focus_near_enough_is_named_as_the_cause():
    problem = race().problem(
        stricter=14, lens=_lens(12.6, 13.2), starts=24, candidates=40_000
    )
    failed = attempt(problem, seed=0)
    why = explain(problem, failed, seed=0)
    assert why.nearest.t == pytest.approx(-20.9, abs=0.2)
    weight = {c.name: c.weight for c in why.conflicts}
    assert set(weight) == {
        "d_max",
        "focus_near",
        "visibility",
        "resolution",
        "field_of_view",
    }
    assert weight["focus_near"] == pytest.approx(0.70, abs=0.03)
    assert weight["visibility"] == pytest.approx(0.16, abs=0.04)
    cures = {cure.kind: cure for cure in why.cures}
    assert "lens range is the cause" in why.reason
    assert 13.5 * cures["blur"].value == pytest.approx(61.7, rel=0.03)
    assert "visibility" in why.no_help
    lifted = replace(problem, lens=_lens(12.6, 15.0))
    assert solve(lifted, seed=0)[0].t == pytest.approx(4.6, abs=0.2)


def test_an_admissible_view_close_to_failing_is_warned_about():
    problem = race().problem(
        stricter=3,
        lens=_lens(12.6, 15.0, a_mm=8.0),
        circle_of_confusion_mm=0.0055,
        starts=12,
        candidates=20_000,
    )
    best = solve(problem, seed=0)[0]
    assert best.status == "admissible"
    assert best.t == pytest.approx(0.33, abs=0.03)
    table = RowTable.of(problem)
    weight = {k: best.duals.rows[table.mask(k)].sum() for k in best.margins}
    assert weight["focus_near"] == pytest.approx(0.5, abs=0.05)
    assert weight["focus_far"] == pytest.approx(0.5, abs=0.05)
    assert any("standard deviations from failing" in note for note in best.notes)


def test_features_that_are_seen_from_nowhere_are_explained_by_what_hides_them():
    scene = race()
    box = Box(np.array([-650.0, -650.0, -650.0]), np.array([650.0, 650.0, -30.0]))
    pieces = [piece for edge in scene.edges for piece in edge.sight_pieces()]
    region = visibility_region(prepare(scene.mesh), pieces, box)
    problem = scene.problem(starts=4, candidates=5_000)
    blind = replace(
        problem,
        constraints=(*problem.constraints[:-1], Visibility(region)),
        workspace=box,
    )
    failed = attempt(blind, seed=0)
    assert failed.solutions == ()
    why = explain(blind, failed, seed=0)
    assert why.nearest is None
    assert why.nearest_data == {}
    assert "no place in the workspace sees the features whole" in why.reason
    assert "hide" in why.reason
    assert "split the features" in why.fix
    alone = explain(blind, failed, seed=0, splittable=False)
    assert alone.fix == "give a larger workspace or move what is in the way"


def test_the_face_that_blocks_a_view_is_named():
    view = paper_view(
        np.array([-200.0, -200.0, 300.0]), np.array([1.0, 1.0, -1.5]), 13.0
    )
    problem = race().problem()
    names = blocking_faces(problem, view, lambda face: f"face {face} of the overhang")
    assert names
    assert all(name.endswith("of the overhang") for name in names)


def test_an_admissible_attempt_is_not_explained():
    problem = race().problem(starts=2, candidates=3_000)
    with pytest.raises(ValueError, match="nothing to explain"):
        explain(problem, attempt(problem, seed=0), seed=0)
