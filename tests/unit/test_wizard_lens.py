"""The lens wizard on a small virtual cell whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.wizard.lens import LensWizard
from calibration.wizard.lens_motors import iris_views
from calibration.wizard.lens_node_result import node_of, plan_of
from calibration.wizard.lens_plan import Grid, focus_steps, plan_nodes, zoom_steps
from calibration.wizard.lens_travel import travelled
from calibration.wizard.lookout import Lookout
from calibration.wizard.session_store import SessionStore
from mvp.errors import CalibrationError
from mvp.optics import principal_distance_mm
from mvp.wizard import Allow, Ask, Covered, Say, WizardOptions, Word
from tests.small_cells import Cell


def test_nodes_are_planned_where_the_target_is_sharp_in_reach():
    cell = Cell("lens")
    try:
        grid = Grid(zooms=3, focuses=4, irises=3)
        plans = plan_nodes(cell.facts, grid, (150.0, 600.0))
        assert {plan.zoom for plan in plans} <= set(zoom_steps(cell.facts, 3))
        assert len({plan.zoom for plan in plans}) >= 2
        assert all(150 <= plan.sharp_mm <= 600 for plan in plans)
        steps = focus_steps(cell.facts, 4, zoom_steps(cell.facts, 3), (150.0, 600.0))
        assert {plan.focus for plan in plans} <= set(steps)
        with pytest.raises(CalibrationError, match="hardly any") as caught:
            plan_nodes(cell.facts, grid, (20.0, 25.0))
        assert "nearer" in caught.value.hint
    finally:
        cell.close()


@pytest.mark.full
def test_a_node_without_depth_of_field_is_measured_by_a_travel(tmp_path):
    cell = Cell("lens")
    try:
        store = lens_session(cell, tmp_path / "lens", tilts=False)
        (plan,) = plan_of(store)
        lookout = Lookout(cell.bench, store)
        lookout.set_lens(plan.steps)
        drained(travelled(lookout, plan))
        found = node_of(store, plan)
        true = cell.truth.setting(**plan.steps)
        f_cal = float(principal_distance_mm(true.d_mm, true.f_mm, true.e_mm))
        assert found is not None
        assert found.pictures is None
        assert abs(found.node.f_cal_mm - f_cal) < 3 * found.node.f_cal_sigma_mm
        assert found.node.pupil_mm is not None
        assert store.usable("travel")
    finally:
        cell.close()


def drained(generator, *answers):
    """What it returns, and what was shown; answers to ``Allow`` in turn, then True."""
    answer, shown, left = None, [], list(answers)
    while True:
        try:
            step = generator.send(answer)
        except StopIteration as end:
            return end.value, shown
        shown.append(step)
        answer = step.default if isinstance(step, Ask) else None
        if isinstance(step, Allow):
            answer = left.pop(0) if left else True


def lens_session(cell, folder, *, tilts):
    """A session with one node; in the middle of its zoom and focus."""
    store = SessionStore.create(folder, cell.facts)
    table = cell.facts.table
    zoom, focus = table.zoom.nearest_step(12.5), table.focus.nearest_step(0.33)
    iris = table.iris.nearest_step(3.0)
    store.remember("nodes", [[zoom, focus, iris, 470.0, int(tilts)]])
    return store


def asked_for(shown):
    return [step.text for step in shown if isinstance(step, Allow)]


def told_back(shown):
    return [s.text for s in shown if isinstance(s, Say) and "take" in s.text]


def test_undo_is_heard_in_every_phase_of_the_lens(tmp_path):
    """Before play, at a node and at the iris; the view is asked for once more."""
    cell = Cell("lens")
    try:
        store = lens_session(cell, tmp_path / "nodes", tilts=True)
        answers = [Word.UNDO, False, True, Word.UNDO, False, True, Word.FINISH]
        steps = LensWizard().steps(cell.bench, store, WizardOptions())
        shown = []
        with pytest.raises(CalibrationError, match="three usable views"):
            drained(noting(steps, shown), *answers)
        play, first, second = asked_for(shown)[0], *asked_for(shown)[2:4]
        assert asked_for(shown) == [play, play, first, second, play, first, second]
        assert told_back(shown) == [
            "there is nothing to take back",
            f"{first.removeprefix('to ').replace('view 1 at ', '')} view 1 is taken back",
        ]
        assert [sample.number for sample in store.samples] == [2]
        first_seen = [step for step in shown if isinstance(step, Covered)][1]
        assert np.sum(first_seen.grid) > 0
        assert "tilt about y" in dict(first_seen.bars)
        lookout = Lookout(cell.bench, store)
        word, shown = drained(iris_views(lookout, plan_of(store), 2), Word.UNDO)
        assert word is Word.UNDO
        assert store.count == 1
    finally:
        cell.close()


def noting(steps, shown):
    """The same steps, written down."""
    answer = None
    while True:
        try:
            step = steps.send(answer)
        except StopIteration as end:
            return end.value
        shown.append(step)
        answer = yield step


def test_a_stop_of_a_travel_that_is_taken_back_is_taken_again(tmp_path):
    cell = Cell("lens")
    try:
        store = lens_session(cell, tmp_path / "travel", tilts=False)
        (plan,) = plan_of(store)
        lookout = Lookout(cell.bench, store)
        lookout.set_lens(plan.steps)
        answers = [Word.UNDO]
        word, _ = drained(travelled(lookout, plan), *answers)
        assert word is Word.UNDO
        answers = [True, True, Word.UNDO, True, Word.FINISH]
        word, shown = drained(travelled(lookout, plan), *answers)
        assert word is Word.FINISH
        stops = [text.split()[2] for text in asked_for(shown)]
        assert stops == ["1", "2", "3", "2", "3"]
        assert [sample.number for sample in store.samples] == [1, 3]
    finally:
        cell.close()
