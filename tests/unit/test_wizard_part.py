"""Where the part wizard finds a drawn block, and how well it says that it knows."""

from __future__ import annotations

import json

import numpy as np
import pytest

from calibration.part_pose import judge_resection
from calibration.wizard.part import PartWizard
from calibration.wizard.part_result import found_of
from calibration.wizard.session_store import SessionStore
from mvp.calibrated.content import content_sha256
from mvp.cell.calibrate_result import keep_result
from mvp.wizard import WizardOptions
from tests.complete_results import missing_of
from tests.part_bench import EYE, NOISE_PX, DrawnBench, carried_out, only_views, pull


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    bench = DrawnBench()
    folder = tmp_path_factory.mktemp("part") / "session"
    return (bench, *carried_out(bench, folder))


def test_a_part_is_found_within_its_stated_uncertainty(session):
    bench, outcome, _, _ = session
    assert outcome.quality.verdict == "go", outcome.quality.reasons
    assert pull(outcome, bench) < 16.8  # 99 % of a chi-square with 6 degrees of freedom
    assert outcome.quality.error_95_mm < 0.6
    assert "mm" in outcome.lines[0]


def test_the_result_says_how_it_depends_on_the_hand_eye_transform(session):
    bench, outcome, _, _ = session
    assert outcome.document.hand_eye_sha256 == content_sha256(bench.facts.hand_eye)
    lever = np.array(outcome.document.by_hand_eye)
    total = np.array(outcome.document.covariance)
    alone = total - lever @ EYE @ lever.T
    assert np.linalg.eigvalsh(alone).min() > 0


def test_the_expected_error_at_the_views_of_the_plan_is_compared_with_its_room(session):
    _, outcome, _, _ = session
    (line,) = (text for text in outcome.lines if "v1" in text)
    assert "the plan bears 3.00 mm and 0.80 deg" in line


def test_a_stored_session_gives_the_same_numbers_again(session):
    _, outcome, _, store = session
    again = PartWizard().outcome(SessionStore.open(store.path))
    assert again.document.model_dump_json() == outcome.document.model_dump_json()
    assert again.lines == outcome.lines


def test_a_view_that_was_kept_apart_tests_the_place_in_mm(session):
    _, outcome, _, store = session
    (kept,) = store.usable("verification")
    held = outcome.details["verification"]
    assert [view.name for view in held.views] == [kept.name]
    assert 0.05 < held.ratio < 3
    assert outcome.quality.out_of_sample_mm == pytest.approx(held.error)
    (line,) = (text for text in outcome.lines if "held-out" in text)
    assert f"off by {held.error:.3g} mm" in line


def test_a_part_that_was_knocked_aside_before_the_held_out_view_is_noticed(tmp_path):
    bench = DrawnBench(9, knocked_after=3)
    outcome, _, store = carried_out(bench, tmp_path / "session")
    (kept,) = store.usable("verification")
    causes = {cause.code: cause for cause in outcome.quality.causes}
    assert kept.name in causes["held-out-view-does-not-fit"].message
    assert outcome.quality.verdict != "go"


def test_a_part_that_is_found_for_a_run_is_tested_by_the_run(tmp_path):
    outcome, _, store = carried_out(
        DrawnBench(11), tmp_path / "session", options=only_views(3)
    )
    assert not store.usable("verification")
    assert outcome.quality.verdict == "go"
    assert outcome.quality.out_of_sample_mm < 1.0
    assert any("no view was kept apart" in line for line in outcome.lines)


def test_nothing_is_left_open_in_the_result(session):
    _, outcome, _, store = session
    document = keep_result(store.path / "part_pose.json", store, outcome)
    assert missing_of(json.loads(document.model_dump_json(by_alias=True))) == []
    (before,) = (text for text in outcome.lines if "calibration before" in text)
    assert document.comparison.words in before
    assert document.comparison.alarm == ("ALARM" in before)


def test_residuals_are_kept_place_by_place_and_square_to_edges(session):
    _, outcome, _, _ = session
    found = outcome.details["found"]
    for one, kept in zip(found.pictured, outcome.points, strict=True):
        lengths = np.hypot(kept.dx_px, kept.dy_px)
        whitened = np.abs(one.resection.best.estimate.residuals)
        assert lengths == pytest.approx(whitened * NOISE_PX, abs=2e-4)
        assert kept.view == one.sample.name


def test_a_dark_picture_of_the_part_is_exposed_longer(session):
    *_, store = session
    assert all(sample.exposure_s >= 0.02 for sample in store.samples)


def test_a_line_that_was_taken_for_another_is_left_out(tmp_path):
    bench = DrawnBench(4, wrong_px=4.0)
    two = WizardOptions(most_samples=2)
    outcome, _, store = carried_out(bench, tmp_path / "session", options=two)
    assert all(sample.extra["sight"]["left_out"] for sample in store.samples)
    assert outcome.quality.verdict == "go"
    assert pull(outcome, bench) < 22.5


def test_a_plan_with_less_room_than_the_errors_is_told(tmp_path):
    tight = {"position_mm": 0.02, "angle_deg": 5.0}
    one = only_views(1)
    bench = DrawnBench(6, planned=tight)
    outcome, _, _ = carried_out(bench, tmp_path / "session", options=one)
    causes = {cause.code: cause for cause in outcome.quality.causes}
    assert "room that the plan has" in causes["plan-has-less-room"].message
    assert outcome.quality.verdict == "no-go"


def test_the_mirror_image_of_a_flat_outline_is_reported(tmp_path):
    """From one far picture of one face only; several sides then settle it."""
    bench = DrawnBench(7, flat=True)
    _, _, store = carried_out(bench, tmp_path / "one", options=only_views(1))
    (pictured,) = found_of(store).pictured
    assert len(pictured.resection.branches) > 1
    codes = judge_resection(pictured.sight, pictured.resection).codes()
    assert ("mirror-ambiguity" in codes) == pictured.resection.ambiguous
    more, _, _ = carried_out(
        DrawnBench(7, flat=True),
        tmp_path / "more",
        options=only_views(2),
    )
    assert "mirror-ambiguity" not in {cause.code for cause in more.quality.causes}
    assert pull(more, bench) < 22.5


def test_how_far_the_part_was_off_is_said_in_mm(tmp_path):
    bench = DrawnBench(8, shifted_mm=(3.0, -4.0, 0.0))
    one = only_views(1)
    outcome, _, _ = carried_out(bench, tmp_path / "session", options=one)
    found = outcome.details["found"]
    assert found.moved_mm == pytest.approx(5.0, abs=0.8)


def test_the_report_shows_every_picture(session):
    _, outcome, _, store = session
    page = PartWizard().page(store, outcome)
    assert all(sample.name in page for sample in store.samples)
    assert 'src="http' not in page


@pytest.mark.full
def test_stated_intervals_hold_the_errors_of_many_sessions(tmp_path):
    pulls, ratios = [], []
    for seed in range(60):
        bench = DrawnBench(100 + seed)
        outcome, _, _ = carried_out(bench, tmp_path / str(seed))
        pulls.append(pull(outcome, bench))
        ratios.append(outcome.details["verification"].ratio)
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.25
    assert np.mean(pulls) == pytest.approx(6.0, abs=1.6)
    assert np.mean(np.array(pulls) < 12.59) > 0.86  # 95 % expected
