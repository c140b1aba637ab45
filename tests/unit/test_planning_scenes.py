"""A cluttered box and a notch of a machined part: the search holds its bars there."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from mvp.geometry import edge_table
from mvp.planning import Attempt, ToleranceBox, attempt, certify, recheck, solve
from mvp.planning.candidates import inside, looking_at, orbit_positions
from mvp.planning.rows import RowTable
from mvp.planning.solve import searched
from mvp.testing.clutter_scene import ClutterBox, clutter_object, clutter_scene
from mvp.testing.notch_scene import notch_scene
from mvp.testing.planning_rivals import evolved, orbit_views
from mvp.testing.planning_scenes import PlanningScene, race_scene
from mvp.testing.tolerance_box import failures_on_surface, scaled_box
from mvp.visibility import Region, exactly_visible

# Holes with fewer sides than stated make the same region with fewer facets.
SCENES = {
    "clutter": lambda: clutter_scene(ClutterBox(hole_sides=12)),
    "round clutter": clutter_scene,
    "notch": notch_scene,
    "paper's object": race_scene,
}
NEW = ["clutter", "notch"]
FULL = ["round clutter", "notch"]
# The best known indices on scenes of the same description are 13.34 and 13.24.
UNIT = ToleranceBox(1.0, float(np.deg2rad(0.3)), 0.01)
BEST_INDEX = {"clutter": 13.3, "notch": 13.2}


@cache
def scene(name: str) -> PlanningScene:
    return SCENES[name]()


@cache
def default_search(name: str) -> Attempt:
    return attempt(scene(name).problem(), seed=0)


def test_the_box_has_fourteen_separate_holes_and_sixteen_pillars_apart_from_the_cube():
    sizes = ClutterBox()
    holes, pillars = sizes.hole_centres_mm, sizes.pillar_centres_mm
    assert holes.shape == (14, 2)
    assert pillars.shape == (16, 2)
    assert pdist(holes).min() > 2 * sizes.hole_radius_mm
    inner = sizes.half_width_mm - sizes.wall_mm
    assert np.abs(holes).max() + sizes.hole_radius_mm < inner
    assert np.abs(pillars).max() + sizes.pillar_radius_mm < inner
    assert sizes.floor_mm < sizes.pillar_top_mm < sizes.lid_mm


def test_the_box_is_one_closed_solid_through_which_its_holes_lead():
    mesh = clutter_object(ClutterBox(hole_sides=12))
    table = edge_table(mesh)
    assert table.regular.all()
    vertices = len(np.unique(mesh.faces))
    characteristic = vertices - len(table.faces) + len(mesh.faces)
    # Inside and outside are two spheres that 14 tubes join: genus 13.
    assert characteristic == 2 - 2 * 13


def _litres(region: Region) -> list[float]:
    return sorted((p.volume() / 1e6 for p in region.solid.decompose()), reverse=True)


def test_the_clutter_cuts_the_region_into_five_pieces():
    region = scene("clutter").region
    litres = _litres(region)
    assert litres[4] > 2 * litres[5]
    assert litres[5] < 0.05 < litres[4]
    assert region.mesh.vertices_mm[:, 2].min() >= ClutterBox().top_mm


@pytest.mark.full
def test_round_holes_give_the_region_as_many_facets_as_stated():
    region = scene("round clutter").region
    assert len(region.mesh.faces) == pytest.approx(1490, rel=0.15)
    litres = _litres(region)
    assert litres[4] > 2 * litres[5]


@pytest.mark.parametrize(
    ("name", "low", "high"), [("clutter", 0.04, 0.1), ("notch", 0.35, 0.55)]
)
def test_as_many_candidates_see_the_features_as_is_stated(name, low, high):
    problem = scene(name).problem()
    points = orbit_positions(problem, 20_000, np.random.default_rng(0))
    assert low < inside(problem, points).mean() < high


def test_the_notch_is_as_large_as_is_stated():
    problem = scene("notch").problem()
    assert 18 < problem.target_radius_mm < 45


@pytest.mark.parametrize("name", NEW)
def test_the_best_known_index_is_reached_and_evolution_finds_no_better_one(name):
    problem = scene(name).problem()
    best = default_search(name).solutions[0]
    assert best.status == "admissible"
    assert best.first_stage_t >= BEST_INDEX[name]
    assert best.failure_probability is not None
    rival = evolved(problem, seed=0, evaluations=30_000)
    assert best.first_stage_t >= 0.99 * rival


@pytest.mark.full
@pytest.mark.parametrize("demand", ["paper", "tight"])
@pytest.mark.parametrize("name", FULL)
def test_no_seed_of_evolution_is_better_by_more_than_one_per_cent(name, demand):
    problem = scene(name).problem(demand)
    ends = [searched(problem, seed=seed).solutions[0].t for seed in range(5)]
    rivals = [evolved(problem, seed=seed, evaluations=30_000) for seed in range(5)]
    best = max(*ends, *rivals)
    assert sum(end >= 0.99 * best for end in ends) >= 4
    assert min(ends) >= 0.98 * best


@pytest.mark.full
@pytest.mark.parametrize("name", FULL)
def test_generate_and_test_of_forty_thousand_views_stays_behind(name):
    problem = scene(name).problem()
    bounds = np.array([np.pi, 1.0, 0.0, 0.3, 0.3, 0.0])
    rng = np.random.default_rng(0)
    x = bounds[:, None] * rng.uniform(-1, 1, (6, 40_000))
    near, far = 1.5 * problem.target_radius_mm, problem.farthest_mm
    x[2] = rng.uniform(np.log(near), np.log(far), 40_000)
    x[5] = rng.uniform(-0.6, 1.5, 40_000)
    views = orbit_views(x, problem)
    views = views[inside(problem, views.position_mm)]
    table = RowTable.of(problem)
    tested = float(table.worst(table.index(views)).max())
    assert solve(problem, seed=0)[0].first_stage_t > tested


@pytest.mark.parametrize("name", NEW)
def test_the_best_candidate_alone_is_close_to_the_best_view(name):
    problem = scene(name).problem(candidates=20_000, starts=4)
    found = searched(problem, seed=0)
    assert found.screened.worst[0] >= 0.97 * found.solutions[0].t


@pytest.mark.parametrize(
    ("name", "demand"),
    [("clutter", "paper"), ("notch", "paper"), ("paper's object", "fa")],
)
def test_a_reported_view_holds_by_formulas_that_the_search_does_not_use(name, demand):
    asked = scene(name)
    problem = asked.problem(demand, starts=6, candidates=10_000)
    best = solve(problem, seed=1)[0]
    pieces = [piece for edge in asked.edges for piece in edge.sight_pieces()]
    second = recheck(
        problem, best.view, oracle=lambda p: exactly_visible(asked.mesh, pieces, p)
    )
    assert second.holds
    assert second.values["g4"] == pytest.approx(best.margins["visibility"].value)
    assert certify(problem, best.view).scale > 1
    assert best.failure_probability is not None


@pytest.mark.full
@pytest.mark.parametrize("name", FULL)
def test_no_sample_of_a_million_at_the_certified_tolerance_fails(name):
    problem, view = scene(name).problem(), default_search(name).solutions[0].view
    scale = certify(problem, view, box=UNIT).scale
    assert scale > 1
    box = scaled_box(UNIT, scale)
    assert failures_on_surface(problem, view, box, 1_000_000) == 0


def test_a_start_in_any_piece_of_the_region_stays_in_its_piece():
    asked = scene("clutter")
    found = default_search("clutter").solutions
    assert {end.component for end in found} > {1}
    for end in found:
        assert end.component is not None
        assert asked.region.contains(end.view.position_mm).all()


def test_a_hopeless_task_is_searched_at_a_distance_as_well():
    """Right before the features a hopeless view misses by few standard deviations."""
    problem = scene("paper's object").problem(stricter=14, starts=8, candidates=20_000)
    short = replace(problem, lens=replace(problem.lens, d_mm=(12.6, 13.2)))
    for seed in (0, 1):
        best = attempt(short, seed=seed).solutions[0]
        away = np.linalg.norm(best.view.position_mm[0] - problem.target_centre_mm)
        assert best.t == pytest.approx(-20.9, abs=0.3)
        assert 100 < away < 300


def test_rivals_coordinates_aim_at_the_target():
    problem = scene("paper's object").problem("fa")
    x = np.array([0.3, 0.5, np.log(300.0), 0.0, 0.0, 0.0, np.log(10.0), np.log(2.0)])
    views = orbit_views(x[:, None], problem)
    assert np.allclose(
        views.rotation, looking_at(problem.target_centre_mm, views.position_mm)
    )
    assert (views.f_mm[0], views.a_mm[0]) == pytest.approx((10.0, 2.0))
