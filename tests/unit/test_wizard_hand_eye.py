"""The hand-eye wizard on a small virtual cell whose truth is known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from calibration.hand_eye import HandEyeData, Rehearsal, rehearse
from calibration.hand_eye import calibrate_hand_eye as calibrated
from calibration.wizard.hand_eye import HandEyeWizard
from calibration.wizard.session_store import SessionStore
from calibration.wizard.verification import (
    HeldOutView,
    Verification,
    verify_hand_eye,
)
from mvp.cell.calibrate_result import keep_result
from mvp.errors import CalibrationError
from mvp.kinematics import tool_from_camera_at
from mvp.wizard import Allow, Ask, Covered, WizardOptions, Word
from tests.complete_results import missing_of
from tests.small_cells import REFERENCE_D, ROBOT, Cell
from tests.wizard_play import broken_off, motions_of, taken_back


def driven(wizard, cell, store, answers=None, most=None):
    """All steps of a wizard, and its outcome; motion is allowed unless told otherwise."""
    steps, answer = [], None
    generator = wizard.steps(
        cell.bench, store, WizardOptions(auto=True, most_samples=most)
    )
    while True:
        try:
            step = generator.send(answer)
        except StopIteration as end:
            return steps, end.value
        steps.append(step)
        answer = None
        if isinstance(step, Allow):
            answer = next(answers, True) if answers else True
        if isinstance(step, Ask):
            answer = step.default


@pytest.fixture(scope="module")
def hand_eye(tmp_path_factory):
    too_high = 520.0
    cell = Cell(
        "hand-eye",
        forbids=lambda pose: "too high" if pose.translation_mm[2] > too_high else "",
    )
    store = SessionStore.create(tmp_path_factory.mktemp("s") / "one", cell.facts)
    answers = iter([True, True, False, True, Word.UNDO, True])
    steps, outcome = driven(HandEyeWizard(), cell, store, answers, most=8)
    yield cell, store, steps, outcome
    cell.close()


def test_hand_eye_comes_out_within_what_is_stated(hand_eye):
    cell, store, _, outcome = hand_eye
    assert {cause.code for cause in outcome.quality.causes} == {"few-views"}
    solution = outcome.details["result"].solution
    lens = cell.truth.setting(**store.samples[0].lens_steps)
    true = tool_from_camera_at(cell.hand, d_mm=lens.d_mm, reference_d_mm=REFERENCE_D)
    point = np.array([0.0, 0.0, outcome.details["stand_off_mm"]])
    off = solution.moving_from_camera.apply(point) - true.apply(point)
    assert np.linalg.norm(off) < 3 * solution.error_mm(float(point[2]))
    assert np.linalg.norm(off) < 0.5


def test_the_file_says_to_which_lens_setting_hand_eye_belongs(hand_eye):
    cell, store, _, outcome = hand_eye
    lens = cell.facts.lens_at(store.samples[0].lens_steps)
    document = outcome.document
    assert document.reference_d_mm == pytest.approx(lens.d_mm)
    assert document.reference_f_mm == pytest.approx(lens.f_mm)
    assert document.provenance.origin == "measured"
    assert document.provenance.serial_numbers["arm"] == "A-1"
    assert document.provenance.device_serial == "A-1"


def test_no_view_is_proposed_where_the_bench_forbids_it(hand_eye):
    cell, _, _, _ = hand_eye
    d_mm = REFERENCE_D
    for joints in cell.bench.moves:
        camera = cell.bench.arm.forward(joints) @ cell.facts.tool_from_camera(d_mm)
        assert camera.translation_mm[2] < 521.0


def test_picture_tilts_and_sizes_are_shown_while_views_are_taken(hand_eye):
    _, _, steps, _ = hand_eye
    last = [step for step in steps if isinstance(step, Covered)][-1]
    assert np.sum(last.grid) > 0
    assert {"views", "picture", "border", "tilt about x", "sizes"} <= dict(
        last.bars
    ).keys()


def test_what_was_refused_or_taken_back_is_no_sample(hand_eye):
    _, store, steps, _ = hand_eye
    allowed = [step for step in steps if isinstance(step, Allow)]
    assert len(allowed) == len(cell_moves(hand_eye)) + 2
    numbers = [sample.number for sample in store.samples]
    assert len(numbers) == len(set(numbers))
    assert store.count == len(cell_moves(hand_eye)) - 1


def cell_moves(hand_eye):
    return hand_eye[0].bench.moves


def test_a_session_gives_the_same_numbers_again(hand_eye):
    _, store, _, outcome = hand_eye
    again = HandEyeWizard().outcome(SessionStore.open(store.path))
    assert again.document == outcome.document


def test_held_out_views_had_no_part(hand_eye):
    _, store, _, outcome = hand_eye
    held = outcome.details["verification"]
    assert len(held.views) == 4
    names = {view.name for view in held.views}
    assert names.isdisjoint(view.name for view in outcome.quality.views)
    assert held.ratio < 3
    assert len(store.usable("verification")) == 4


def test_nothing_is_left_open_in_the_result(hand_eye):
    _, store, _, outcome = hand_eye
    document = keep_result(store.path / "hand_eye.json", store, outcome)
    assert missing_of(json.loads(document.model_dump_json(by_alias=True))) == []
    lengths = np.concatenate([np.hypot(p.dx_px, p.dy_px) for p in outcome.points])
    assert outcome.quality.rms_px == pytest.approx(
        np.sqrt((lengths**2).mean()), rel=0.01
    )


def test_a_session_without_a_usable_view_says_what_to_do(tmp_path, hand_eye):
    store = SessionStore.create(tmp_path / "empty", hand_eye[0].facts)
    with pytest.raises(CalibrationError, match="no picture") as caught:
        HandEyeWizard().outcome(store)
    assert "light" in caught.value.hint


def test_a_view_taken_back_at_the_first_held_out_one_is_taken_again(tmp_path):
    """Also when the session breaks off there; the two views are refused by name."""
    cell, wizard = Cell("hand-eye"), HandEyeWizard()
    try:
        store = SessionStore.create(tmp_path / "session", cell.facts)
        two = WizardOptions(auto=True, most_samples=2)
        steps = wizard.steps(cell.bench, store, two)
        shown = broken_off(steps, True, True, Word.UNDO)
        ways = ["to view 1", "to view 2", "to held-out view 1", "to view 2"]
        assert motions_of(shown) == ways
        assert taken_back(shown) == ["view 2 is taken back"]
        store = SessionStore.open(store.path, repair=True)
        steps = wizard.steps(cell.bench, store, two)
        shown = broken_off(steps, True, Word.FINISH)
        assert motions_of(shown) == ["to view 2", "to held-out view 1"]
        assert [(s.number, s.name) for s in store.samples] == [
            (1, "view 1"),
            (3, "view 2"),
        ]
    finally:
        cell.close()
    outcome = wizard.outcome(store)
    assert "few-views" in {cause.code for cause in outcome.quality.causes}
    result = keep_result(store.path / "hand_eye.json", store, outcome)
    assert missing_of(json.loads(result.model_dump_json(by_alias=True))) == []


# ------------------------------------------------------------------------ verification


def test_held_out_errors_are_as_large_as_foretold_and_a_slipped_camera_is_seen():
    rng = np.random.default_rng(5)
    told = rehearse(Rehearsal(views=26, robot=ROBOT), rng)
    camera = Rehearsal().camera
    found = calibrated(told.data.of_views(range(20)), camera, ROBOT).solution
    held = told.data.of_views(range(20, 26))
    good = verify_hand_eye(found, held)
    assert 0.4 < good.ratio < 1.8
    assert not good.causes()
    slipped = HandEyeData(
        held.base_from_tool,
        replace(held.seen, pixels=held.seen.pixels + np.array([12.0, 0.0])),
        held.mount,
        held.sigma_px,
    )
    bad = verify_hand_eye(found, slipped)
    assert bad.ratio > 3
    (cause,) = bad.causes()
    assert cause.code == "held-out-view-does-not-fit"
    assert "view" in cause.message


def test_a_result_without_held_out_views_is_not_verified():
    nothing = Verification("d", ())
    assert [cause.code for cause in nothing.causes()] == ["not-verified"]
    assert np.isnan(nothing.error)
    one = Verification("d", (HeldOutView("v", 0.02, 0.01),))
    assert one.ratio == pytest.approx(2.0)
    assert not one.causes()
    assert "2.0 times" in one.words
