"""From a solution of the planner to what arm and lens will be told, checked again.

Motor steps are rounded first; every margin of the plan is that of the rounded steps at
the pose the arm takes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from mvp.kinematics import (
    JointPath,
    NoPath,
    Unreachable,
    clearance_index,
    find_path,
    realisations,
)
from mvp.optics import single_view
from mvp.planning.recheck import recheck
from mvp.visibility import exactly_visible

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.arm_setup import ArmSetup
    from mvp.cell.contrast import ContrastForecast, SeenContrast, ViewContrast
    from mvp.cell.plan_problem import ProblemFactory
    from mvp.kinematics import ClearanceIndex, Realisation
    from mvp.optics import LensSetting, LensSteps, LensTable, Views
    from mvp.planning import PlanningProblem, Solution
    from mvp.scene import Feature

_REALISATIONS_TRIED = 4


@dataclass(frozen=True, eq=False)
class RealisedView:
    """A view as it will be commanded.

    Attributes:
        view: pose and rounded lens setting, N = 1, part frame.
        setting: what the lens gives at the rounded steps.
        path: from home, as checked at planning time.
        repairs: what was changed about a person's starts.
        clearance_index: standard deviations before anything touches; None when the
            stated errors bring nothing together.
        contrast: what it will show; None when the light is not known.
    """

    features: tuple[Feature, ...]
    problem: PlanningProblem
    solution: Solution
    view: Views
    steps: LensSteps
    setting: LensSetting
    tube_mm: float
    arm: Realisation
    path: JointPath
    clearance_index: ClearanceIndex | None = None
    contrast: SeenContrast | None = None
    repairs: tuple[str, ...] = ()


@dataclass(frozen=True)
class NotRealised:
    """Why a view that optics allow cannot be taken."""

    reason: str


def realise(
    factory: ProblemFactory,
    arm: ArmSetup,
    features: Sequence[Feature],
    problem: PlanningProblem,
    solution: Solution,
    tube_mm: float,
    forecast: ContrastForecast | None = None,
) -> RealisedView | NotRealised:
    """Round the lens, choose roll and branch, check everything again, find a path.

    The first configuration that passes is taken; they come best first: rolls that show
    enough contrast before others, then what suits the arm. When none of those passes,
    contrast does not count.
    """
    rounded = _rounded(factory.table.with_tube(tube_mm), solution.view)
    if rounded is None:
        return NotRealised("the lens motors do not reach the planned setting")
    steps, setting = rounded
    asked = _Asked(tuple(features), problem, solution, steps, setting, tube_mm)
    if forecast is None:
        return _taken(factory, arm, asked, None, ranked=False)
    contrast = forecast.of(features, solution.view.part_from_camera(), setting)
    view = _taken(factory, arm, asked, contrast, ranked=True)
    if isinstance(view, NotRealised):
        view = _taken(factory, arm, asked, contrast, ranked=False)
    return view


@dataclass(frozen=True, eq=False)
class _Asked:
    """A solution with its rounded lens setting."""

    features: tuple[Feature, ...]
    problem: PlanningProblem
    solution: Solution
    steps: LensSteps
    setting: LensSetting
    tube_mm: float


def _taken(
    factory: ProblemFactory,
    arm: ArmSetup,
    asked: _Asked,
    contrast: ViewContrast | None,
    *,
    ranked: bool,
) -> RealisedView | NotRealised:
    """The first of the best configurations that passes every check."""
    problem, setting = asked.problem, asked.setting
    choices = realisations(
        arm.placement(setting, problem.key_points_mm),
        asked.solution.view.part_from_camera(),
        free_roll=arm.free_roll,
        rank=contrast.rank if contrast is not None and ranked else None,
    )
    if isinstance(choices, Unreachable):
        return NotRealised(choices.reason)
    reason = ""
    for choice in islice(choices, _REALISATIONS_TRIED):
        view = single_view(
            choice.part_from_camera,
            d_mm=setting.d_mm,
            f_mm=setting.f_mm,
            a_mm=setting.a_mm,
            e_mm=setting.e_mm,
        )
        reason = _recheck(factory, asked.features, problem, view)
        path = _path(arm, choice) if not reason else NoPath(())
        if isinstance(path, JointPath):
            return RealisedView(
                asked.features,
                problem,
                asked.solution,
                view,
                asked.steps,
                setting,
                asked.tube_mm,
                choice,
                path,
                clearance_index=_clearance_index(arm, problem, view, choice),
                contrast=contrast.at(choice.part_from_camera) if contrast else None,
            )
        reason = reason or path.reason
    return NotRealised(reason)


def _rounded(table: LensTable, view: Views) -> tuple[LensSteps, LensSetting] | None:
    f, d, a = (float(v[0]) for v in (view.f_mm, view.d_mm, view.a_mm))
    if not table.reaches(f, d, a):
        return None
    steps = table.steps(f, d, a)
    return steps, table.at(steps)


def _recheck(
    factory: ProblemFactory,
    features: Sequence[Feature],
    problem: PlanningProblem,
    view: Views,
) -> str:
    """Why the rounded view is not admissible after all; empty when it is."""
    pieces = [piece for f in features for piece in f.sight_pieces()]
    again = recheck(
        problem,
        view,
        oracle=lambda points: exactly_visible(factory.occluders, pieces, points),
    )
    if again.holds:
        return ""
    failed = [name for name, value in again.values.items() if value < 0]
    return f"at the rounded motor steps {', '.join(failed)} no longer hold"


def _clearance_index(
    arm: ArmSetup, problem: PlanningProblem, view: Views, choice: Realisation
) -> ClearanceIndex | None:
    base_from_part = arm.cell.calibrations.base_from_part
    pupil = base_from_part @ choice.part_from_camera
    errors = problem.uncertainty_at(view)
    return clearance_index(
        arm.bodies,
        choice.joints,
        pupil_mm=pupil.translation_mm,
        part_mm=base_from_part.apply(arm.scene.scene.part.bounds.centre_mm),
        asked_mm=arm.clearance_mm,
        position_mm=errors.position_mm,
        angle_rad=errors.angle_rad,
    )


def _path(arm: ArmSetup, choice: Realisation) -> JointPath | NoPath:
    home = np.asarray(arm.cell.home_joints, np.float64)
    return find_path(
        arm.bodies, home, choice.joints, home=home, required_mm=arm.clearance_mm
    )
