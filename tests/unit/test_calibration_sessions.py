"""Whole sessions on a cell whose truth is drawn: the truth lies where they say."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.wizard.lens import LensWizard
from calibration.wizard.session_store import SessionStore
from tools.bench_calibration_cell import DrawnCell
from tools.bench_calibration_sessions import coverage, lens_errors, lens_session


@pytest.fixture(scope="module")
def lens(tmp_path_factory):
    cell = DrawnCell(1)
    folder = tmp_path_factory.mktemp("drawn") / "lens"
    yield cell, folder, lens_session(cell, folder)
    cell.close()


@pytest.mark.full
@pytest.mark.timeout(3600)
def test_a_whole_lens_session_states_how_far_it_is_from_the_truth(lens):
    cell, _, outcome = lens
    assert outcome.quality.verdict != "no-go", outcome.quality.reasons
    ratios = np.array([ratio for _, ratio in lens_errors(cell, outcome)])
    assert (np.abs(ratios) < 3.5).all(), ratios
    assert np.sqrt((ratios**2).mean()) < 1.8


@pytest.mark.full
@pytest.mark.timeout(3600)
def test_the_play_of_every_motor_is_that_of_the_lens(lens):
    cell, _, outcome = lens
    for name in ("zoom_f_mm", "focus_extension_mm", "iris_a_mm"):
        found = getattr(outcome.document, name).backlash_steps
        true = getattr(cell.lens_file, name).backlash_steps
        assert found == pytest.approx(true, abs=0.2 * true + 1), name


@pytest.mark.full
@pytest.mark.timeout(3600)
def test_a_lens_session_gives_the_same_numbers_again(lens):
    _, folder, outcome = lens
    again = LensWizard().outcome(SessionStore.open(folder))
    assert again.document == outcome.document


def test_errors_as_large_as_stated_are_counted_as_two_thirds_and_nineteen_of_twenty():
    rng = np.random.default_rng(0)
    rows = [("lens f", value) for value in rng.normal(size=4000)]
    *_, last = coverage(rows)
    assert last.startswith("| lens | 4000 | 68 % | 95 % | 1.0")
