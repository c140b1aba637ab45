"""The certificate is never too large, and hardly ever much too small."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mvp.constraints import Visibility, Workspace
from mvp.geometry import Box
from mvp.planning import ToleranceBox, certify, proven, solve
from mvp.planning.chance import holds, perturbed
from mvp.planning.problem import PlanningProblem
from mvp.testing.planning_scenes import (
    PlanningScene,
    race_scene,
    scene_lens,
    table_views,
)
from mvp.testing.tolerance_box import (
    failures_on_surface,
    scaled_box,
    surface_errors,
)

UNIT = ToleranceBox(1.0, float(np.deg2rad(0.3)), 0.01)


@cache
def race() -> PlanningScene:
    return race_scene()


@cache
def optimum(name: str, e_mm: float = 0.0):
    problem = race().problem(
        name, lens=scene_lens(name, e_mm=e_mm), starts=10, candidates=20_000
    )
    return problem, solve(problem, seed=0)[0].view


def _attacked(
    problem: PlanningProblem, view, box: ToleranceBox, rng: np.random.Generator
) -> bool:
    """Whether a search for the worst corner breaks a constraint within the box.

    Projected descent on each constraint's smallest row, over shift, turn and the ends
    of d: it knows nothing of the bounds.
    """
    for constraint in problem.constraints:
        if isinstance(constraint, Visibility):
            if float(constraint.margin(view)[0]) < box.position_mm:
                return True
            continue
        errors = surface_errors(box, 48, rng)
        for step in range(60):
            views = perturbed(view, errors)
            rows = constraint.rows(views)
            worst = rows.value.argmin(axis=1)
            value = rows.value[np.arange(len(errors)), worst]
            if (value < 0).any():
                return True
            slope = rows.gradient[np.arange(len(errors)), worst]
            errors = _pushed(errors, slope, box, 0.5 / (1 + step / 10))
    return False


def _pushed(errors, slope, box, share):
    pushed = errors.copy()
    for part, size in ((slice(0, 3), box.position_mm), (slice(3, 6), box.angle_rad)):
        direction = slope[:, part]
        length = np.linalg.norm(direction, axis=1, keepdims=True)
        goal = -size * direction / np.where(length > 0, length, 1.0)
        mixed = (1 - share) * errors[:, part] + share * goal
        norm = np.linalg.norm(mixed, axis=1, keepdims=True)
        pushed[:, part] = size * mixed / np.where(norm > 0, norm, 1.0)
    limits = np.array([box.d_mm, box.f_mm, box.a_mm])
    pushed[:, 6:] = -np.sign(slope[:, 6:]) * limits
    return pushed


def _adversarial(problem, view, start: float) -> float:
    """Smallest scale found to break a constraint, by bisection above a start."""
    rng = np.random.default_rng(5)
    low, high = 0.8 * start, 1.6 * start
    for _ in range(9):
        middle = (low + high) / 2
        broken = _attacked(problem, view, scaled_box(UNIT, middle), rng)
        low, high = (low, middle) if broken else (middle, high)
    return high


@pytest.mark.parametrize(
    ("name", "scale", "binding", "alone"),
    [
        ("V_f", 5.189, "field_of_view", (11.4, 2.43, 0.101)),
        ("V_f1", 12.264, "focus_near", (25.0, 10.4, 0.139)),
        ("V_f2", 4.730, "field_of_view", (7.9, 2.68, 0.184)),
    ],
)
def test_the_tables_of_the_paper_have_the_known_tolerances(name, scale, binding, alone):
    found = certify(race().problem(), table_views()[name], box=UNIT)
    assert found.scale == pytest.approx(scale, abs=2e-3)
    assert found.binding == binding
    assert found.method == "certified"
    assert found.position_alone_mm == pytest.approx(alone[0], abs=0.06)
    assert np.rad2deg(found.angle_alone_rad) == pytest.approx(alone[1], abs=0.05)
    assert found.d_alone_mm == pytest.approx(alone[2], abs=1e-3)
    assert found.position_mm == pytest.approx(found.scale)


@pytest.mark.parametrize(
    ("name", "share"), [("V_f", 0.99), ("V_f1", 0.99), ("V_f2", 0.99)]
)
def test_a_worst_corner_search_just_confirms_the_certificate(name, share):
    problem, view = race().problem(), table_views()[name]
    scale = certify(problem, view, box=UNIT).scale
    rival = _adversarial(problem, view, scale)
    assert scale <= rival * (1 + 1e-3)
    assert scale >= share * rival * 0.99


@pytest.mark.parametrize(
    ("name", "e_mm"), [("tight", 0.0), ("rect", 0.0), ("tight", 2.4)]
)
def test_where_resolution_binds_the_certificate_is_at_least_85_per_cent(name, e_mm):
    problem, view = optimum(name, e_mm)
    found = certify(problem, view, box=UNIT)
    rival = _adversarial(problem, view, found.scale / 0.92)
    assert found.scale <= rival
    assert found.scale >= 0.85 * rival


@pytest.mark.parametrize(
    ("name", "e_mm"), [("paper", 0.0), ("rect", 0.0), ("tight", 2.4)]
)
def test_no_sample_of_a_certified_box_fails(name, e_mm):
    problem, view = optimum(name, e_mm)
    full = ToleranceBox.of(problem.uncertainty)
    for box in (UNIT, full):
        scale = certify(problem, view, box=box).scale
        assert scale > 1
        assert failures_on_surface(problem, view, scaled_box(box, scale), 10_000) == 0


@pytest.mark.full
@pytest.mark.parametrize("name", ["paper", "tight", "rect"])
def test_no_sample_of_a_million_fails(name):
    problem, view = optimum(name)
    scale = certify(problem, view, box=UNIT).scale
    assert failures_on_surface(problem, view, scaled_box(UNIT, scale), 1_000_000) == 0


def test_samples_of_a_clearly_larger_box_do_fail():
    problem, view = race().problem(), table_views()["V_f1"]
    scale = certify(problem, view, box=UNIT).scale
    assert (
        failures_on_surface(problem, view, scaled_box(UNIT, 1.05 * scale), 10_000) > 0
    )


def test_errors_of_focal_length_and_aperture_make_the_box_smaller():
    problem, view = race().problem(), table_views()["V_f1"]
    full = ToleranceBox.of(problem.uncertainty)
    found = certify(problem, view)
    assert found.f_mm == pytest.approx(found.scale * full.f_mm)
    assert found.scale < certify(problem, view, box=UNIT).scale


def test_a_proven_box_contains_proven_boxes_and_a_refused_one_does_not():
    problem, view = race().problem(), table_views()["V_f"]
    scale = certify(problem, view, box=UNIT).scale
    for share in (0.1, 0.5, 0.9, 1.0):
        assert proven(problem, view, scaled_box(UNIT, share * scale))
    assert not proven(problem, view, scaled_box(UNIT, 1.01 * scale))


def test_a_view_that_is_not_admissible_has_no_tolerance():
    found = certify(race().problem(), table_views()["V_i"])
    assert found.scale == 0.0
    assert found.position_alone_mm == 0.0
    assert found.binding is not None


def test_walls_of_the_workspace_count_and_unknown_kinds_are_named():
    problem, view = race().problem(), table_views()["V_f"]
    near = view.position_mm[0]
    box = Box(near - [5.0, 300.0, 300.0], near + 300.0)

    class Reach:
        kind = "reach"
        unit = "deg"
        labels = ("joint 1",)

        def rows(self, views, *, gradient=True):
            raise AssertionError("not asked for")

    walled = PlanningProblem(
        constraints=(*problem.constraints, Workspace(box), Reach()),
        key_points_mm=problem.key_points_mm,
        target_centre_mm=problem.target_centre_mm,
        target_radius_mm=problem.target_radius_mm,
        lens=problem.lens,
        workspace=problem.workspace,
    )
    found = certify(walled, view, box=ToleranceBox(1.0, 0.0, 0.0))
    assert found.scale == pytest.approx(5.0, abs=1e-6)
    assert found.binding == "workspace"
    assert found.not_covered == ("reach",)


def test_a_rotation_within_the_certified_angle_keeps_every_constraint():
    problem, view = race().problem(), table_views()["V_f2"]
    found = certify(problem, view, box=UNIT)
    axes = Rotation.random(2_000, random_state=3).as_rotvec()
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    errors = np.zeros((2_000, 9))
    errors[:, 3:6] = found.angle_alone_rad * axes
    assert holds(problem, view, errors).all()
