"""A search that is told what is good enough ends there, by the same rows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mvp.planning import LensBounds, solve
from mvp.planning.candidates import aimed, glance, orbit_positions
from mvp.planning.distances import distance_bounds_mm
from mvp.planning.rows import RowTable
from mvp.testing.planning_scenes import race_scene, table_views


@cache
def race():
    return race_scene()


@pytest.mark.parametrize(("name", "goal"), [("paper", 9.5), ("tight", 6.7), ("fa", 9)])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_view_is_as_good_as_asked_by_an_independent_evaluation(name, goal, seed):
    problem = race().problem(name)
    (found,) = solve(problem, seed=seed, stop_at_index=goal)
    table = RowTable.of(problem)
    assert found.t >= goal
    assert table.worst(table.evaluate(found.view).index)[0] >= goal - 1e-6
    assert found.status == "admissible"


def test_the_same_seed_stops_at_the_same_view():
    problem = race().problem("tight")
    first, second = (solve(problem, seed=3, stop_at_index=6.0)[0] for _ in range(2))
    assert np.array_equal(first.view.position_mm, second.view.position_mm)


def test_what_nobody_reaches_ends_as_without_a_goal():
    problem = race().problem("tight", starts=2, candidates=2_000)
    found = solve(problem, seed=0, stop_at_index=1e3)
    assert found[0].stage in ("max-min", "second stage")
    assert 0 < found[0].t < 1e3


def test_progress_hears_when_the_view_is_held():
    told: list[str] = []
    solve(
        race().problem(),
        seed=0,
        progress=lambda stage, share: told.append(stage),
        stop_at_index=5.0,
    )
    assert told == ["first look", "description", "done"]


def test_only_a_persons_starts_are_searched_from_where_only_they_are_asked_for():
    problem = race().problem(starts=0, user_starts=table_views()["V_f"])
    (found,) = solve(problem, seed=0, stop_at_index=7.0)
    assert found.start == "start 1"
    assert found.first_stage_t >= 7.0


@pytest.mark.parametrize("e_mm", [0.0, 2.4])
@pytest.mark.parametrize("name", ["paper", "tight", "rect", "fa"])
def test_no_admissible_view_lies_outside_the_distance_bounds(name, e_mm):
    scene = race()
    problem = scene.problem(name)
    problem = replace(problem, lens=replace(problem.lens, e_mm=e_mm))
    low, high = distance_bounds_mm(problem)
    rng = np.random.default_rng(0)
    views = aimed(problem, orbit_positions(problem, 20_000, rng), rng)
    good = RowTable.of(problem).curved_index(views).min(axis=1) >= 0
    gap = views.position_mm[good] - problem.target_centre_mm
    distance = np.linalg.norm(gap, axis=1)
    assert len(distance) > 50
    assert low <= distance.min()
    assert distance.max() <= high
    # Bounds that bind: not more than a third of the way in the dark.
    assert distance.min() < 1.5 * low


def test_a_lens_that_cannot_do_it_leaves_no_distance_but_candidates_all_the_same():
    lens = LensBounds.of(f_mm=12.5, d_mm=(12.75, 12.80), a_mm=0.78125)
    problem = race().problem(stricter=6, lens=lens, starts=3, candidates=500)
    low, high = distance_bounds_mm(problem)
    assert low > high
    table = RowTable.of(problem)
    seen = glance(problem, table, np.random.default_rng(0), (low, high))
    assert len(seen.views)
    assert (np.diff(seen.worst) <= 0).all()


def test_candidates_are_spread_evenly_over_directions_and_distances():
    problem = race().problem()
    points = orbit_positions(problem, 4_000, np.random.default_rng(0))
    offset = points - problem.target_centre_mm
    distance = np.linalg.norm(offset, axis=1)
    octant = (offset > 0) @ np.array([1, 2, 4])
    share = np.log(distance / distance.min()) / np.log(distance.max() / distance.min())
    cells = np.bincount(octant * 4 + np.minimum((4 * share).astype(int), 3))
    assert len(cells) == 32
    # Independent draws would scatter by 11 (one standard deviation).
    assert np.abs(cells - 125).max() <= 11
