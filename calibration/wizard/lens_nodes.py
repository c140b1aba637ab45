"""Tilted views of the target at one zoom and focus, by what they tell about d."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calibration.bundle import freedom
from calibration.poses import Poses
from calibration.wizard.coverage import coverage
from calibration.wizard.lens_plan import NODE_LIMIT_PX
from calibration.wizard.lookout import camera_at, focus_at
from calibration.wizard.next_pose import (
    Knowledge,
    NoView,
    TargetViews,
    ViewRange,
    camera_information,
    camera_task,
    candidate_views,
    choose,
    views_of,
)
from calibration.wizard.session_store import Sample
from mvp.wizard import Covered, Forecast, Say, Word

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from calibration.bundle import Freedom
    from calibration.wizard.coverage import Coverage
    from calibration.wizard.lens_plan import NodePlan
    from calibration.wizard.lookout import Goal, Lookout
    from calibration.wizard.next_pose import Refused
    from calibration.wizard.next_pose_aim import Aim
    from mvp.geometry import FloatArray
    from mvp.wizard import Answer, Step

NODE = "node"
SIGMA_PX = 0.03
_FREE = ("fx_px", "fy_px", "cx_px", "cy_px", "k1")
_BEFORE = np.array([0.03, 15.0, 15.0, 0.2])
_FEWEST, _MOST, _MOST_FAILURES = 5, 6, 4
_NEAR, _FAR = 0.72, 1.4
_TILT_RAD = float(np.radians(38))
_FILL = 0.4
_AIMS = 10
_BAR_SHARE, _BAR_DEPTH, _BAR_PART = 5e-4, 0.1, 0.6


@dataclass(frozen=True, eq=False)
class NodeSession:
    """What is known of one node while its views are chosen."""

    lookout: Lookout
    plan: NodePlan
    aim: Aim
    knowledge: Knowledge

    @classmethod
    def now(cls, lookout: Lookout, plan: NodePlan) -> NodeSession:
        """From the node's samples so far; the aim uses those of other nodes, too."""
        facts = lookout.facts
        lens = facts.lens_at(plan.steps)
        every = [s for s in lookout.store.samples if s.usable]
        aim = lookout.aim(every[-_AIMS:], lens.d_mm)
        camera = camera_at(facts, lens)
        sigma = _BEFORE * np.array([camera.fx_px, 1, 1, 1])
        weight = np.zeros((4, 4))
        task = camera_task(camera, _free(lookout, plan), lookout.size_px, plan.sharp_mm)
        weight[0, 0] = task[0, 0]
        knowledge = Knowledge(np.diag(sigma**-2.0), weight)
        mine = samples_of(lookout.store.usable(NODE), plan.zoom, plan.focus)
        if mine:
            tool = Poses.of([sample.pose for sample in mine])
            there = views_of(
                camera, lookout.size_px, lookout.points_mm, aim.seen_from(tool)
            )
            seen = np.zeros_like(there.seen)
            for row, sample in zip(seen, mine, strict=True):
                row[np.asarray(sample.ids, dtype=np.int64)] = True
            there = replace(there, seen=seen)
            more = camera_information(camera, _free(lookout, plan), there, SIGMA_PX)
            knowledge = knowledge.after(more)
        return cls(lookout, plan, aim, knowledge)

    @property
    def covered(self) -> Coverage | None:
        """Picture, tilts and sizes of the node's views; None without a view."""
        store = self.lookout.store
        mine = samples_of(store.usable(NODE), self.plan.zoom, self.plan.focus)
        if not mine:
            return None
        tool = Poses.of([sample.pose for sample in mine])
        return coverage(store.observations(mine), self.aim.seen_from(tool))

    @property
    def bar_mm(self) -> float:
        """What d must be good for, as an error of a point where the lens is sharp."""
        facts = self.lookout.facts
        lens = facts.lens_at(self.plan.steps)
        widest = facts.table.a_range_mm[1]
        d = min(
            _BAR_SHARE * lens.d_mm,
            _BAR_DEPTH * facts.blur_circle_mm * lens.d_mm / widest,
        )
        # sqrt(weight) is mm on the work for 1 px of principal distance.
        per_px = float(np.sqrt(self.knowledge.weight[0, 0]))
        return _BAR_PART * d / facts.sensor.pitch_x_mm * per_px

    def candidates(self) -> tuple[TargetViews, FloatArray]:
        """Views in focus, and what each would tell."""
        lookout, plan = self.lookout, self.plan
        lens = lookout.facts.lens_at(plan.steps)
        focus = focus_at(lookout.facts, lens, NODE_LIMIT_PX)
        near, far = focus.range_mm()
        middle = plan.sharp_mm
        within = ViewRange(
            max(near, _NEAR * middle),
            min(far, _FAR * middle),
            tilt_rad=_TILT_RAD,
            share=0.2,
            fill=_FILL,
        )
        camera = camera_at(lookout.facts, lens)
        views = candidate_views(
            camera,
            lookout.size_px,
            lookout.points_mm,
            within,
            lookout.bench.rng(lookout.store.next_number),
            focus=focus,
        )
        return views, camera_information(camera, _free(lookout, plan), views, SIGMA_PX)

    def goal(self, views: TargetViews, index: int) -> Goal | Refused:
        """Whether the arm gets to a candidate."""
        one = views.camera_from_target[index : index + 1]
        d_mm = self.lookout.facts.lens_at(self.plan.steps).d_mm
        return self.lookout.goal(self.aim, one, d_mm)


def _free(lookout: Lookout, plan: NodePlan) -> Freedom:
    """One principal distance, centre, k1."""
    camera = camera_at(lookout.facts, lookout.facts.lens_at(plan.steps))
    return freedom(camera, _FREE, tied_focal=True)


def samples_of(samples: Sequence[Sample], zoom: int, focus: int) -> tuple[Sample, ...]:
    """Those at one zoom and focus."""
    return tuple(
        s
        for s in samples
        if s.lens_steps["zoom"] == zoom and s.lens_steps["focus"] == focus
    )


def tilted_views(
    lookout: Lookout, plan: NodePlan, done: float
) -> Generator[Step, Answer, Word | None]:
    """Views of one node by what they tell about d, until it meets the bar."""
    store, failures = lookout.store, 0
    while failures < _MOST_FAILURES:
        count = len(samples_of(store.usable(NODE), plan.zoom, plan.focus))
        session = NodeSession.now(lookout, plan)
        yield _covered(session, count, done)
        met = session.knowledge.error_mm <= session.bar_mm
        if count >= _MOST or (count >= _FEWEST and met):
            return None
        views, more = session.candidates()
        found = choose(session.knowledge, more, partial(session.goal, views))
        if isinstance(found, NoView):
            yield Say(f"{plan.name}: {found.reason}", "warning")
            return None
        sample = yield from lookout.take(
            found.place,
            name=f"{plan.name} view {count + 1}",
            role=NODE,
            words=f"to view {count + 1} at {plan.name}",
        )
        if isinstance(sample, Word):
            return sample
        failures += not (isinstance(sample, Sample) and sample.usable)
    return None


def _covered(session: NodeSession, count: int, done: float) -> Covered:
    covered = session.covered
    bars = (("settings", done), ("views", min(count / _FEWEST, 1.0)))
    return Covered(
        covered.grid if covered else (),
        (*bars, *(covered.bars if covered else ())),
        Forecast(
            f"the error of a point by d at {session.plan.name}",
            session.knowledge.error_mm if count else None,
            session.bar_mm,
            "mm",
        ),
    )
