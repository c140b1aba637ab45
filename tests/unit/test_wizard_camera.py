"""The camera wizard on a small virtual cell; whole sessions are run by the command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibration.wizard.camera import CameraWizard
from calibration.wizard.session_store import SessionStore
from mvp.wizard import WizardOptions, Word
from tests.small_cells import Cell
from tests.wizard_play import broken_off, motions_of, taken_back

if TYPE_CHECKING:
    from pathlib import Path


def test_a_view_taken_back_at_the_first_held_out_one_is_taken_again(
    tmp_path: Path,
) -> None:
    """Also when the session breaks off there."""
    cell, wizard = Cell("camera"), CameraWizard()
    try:
        store = SessionStore.create(tmp_path / "session", cell.facts)
        two = WizardOptions(auto=True, most_samples=2)
        steps = wizard.steps(cell.bench, store, two)
        shown = broken_off(steps, True, True, True, True, Word.UNDO)
        assert [sample.number for sample in store.usable()] == [2]
        assert motions_of(shown)[-3:] == [
            "to view 4",
            "to held-out view 1",
            "to view 5",
        ]
        assert taken_back(shown) == ["view 4 is taken back"]
        store = SessionStore.open(store.path, repair=True)
        steps = wizard.steps(cell.bench, store, two)
        shown = broken_off(steps, True, True)
        ways = ["to view 5", "to view 6", "to held-out view 1"]
        assert motions_of(shown) == ways
        assert [sample.number for sample in store.usable()] == [2, 6]
    finally:
        cell.close()
