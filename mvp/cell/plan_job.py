"""The plan job: from a cell and a task to a plan, with everything a run needs of it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mvp.cell.arm_setup import ArmSetup
from mvp.cell.calibration_gates import of_views
from mvp.cell.contrast import ContrastForecast
from mvp.cell.places import as_stored
from mvp.cell.plan_document import ViewWriter, not_covered
from mvp.cell.plan_problem import ProblemFactory
from mvp.cell.plan_views import Found, ViewFinder
from mvp.cell.task_scene import TaskScene, build_scene
from mvp.cell.verification import Expectations
from mvp.planning.plan import CellStamp, FileStamp, Plan, Timing

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path
    from typing import Literal

    from mvp.cell.loading import LoadedCell, LoadedTask
    from mvp.cell.plan_views import Tell
    from mvp.planning.plan import PlannedView


@dataclass(frozen=True, eq=False)
class Setting:
    """Everything planning needs, loaded and checked but not yet searched."""

    cell: LoadedCell
    task: LoadedTask
    scene: TaskScene
    arm: ArmSetup
    factory: ProblemFactory


@dataclass(frozen=True, eq=False)
class Planned:
    """A plan, the views behind it, and what it was made from."""

    setting: Setting
    plan: Plan
    found: Found


def prepare(cell: LoadedCell, task: LoadedTask) -> Setting:
    """Load geometry and set up the problem; no search.

    Raises:
        GeometryError, FeatureError: the part or a feature cannot be used.
    """
    cell = cell.holding(task)
    scene = build_scene(cell, task)
    free_roll = task.config.planning.field_of_view == "circle"
    arm = ArmSetup(cell, scene, free_roll)
    return Setting(
        cell, task, scene, arm, ProblemFactory(cell, task, scene, arm.reachable)
    )


@dataclass
class _Stopwatch:
    """Seconds by stage."""

    clock: Callable[[], float] = time.perf_counter
    seconds: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._begin = self._last = self.clock()

    def lap(self, stage: str) -> None:
        now = self.clock()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now

    def timing(self) -> Timing:
        return Timing(**self.seconds, total=self.clock() - self._begin)


def make_plan(
    cell: LoadedCell, task: LoadedTask, *, seed: int = 0, tell: Tell | None = None
) -> Planned:
    """Plan a task.

    An inadmissible task gives a plan whose status says so; it is not an error here.

    Args:
        cell: where it is done.
        task: what must be seen.
        seed: of the search; the same seed gives the same plan.
        tell: hears about the stages.

    Raises:
        GeometryError, FeatureError: the part or a feature cannot be used.
    """
    say = tell or (lambda text: None)
    watch = _Stopwatch()
    say(f"loading {task.part_file.name}")
    setting = prepare(cell, task)
    watch.lap("load")
    features = setting.scene.scene.features
    for feature in features:
        say(f"visibility of {feature.id}")
        setting.factory.region(feature)
    watch.lap("visibility")
    forecast = ContrastForecast.of_cell(setting.factory)
    finder = ViewFinder(setting.factory, setting.arm, seed, say, forecast)
    found = finder.find(features, task.config.planning.max_views)
    found = finder.explained(found)
    views = _written(setting, found)
    watch.lap("optimise")
    plan = Plan(
        status=_status(found),
        seed=seed,
        part=_stamp(cell, task.part_file, setting.scene.part.sha256),
        task=_stamp(cell, task.source.path, task.sha256),
        cell=CellStamp(
            name=cell.config.name, sha256=cell.sha256, simulated=cell.config.simulated
        ),
        views=views,
        not_covered=[entry for failed in found.failed for entry in not_covered(failed)],
        notes=_notes(setting, found, views),
        timing_s=watch.timing(),
    )
    return Planned(setting, plan, found)


def _written(setting: Setting, found: Found) -> list[PlannedView]:
    writer, expectations = ViewWriter(setting.factory), Expectations(setting)
    return [
        expectations.foretold(writer.planned(number, view))
        for number, view in enumerate(found.views, 1)
    ]


def _stamp(cell: LoadedCell, file: Path, sha256: str) -> FileStamp:
    """A file as it is named from the cell's folder."""
    return FileStamp(file=as_stored(file, cell.source.path.parent), sha256=sha256)


def _status(found: Found) -> Literal["admissible", "partial", "infeasible"]:
    if not found.views:
        return "infeasible"
    return "partial" if found.failed else "admissible"


def _notes(setting: Setting, found: Found, views: Sequence[PlannedView]) -> list[str]:
    notes = [*setting.scene.part.lines()]
    if found.together is not None and len(found.views) > 1:
        notes.append(
            f"{len(found.views)} views, because one cannot see everything: "
            f"{found.together.reason}"
        )
    known = setting.cell.calibrations
    doubts = [*known.warnings, *of_views(known, views)]
    notes += [f"warning: {one.text}; {one.fix}" for one in doubts]
    notes += [
        f"{name} calibration accepted against its verdict: {reason}"
        for name, reason in known.accepted.items()
    ]
    return notes
