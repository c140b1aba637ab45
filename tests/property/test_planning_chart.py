"""The orbit chart: its Jacobian, its bounds, and the slopes of the sigma-index."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mvp.geometry import Box
from mvp.optics import Views
from mvp.planning.candidates import aimed, orbit_positions
from mvp.planning.chart import Chart
from mvp.planning.problem import LensBounds
from mvp.planning.rows import RowTable
from mvp.testing.planning_scenes import PlanningScene, race_scene, scene_lens


@cache
def race() -> PlanningScene:
    return race_scene()


def _views(problem, count: int, seed: int) -> Views:
    rng = np.random.default_rng(seed)
    return aimed(problem, orbit_positions(problem, count, rng), rng)


def _error_coordinates(base: Views, moved: Views) -> np.ndarray:
    """(N, 9): what ``moved`` is off from ``base``."""
    turn = np.swapaxes(base.rotation, 1, 2) @ moved.rotation
    return np.concatenate(
        [
            moved.position_mm - base.position_mm,
            Rotation.from_matrix(turn).as_rotvec(),
            (moved.d_mm - base.d_mm)[:, None],
            (moved.f_mm - base.f_mm)[:, None],
            (moved.a_mm - base.a_mm)[:, None],
        ],
        axis=1,
    )


@pytest.mark.parametrize("name", ["paper", "rect", "fa"])
@pytest.mark.parametrize("e_mm", [0.0, 2.4])
def test_the_jacobian_is_the_derivative_of_the_retraction(name, e_mm):
    problem = race().problem(name, lens=scene_lens(name, e_mm=e_mm))
    chart = Chart.of(problem)
    views = _views(problem, 200, seed=1)
    jacobian = chart.jacobian(views)
    step = 1e-5
    for j in range(chart.n):
        y = np.zeros((len(views), chart.n))
        y[:, j] = step
        ahead = _error_coordinates(views, chart.retract(views, y, clip=False))
        behind = _error_coordinates(views, chart.retract(views, -y, clip=False))
        numeric = (ahead - behind) / (2 * step)
        scale = np.abs(numeric).max(axis=1, keepdims=True) + 1e-3
        assert (np.abs(jacobian[:, :, j] - numeric) / scale).max() < 1e-5


@pytest.mark.parametrize("name", ["tight", "rect", "fa"])
@pytest.mark.parametrize("e_mm", [0.0, 2.4])
def test_slopes_of_the_index_agree_with_central_differences(name, e_mm):
    problem = race().problem(name, lens=scene_lens(name, e_mm=e_mm))
    table, chart = RowTable.of(problem), Chart.of(problem)
    views = _views(problem, 60, seed=2)
    linear = table.linearise(views, chart)
    smooth = np.flatnonzero(table.curved)
    smooth = smooth[[not table.labels[i] == "image circle" for i in smooth]]
    step = 2e-5
    for j in range(chart.n):
        y = np.zeros((len(views), chart.n))
        y[:, j] = step
        ahead = table.index(chart.retract(views, y, clip=False))
        behind = table.index(chart.retract(views, -y, clip=False))
        numeric = ((ahead - behind) / (2 * step))[:, smooth]
        analytic = linear.slope[:, smooth, j]
        scale = np.abs(linear.slope[:, smooth]).max(axis=2) + 1.0
        assert (np.abs(analytic - numeric) / scale).max() < 1e-4


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**31),
    st.floats(0.01, 3.0),
    st.tuples(st.floats(0.0, 3.0), st.floats(0.0, 5.0)),
)
def test_a_step_never_leaves_the_lens_bounds_and_keeps_a_rotation(seed, size, widths):
    rng = np.random.default_rng(seed)
    lens = LensBounds.of(
        f_mm=(10, 10 + widths[0]), d_mm=(14, 14 + widths[1]), a_mm=0.5, e_mm=1.0
    )
    chart = Chart(np.array([1.0, -2.0, 3.0]), lens, roll_free=True)
    rotation = Rotation.random(5, random_state=seed % 1000).as_matrix()
    depth = rng.uniform(50, 500, 5)
    position = chart.centre_mm - rotation[:, :, 2] * depth[:, None]
    views = Views(
        rotation,
        position,
        np.full(5, 14.0),
        np.full(5, 10.0),
        np.full(5, 0.5),
        np.full(5, 1.0),
    )
    moved = chart.retract(views, size * rng.normal(size=(5, chart.n)) * chart.shape)
    assert (moved.d_mm >= lens.d_mm[0]).all()
    assert (moved.d_mm <= lens.d_mm[1]).all()
    assert (moved.f_mm >= lens.f_mm[0]).all()
    assert (moved.f_mm <= lens.f_mm[1]).all()
    identity = moved.rotation @ np.swapaxes(moved.rotation, 1, 2)
    assert np.allclose(identity, np.eye(3), atol=1e-12)
    assert (chart.target_camera(moved)[:, 2] > 0).all()


def test_no_step_is_no_change():
    problem = race().problem("rect")
    chart = Chart.of(problem)
    views = _views(problem, 20, seed=3)
    still = chart.retract(views, np.zeros((20, chart.n)))
    assert np.allclose(still.position_mm, views.position_mm, atol=1e-9)
    assert np.allclose(still.d_mm, views.d_mm, atol=1e-12)


def test_candidates_see_the_target_in_front_and_lie_round_it():
    problem = race().problem("fa")
    views = _views(problem, 500, seed=4)
    chart = Chart.of(problem)
    assert (chart.target_camera(views)[:, 2] > 0).all()
    assert np.unique(np.sign(views.position_mm), axis=0).shape[0] == 8
    grown = Box(race().workspace.low_mm * 2, race().workspace.high_mm * 2)
    assert grown.contains(views.position_mm).all()
