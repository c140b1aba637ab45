"""The lens wizard: what the motors of a lens do, from pictures of a target.

Play of the motors first; then tilted views at settings of zoom and focus, chosen by what
they tell about d; the sharp distance of each from how the edges blur over depth; the
pupil at several irises; and held-out views at settings between all of these.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibration.wizard.lens_motors import best_node, both_sides, iris_views, plan_sides
from calibration.wizard.lens_node_result import PLAN, plan_of
from calibration.wizard.lens_nodes import NODE, NodeSession, samples_of, tilted_views
from calibration.wizard.lens_page import page_of
from calibration.wizard.lens_plan import between, node_at, plan_nodes, zoom_steps
from calibration.wizard.lens_result import (
    KEY,
    VERIFICATION,
    outcome_of,
)
from calibration.wizard.lens_travel import travelled
from calibration.wizard.lookout import Lookout, camera_at, target_of
from calibration.wizard.next_pose import NoView, ViewRange, candidate_views, first_of
from calibration.wizard.phases import take_back
from calibration.wizard.preflight import before_pictures, temperature_told
from calibration.wizard.session_store import Sample, SessionStore
from mvp.errors import CalibrationError
from mvp.wizard import Outcome, Refusal, Say, Word

if TYPE_CHECKING:
    from collections.abc import Generator

    from pydantic import JsonValue

    from calibration.wizard.lens_plan import Grid, NodePlan
    from mvp.wizard import Answer, Bench, Step, WizardOptions

_DISTANCES_MM = np.geomspace(110.0, 900.0, 16)
_PLACES, _FEWEST_PLACES = 10, 2
_HELD_OUT_SETTINGS, _HELD_OUT_VIEWS, _MOST_FAILURES = 2, 2, 6


class LensWizard:
    """``mvp-cell calibrate lens``.

    Args:
        grid: how many settings of each motor; None: as the cell file says.
    """

    key: ClassVar[str] = KEY
    writes: ClassVar[str] = "lens_table"
    sessions: ClassVar[type[SessionStore]] = SessionStore

    def __init__(self, grid: Grid | None = None) -> None:
        self._grid = grid

    def steps(
        self, bench: Bench, store: SessionStore, options: WizardOptions
    ) -> Generator[Step, Answer, Outcome]:
        """Play, nodes, iris, held-out settings; see ``Wizard``."""
        lookout = Lookout(bench, store)
        yield from temperature_told(store)
        yield from before_pictures(store)
        plans = yield from _planned(lookout, self._grid or store.facts.lens_grid)
        finished: set[tuple[int, int]] = set()
        while (yield from self._phases(lookout, plans, finished)) is Word.UNDO:
            undone = yield from take_back(store)
            if undone is not None:
                steps = undone.lens_steps
                finished.discard((steps["zoom"], steps["focus"]))
        return self.outcome(store)

    def _phases(
        self,
        lookout: Lookout,
        plans: tuple[NodePlan, ...],
        finished: set[tuple[int, int]],
    ) -> Generator[Step, Answer, Word | None]:
        """Each goes on from what there is; ends early with the word that was said.

        Args:
            lookout: looks and drives.
            plans: the nodes.
            finished: zoom and focus of nodes that need no further view, or got none.
        """
        irises = (self._grid or lookout.facts.lens_grid).irises
        word = yield from _play(lookout, plans)
        for number, plan in enumerate(plans):
            if word is not None:
                return word
            if (plan.zoom, plan.focus) in finished:
                continue
            lookout.set_lens(plan.steps)
            word = yield from _node(lookout, plan, number / len(plans))
            if word is None:
                finished.add((plan.zoom, plan.focus))
        if word is None:
            word = yield from iris_views(lookout, plans, irises)
        if word is None:
            word = yield from _held_out(lookout, plans)
        return word

    def outcome(self, store: SessionStore) -> Outcome:
        """From the folder alone; see ``Wizard``."""
        return outcome_of(store)

    def page(self, store: SessionStore, outcome: Outcome) -> str:
        """The report; see ``Wizard``."""
        return page_of(store, outcome)


def _planned(
    lookout: Lookout, grid: Grid
) -> Generator[Step, Answer, tuple[NodePlan, ...]]:
    """The settings of the session; planned once."""
    store = lookout.store
    target_of(store.facts)
    if not plan_of(store):
        reach = _reach_mm(lookout, grid)
        plans = plan_nodes(store.facts, grid, reach)
        rows: list[JsonValue] = [
            [p.zoom, p.focus, p.iris, p.sharp_mm, int(p.tilts)] for p in plans
        ]
        store.remember(PLAN, rows)
        yield Say(
            f"the target can be seen from {reach[0]:.0f} to {reach[1]:.0f} mm: "
            f"{len(plans)} settings of zoom and focus are sharp there"
        )
    return plan_of(store)


def _reach_mm(lookout: Lookout, grid: Grid) -> tuple[float, float]:
    """Distances from which the arm can look at the target.

    Raises:
        CalibrationError: from none.
    """
    facts = lookout.facts
    table = facts.table
    zooms = zoom_steps(facts, grid.zooms, grid.f_mm)
    middle = (int(np.mean(zooms)), int(np.mean(table.focus.range_steps)))
    plan = node_at(facts, *middle)
    lens = facts.lens_at(plan.steps)
    camera = camera_at(facts, lens)
    aim = lookout.aim([s for s in lookout.store.samples if s.usable], lens.d_mm)
    able = []
    for distance in _DISTANCES_MM:
        within = ViewRange(
            0.97 * distance, 1.03 * distance, tilt_rad=0.5, share=0.0, fill=0.0
        )
        views = candidate_views(
            camera,
            lookout.size_px,
            lookout.points_mm,
            within,
            lookout.bench.rng(0),
            count=_PLACES,
        )
        poses = aim.tool_for(views.camera_from_target)
        believed = facts.tool_from_camera(lens.d_mm)
        stands = 0
        for k in range(len(views)):
            pose = poses.pose(k, "base", "tool") @ believed
            found = lookout.bench.joints_for(pose, d_mm=lens.d_mm)
            stands += not isinstance(found, Refusal)
        if stands >= _FEWEST_PLACES:
            able.append(float(distance))
    if not able:
        raise CalibrationError(
            "the arm cannot look at the target from anywhere",
            hint="place the target within reach, and correct [target] of the cell file",
            where=facts.cell,
        )
    return min(able), max(able)


def _play(
    lookout: Lookout, plans: tuple[NodePlan, ...]
) -> Generator[Step, Answer, Word | None]:
    if not lookout.bench.drives_straight:
        yield Say(
            "this lens cannot be driven without a run-up: its play is not measured",
            "warning",
        )
        return None
    facts = lookout.facts
    word = yield from both_sides(
        lookout, best_node(facts, plans), plan_sides(facts, plans)
    )
    return word


def _node(
    lookout: Lookout, plan: NodePlan, done: float
) -> Generator[Step, Answer, Word | None]:
    """Tilted views where the depth of field bears them, else frontal and travel."""
    if plan.tilts:
        word = yield from tilted_views(lookout, plan, done)
        return word
    try:
        word = yield from travelled(lookout, plan)
    except CalibrationError as error:
        yield Say(f"{plan.name}: {error.message}; {error.hint}", "warning")
        return None
    return word


def _held_out(
    lookout: Lookout, plans: tuple[NodePlan, ...]
) -> Generator[Step, Answer, Word | None]:
    """Two views at each of some settings that are no nodes."""
    yield Say("held-out settings: they take no part in the table, and test it")
    for plan in held_out_settings(lookout, plans):
        lookout.set_lens(plan.steps)
        failures = 0
        while failures < _MOST_FAILURES:
            mine = samples_of(lookout.store.usable(VERIFICATION), plan.zoom, plan.focus)
            if len(mine) >= _HELD_OUT_VIEWS:
                break
            sample = yield from _one_held_out(lookout, plan, len(mine) + 1)
            if isinstance(sample, Word):
                return sample
            failures += not (isinstance(sample, Sample) and sample.usable)
    return None


def _one_held_out(
    lookout: Lookout, plan: NodePlan, number: int
) -> Generator[Step, Answer, Sample | Word | None]:
    session = NodeSession.now(lookout, plan)
    views, _ = session.candidates()
    tilt = views.camera_from_target.rotation[:, 2, 2]
    order = np.argsort(np.abs(tilt - np.cos(np.radians(30))), kind="stable")
    found = first_of(len(order), lambda k: session.goal(views, int(order[k])))
    if isinstance(found, NoView):
        yield Say(f"{plan.name}: {found.reason}", "warning")
        return Word.FINISH
    sample = yield from lookout.take(
        found,
        name=f"held-out {plan.name} view {number}",
        role=VERIFICATION,
        words=f"to held-out view {number} at {plan.name}",
    )
    return sample


def held_out_settings(lookout: Lookout, plans: tuple[NodePlan, ...]) -> list[NodePlan]:
    """Half-way between nodes in zoom and in focus, where both are sharp in reach."""
    facts = lookout.facts
    low, high = min(p.sharp_mm for p in plans), max(p.sharp_mm for p in plans)
    every = [
        node_at(facts, zoom, focus)
        for zoom in between([p.zoom for p in plans])
        for focus in between([p.focus for p in plans])
    ]
    good = [plan for plan in every if low <= plan.sharp_mm <= high]
    count = min(_HELD_OUT_SETTINGS, len(good))
    return [good[round(k)] for k in np.linspace(0, len(good) - 1, count)]


__all__ = ["NODE", "LensWizard", "held_out_settings"]
