"""The size of the target by caliper: asked once, kept, and used from then on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from calibration.targets import caliper
from calibration.wizard.caliper import READINGS, SQUARES, size_told
from calibration.wizard.camera_views import shape_prior
from calibration.wizard.lookout import layout_of
from calibration.wizard.session_store import SessionStore
from mvp.cell.calibrate_facts import keep_size, stored_size, target_facts
from mvp.cell.loading import load_cell
from mvp.errors import CalibrationError
from mvp.wizard import Ask, Say, SessionFacts, Word
from tests.wizard_play import played

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.wizard import Answer, Step

STATED = 15.0


@pytest.fixture(scope="module")
def facts() -> SessionFacts:
    cell = load_cell("virtual_uncalibrated")
    found = cell.calibrations
    return SessionFacts(
        key="hand-eye",
        cell="bench",
        simulated=True,
        date="2026-01-02",
        serials={},
        arm_model="ur5e",
        camera=found.camera,
        lens_table=found.lens_table,
        hand_eye=found.hand_eye,
        part_pose=found.part_pose,
        robot={"position_mm": 0.1, "angle_deg": 0.02},
        target=target_facts(cell.config.target),
        blur_circle_mm=0.0135,
        workspace_low_mm=(-900, -900, 20),
        workspace_high_mm=(900, 900, 1200),
    )


def told(store: SessionStore, **answers: list[Answer]) -> list[Step]:
    """What is shown while a person answers; the default where there is no answer."""
    return played(size_told(store), lambda asked: answers.get(asked.key, []))


def asked(shown: list[Step]) -> list[str]:
    return [step.key for step in shown if isinstance(step, Ask)]


def test_readings_give_size_and_sigma_and_are_used_at_once_and_when_reopened(
    facts: SessionFacts, tmp_path: Path
) -> None:
    store = SessionStore.create(tmp_path / "one", facts)
    readings: list[Answer] = ["150,3 150.34; 150.26"]
    told(store, caliper_squares=[10.0], caliper_readings_mm=readings)
    size = caliper([150.3, 150.34, 150.26], across=10)
    for one in (store, SessionStore.open(tmp_path / "one")):
        target = one.facts.target
        assert target is not None
        assert target.square_mm == pytest.approx(size.mm)
        assert target.square_sigma_mm == pytest.approx(size.sigma_mm)
        assert target.marker_mm == pytest.approx(10.5 * size.mm / STATED)
        assert layout_of(target).points_mm.max() == pytest.approx(11 * size.mm)
    assert asked(told(store)) == []


def test_unattended_the_cell_file_counts(facts: SessionFacts, tmp_path: Path) -> None:
    store = SessionStore.create(tmp_path / "one", facts)
    shown = told(store)
    assert asked(shown) == [SQUARES]
    assert store.facts.target == facts.target
    assert isinstance(shown[-1], Say)
    assert "as [target] of the cell file says" in shown[-1].text
    assert asked(told(store)) == []


def test_what_cannot_be_is_asked_again(facts: SessionFacts, tmp_path: Path) -> None:
    store = SessionStore.create(tmp_path / "one", facts)
    shown = told(
        store,
        caliper_squares=[10.0, 10.0, 10.0, 10.0],
        caliper_readings_mm=["wide", "135 150", "15.0", "150.2 150.2"],
    )
    assert asked(shown) == [SQUARES, READINGS] * 4
    warned = [s.text for s in shown if isinstance(s, Say) and s.grade == "warning"]
    assert "more than 2 %" in warned[1]
    assert "far from the 15 mm" in warned[2]
    assert store.facts.target is not None
    assert store.facts.target.square_mm == pytest.approx(15.02)


def test_a_word_instead_of_a_number_leaves_the_size_as_it_is(
    facts: SessionFacts, tmp_path: Path
) -> None:
    store = SessionStore.create(tmp_path / "one", facts)
    told(store, caliper_squares=[Word.FINISH])
    assert store.facts.target == facts.target


def test_later_calibrations_find_the_size_beside_the_cell(
    facts: SessionFacts, tmp_path: Path
) -> None:
    files = {"camera": tmp_path / "camera.json"}
    assert stored_size(files) is None
    keep_size(files, facts.target)
    assert stored_size(files) is None
    store = SessionStore.create(tmp_path / "one", facts)
    told(store, caliper_squares=[10.0], caliper_readings_mm=["150.2 150.3"])
    keep_size(files, store.facts.target)
    config = load_cell("virtual_uncalibrated").config.target
    assert config is not None
    again = target_facts(config, stored_size(files))
    assert again == store.facts.target
    other = config.model_copy(update={"rows": 10})
    assert target_facts(other, stored_size(files)) == target_facts(other)
    (tmp_path / "target_size.json").write_text("{}")
    with pytest.raises(CalibrationError, match="not the size of a target"):
        stored_size(files)


def stretch_of(store: SessionStore) -> float | None:
    return shape_prior(store.facts).stretch


@pytest.mark.parametrize(
    ("readings", "stretch"),
    [
        ("150.2 150.2", 3e-4),  # no caliper makes it exact
        ("150.0 150.6", 0.6 / 150.3),  # along and across differ
        ("150.2", None),  # one side tells nothing of the other
    ],
)
def test_readings_along_and_across_tell_how_stretched_the_print_can_be(
    readings: str, stretch: float | None, facts: SessionFacts, tmp_path: Path
) -> None:
    store = SessionStore.create(tmp_path / "one", facts)
    told(store, caliper_squares=[10.0], caliper_readings_mm=[readings])
    known = stretch_of(store)
    assert (known is None) == (stretch is None)
    if known is not None and stretch is not None:
        assert stretch <= known * 1.001 <= 1.3 * stretch


def test_without_readings_the_two_sides_are_known_as_well_as_the_squares(
    facts: SessionFacts, tmp_path: Path
) -> None:
    store = SessionStore.create(tmp_path / "one", facts)
    assert stretch_of(store) == pytest.approx(np.sqrt(2) * 0.01 / 15)


def test_what_is_known_of_flatness_comes_from_the_cell_file(
    facts: SessionFacts,
) -> None:
    assert facts.target is not None
    unknown = shape_prior(facts)
    assert unknown.flat_mm == pytest.approx(0.005 * 10 * STATED)
    glass = facts.target.model_copy(update={"flat_sigma_mm": 0.02})
    known = shape_prior(facts.model_copy(update={"target": glass}))
    assert known.flat_mm == 0.02
    assert list(known.sigmas) == [0.02] * 3 + [known.stretch, known.square]
    config = load_cell("virtual_uncalibrated").config.target
    assert config is not None
    stated = target_facts(config.model_copy(update={"flat_sigma_mm": 0.3}))
    assert stated is not None
    assert stated.flat_sigma_mm == 0.3
