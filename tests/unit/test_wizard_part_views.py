"""Which views the part wizard takes: in vain, taken back, refused, after a crash."""

from __future__ import annotations

import pytest

from calibration.wizard.part import PartWizard
from calibration.wizard.session_store import SessionStore
from mvp.errors import CalibrationError
from mvp.wizard import Allow, WizardOptions, Word
from tests.part_bench import DrawnBench, carried_out, driven, only_views
from tests.wizard_play import broken_off, taken_back


def test_a_session_without_its_held_out_view_is_not_a_go(tmp_path):
    answers = [True, True, True, Word.FINISH]
    outcome, _, _ = carried_out(DrawnBench(10), tmp_path / "session", answers)
    assert "not-verified" in {cause.code for cause in outcome.quality.causes}


def test_a_view_in_vain_is_tried_again_to_test_the_place_when_no_other_is_left(
    tmp_path,
):
    bench = DrawnBench(12, sides=4, astray=1)
    outcome, _, store = carried_out(bench, tmp_path / "session")
    tried = [(one.name, one.role, one.usable) for one in store.samples]
    assert tried[0] == ("v1", "calibration", False)
    assert tried[-1] == ("v1", "verification", True)
    assert len(tried) == 5
    assert "not-verified" not in {cause.code for cause in outcome.quality.causes}


def test_a_session_that_broke_off_goes_on_with_the_next_view(tmp_path):
    bench = DrawnBench(1)
    folder = tmp_path / "session"
    carried_out(bench, folder, options=only_views(1))
    store = SessionStore.open(folder, repair=True)
    first = [sample.name for sample in store.samples]
    driven(bench, store, options=only_views(2))
    names = [sample.name for sample in store.samples]
    assert names[:1] == first == ["v1"]
    assert len(set(names)) == len(names) == 2


def test_the_last_view_can_be_taken_back_and_enough_is_enough(tmp_path):
    answers = [True, True, Word.UNDO, True, Word.FINISH]
    _, _, store = carried_out(DrawnBench(2), tmp_path / "session", answers)
    assert [sample.name for sample in store.samples] == ["v1", "aside 1"]


def test_a_view_taken_back_at_the_held_out_one_is_taken_again(tmp_path):
    """Also when the session breaks off there."""
    bench, options = DrawnBench(2), WizardOptions(auto=True)
    store = SessionStore.create(tmp_path / "session", bench.facts)
    steps = PartWizard().steps(bench, store, options)
    shown = broken_off(steps, True, True, True, Word.UNDO)
    views = [step.text.split(": ")[1] for step in shown if isinstance(step, Allow)]
    assert views == ["v1", "aside 1", "aside 2", "aside 3", "aside 2"]
    assert taken_back(shown) == ["aside 2 is taken back"]
    store = SessionStore.open(store.path, repair=True)
    broken_off(PartWizard().steps(bench, store, options), True, True)
    assert [(s.number, s.name, s.role) for s in store.samples] == [
        (1, "v1", "calibration"),
        (2, "aside 1", "calibration"),
        (4, "aside 2", "calibration"),
        (5, "aside 3", "verification"),
    ]


def test_a_view_that_the_arm_cannot_take_is_said_and_left_out(tmp_path):
    bench = DrawnBench(3, refused=(2,))
    two = only_views(2)
    _, shown, store = carried_out(bench, tmp_path / "session", options=two)
    assert any("out of reach" in getattr(step, "text", "") for step in shown)
    assert "aside 1" not in {sample.name for sample in store.samples}


def test_a_bench_without_a_picture_says_what_to_look_at(tmp_path):
    bench = DrawnBench(5, refused=(1, 2, 3, 4))
    with pytest.raises(CalibrationError) as caught:
        carried_out(bench, tmp_path / "session")
    assert "part_pose" in caught.value.hint
