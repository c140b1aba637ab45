"""Probabilities of a view against closed forms and drawn errors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ndtr
from scipy.stats import multivariate_normal

from mvp.constraints import Uncertainty
from mvp.geometry import Pose
from mvp.planning import solve
from mvp.planning.chance import perturbed
from mvp.planning.probability import drawn, linearised, union_probability
from mvp.planning.probability_errors import CellErrors, PoseChain, camera_spread
from mvp.planning.rows import RowTable
from mvp.testing.planning_scenes import paper_view, race_scene, table_views

DRAWS = 20_000


def rng(number: int = 0) -> np.random.Generator:
    return np.random.default_rng(number)


# ---------------------------------------------------------------- many half-spaces


def test_one_row_fails_as_often_as_the_normal_distribution_says():
    for sigmas in (-0.5, 0.0, 1.0, 3.0, 7.0):
        found = union_probability(np.array([2 * sigmas]), np.array([[0.0, 2.0]]), rng())
        assert found == pytest.approx(ndtr(-sigmas), rel=1e-12)


def test_independent_rows_fail_as_their_product_says():
    levers = np.eye(3)
    margins = np.array([1.0, 1.5, 0.3])
    expected = 1 - np.prod(ndtr(margins))
    assert union_probability(margins, levers, rng()) == pytest.approx(
        expected, rel=0.02
    )


def test_correlated_rows_fail_as_the_joint_normal_says():
    levers = rng(5).normal(size=(4, 4))
    margins = np.abs(levers).sum(axis=1) * 0.6
    inside = multivariate_normal(np.zeros(4), levers @ levers.T).cdf(margins)
    found = union_probability(margins, levers, rng())
    assert found == pytest.approx(1 - inside, rel=0.03)


def test_a_row_that_is_there_twice_counts_once():
    once = union_probability(np.array([1.0]), np.array([[1.0, 0.0]]), rng())
    twice = union_probability(np.ones(2), np.array([[1.0, 0.0]] * 2), rng())
    assert twice == pytest.approx(once, rel=1e-12)


def test_a_rare_failure_of_two_opposite_rows_is_the_sum_of_both():
    found = union_probability(np.full(2, 6.0), np.array([[1.0], [-1.0]]), rng())
    assert found == pytest.approx(2 * ndtr(-6.0), rel=1e-9)


def test_a_broken_row_that_no_error_moves_fails_for_certain():
    assert union_probability(np.array([-1.0, 5.0]), np.zeros((2, 3)), rng()) == 1.0
    assert union_probability(np.array([1.0, 5.0]), np.zeros((2, 3)), rng()) == 0.0


# ------------------------------------------------------------------ calibrated chain


def chain(scale: float = 1.0, *, shared: bool = False) -> PoseChain:
    part = Pose.from_rotvec("base", "part", [0.1, -0.2, 0.7], [-500.0, 120.0, 60.0])
    hand = Pose.from_rotvec("tool", "camera", [0.02, 0.01, 0.4], [3.0, -60.0, 105.0])
    spread = np.diag([0.3, 0.2, 0.4, 0.002, 0.003, 0.001]) * scale
    turn = rng(3).normal(size=(6, 6)) * 0.2 + np.eye(6)
    covariance = spread @ turn @ turn.T @ spread
    by_hand_eye = np.diag([0.7] * 3 + [0.5] * 3) if shared else np.zeros((6, 6))
    eye = 0.3 * covariance
    return PoseChain(
        part,
        hand,
        covariance + by_hand_eye @ eye @ by_hand_eye.T,
        eye,
        np.diag([0.1 * scale] * 3 + [3e-4 * scale] * 3) ** 2,
        by_hand_eye,
    )


def moved(pose: Pose, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Many errors (n, 6) of one pose: t' = t + v, R' = exp([w]) R in target axes."""
    turned = Rotation.from_rotvec(steps[:, 3:]).as_matrix() @ pose.rotation
    return turned, pose.translation_mm + steps[:, :3]


@pytest.mark.parametrize("shared", [False, True])
def test_drawn_transforms_put_the_camera_where_the_covariance_says(shared: bool):
    known = chain(shared=shared)
    view = table_views()["V_f"]
    planned = view.part_from_camera()
    believed = known.base_from_part @ planned @ known.tool_from_camera.inverse()
    eye, own, by_robot = (
        rng(number).multivariate_normal(np.zeros(6), covariance, DRAWS)
        for number, covariance in enumerate(
            (known.hand_eye, known.part_alone, known.robot)
        )
    )
    part, part_mm = moved(known.base_from_part, own + eye @ known.part_by_hand_eye.T)
    tool, tool_mm = moved(believed, by_robot)
    hand, hand_mm = moved(known.tool_from_camera, eye)
    camera_mm = tool_mm + (tool @ hand_mm[..., None])[..., 0] - part_mm
    shift = (camera_mm[:, None] @ part)[:, 0] - planned.translation_mm
    there = np.swapaxes(part, 1, 2) @ tool @ hand
    turn = Rotation.from_matrix(planned.rotation.T @ there).as_rotvec()
    offs = np.hstack([shift, turn])
    expected = known.covariance(view)[0]
    size = np.sqrt(np.diag(expected))
    difference = (np.cov(offs.T) - expected) / np.outer(size, size)
    assert np.abs(difference).max() < 0.04
    inside = (
        np.linalg.norm(offs[:, :3], axis=1) < camera_spread(expected).position_95_mm
    )
    assert inside.mean() == pytest.approx(0.95, abs=0.012)


def test_a_part_found_through_the_same_hand_eye_is_met_more_exactly():
    known = chain(shared=True)
    alone = PoseChain(
        known.base_from_part,
        known.tool_from_camera,
        known.part,
        known.hand_eye,
        known.robot,
    )
    view = table_views()["V_f"]
    by_part, _, by_hand_eye = known.levers(view)
    cancelling = -np.linalg.solve(by_part[0], by_hand_eye[0])
    found = PoseChain(
        known.base_from_part,
        known.tool_from_camera,
        cancelling @ known.hand_eye @ cancelling.T,
        known.hand_eye,
        np.zeros((6, 6)),
        cancelling,
    )
    assert camera_spread(found.covariance(view)[0]).position_mm < 1e-6
    assert camera_spread(alone.covariance(view)[0]).position_mm > 0.5


# ---------------------------------------------------------------------- whole views


@cache
def problem_and_view():
    problem = race_scene().problem("tight", starts=6, candidates=8_000)
    return problem, solve(problem, seed=0)[0].view


def calibrated(scale: float) -> CellErrors:
    lens = np.diag([0.0125, 0.014, 0.02]) ** 2 * scale**2
    lens[0, 1] = lens[1, 0] = lens[0, 0]
    return CellErrors(Uncertainty(), chain(scale), lens)


def with_errors(errors: CellErrors):
    problem, view = problem_and_view()
    return replace(problem, errors=errors), view


@pytest.mark.parametrize("scale", [2.0, 4.0, 7.0])
def test_linearised_probabilities_agree_with_drawn_errors(scale: float):
    """Within 1.5 % of probability, where up to a third of the draws fail."""
    problem, view = with_errors(calibrated(scale))
    near = linearised(problem, view, rng())
    true = drawn(problem, view, rng(1), DRAWS)
    assert near.each.keys() == true.each.keys()
    for kind, kept in true.each.items():
        assert near.each[kind] == pytest.approx(kept, abs=0.015), kind
    assert near.together == pytest.approx(true.together, abs=0.02)


def test_a_requirement_is_at_least_as_probable_as_all_of_them():
    found = linearised(*with_errors(calibrated(4.0)), rng())
    assert found.together <= found.each[found.weakest] + 1e-3
    assert found.together >= 1 - sum(1 - kept for kept in found.each.values()) - 1e-3


def test_errors_that_are_the_stated_ones_change_no_index():
    problem, view = problem_and_view()
    as_stated, _ = with_errors(CellErrors(problem.uncertainty))
    views = perturbed(view, rng(2).normal(size=(40, 9)) * problem.uncertainty.sigma)
    for method in ("index", "curved_index"):
        one = getattr(RowTable.of(problem), method)(views)
        other = getattr(RowTable.of(as_stated), method)(views)
        np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-9)


def test_a_plan_for_measured_errors_fails_less_under_them():
    """What turns with the part does not miss it: the two plans weigh that differently."""
    stated, _ = problem_and_view()
    assert stated.errors is None
    measured, before = with_errors(calibrated(7.0))
    after = solve(measured, seed=0)[0].view
    table = RowTable.of(measured)
    index = [float(table.worst(table.index(view))[0]) for view in (after, before)]
    assert index[0] > 1.5 * index[1]
    fails = [1 - drawn(measured, v, rng(1), DRAWS).together for v in (after, before)]
    assert fails[1] > 0.02
    assert fails[0] < 0.1 * fails[1]


def test_an_error_of_the_principal_point_turns_the_camera():
    known = chain()
    exact = PoseChain(
        known.base_from_part,
        known.tool_from_camera,
        np.zeros((6, 6)),
        np.zeros((6, 6)),
        np.zeros((6, 6)),
        principal_point_mm=(0.01, 0.02),
        pupil_mm=0.5,
    )
    view = paper_view(np.array([0.0, 0.0, 300.0]), np.array([0.0, 0.0, -1.0]), 13.0)
    found = exact.covariance(view)[0]
    assert np.sqrt(found[3, 3]) == pytest.approx(0.02 / view.f_cal_mm[0])
    assert np.sqrt(found[4, 4]) == pytest.approx(0.01 / view.f_cal_mm[0])
    np.testing.assert_allclose(found[:3, :3], np.diag([0, 0, 0.25]), atol=1e-12)
