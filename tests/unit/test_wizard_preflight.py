"""What is asked before the first picture, and the touch test after the last one."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from calibration.hand_eye import Rehearsal, RobotNoise, calibrate_hand_eye, rehearse
from calibration.wizard.camera import CameraWizard
from calibration.wizard.hand_eye import HandEyeWizard
from calibration.wizard.lens import LensWizard
from calibration.wizard.part import PartWizard
from calibration.wizard.preflight import FLAT, WARM, before_pictures, temperature_told
from calibration.wizard.provenance import TEMPERATURE, temperature_of
from calibration.wizard.session_store import SessionStore
from calibration.wizard.touch import TOUCHED, touched, with_touch
from mvp.calibrated import Quality, VerdictCause
from mvp.cell.calibration_gates import IMPORTED
from mvp.cli.wizard_view import TerminalView
from mvp.wizard import Ask, Outcome, Say, Wait, WizardOptions, Word
from tests import wizard_play
from tests.small_cells import Cell

if TYPE_CHECKING:
    from collections.abc import Generator
    from pathlib import Path

    from calibration.hand_eye import HandEyeResult
    from mvp.wizard import Answer, Step


@dataclass
class Kept:
    """What a session remembers, in memory."""

    temperature_c: float | None = 20.0
    kept: dict[str, Any] = field(default_factory=dict)
    target: Any = None

    @property
    def facts(self) -> Any:
        return SimpleNamespace(
            temperature_c=self.temperature_c,
            target=self.target,
            robot=SimpleNamespace(position_mm=0.1),
        )

    def recall(self, key: str) -> Any:
        return self.kept.get(key)

    def remember(self, key: str, value: Any) -> None:
        self.kept[key] = value


def played(steps: Generator[Step, Answer, None], *answers: Answer) -> list[Step]:
    """All steps; questions get these answers in turn, then their defaults."""
    left = list(answers)
    return wizard_play.played(steps, lambda asked: left)


def test_a_warm_cell_with_a_flat_target_is_asked_twice_and_told_nothing() -> None:
    store = Kept()
    steps = played(before_pictures(store))
    assert [type(step) for step in steps] == [Ask, Ask]
    assert store.kept == {WARM: 30.0, FLAT: True}
    assert played(before_pictures(store)) == []  # a resumed session


def test_a_camera_that_was_just_switched_on_is_waited_for() -> None:
    store = Kept()
    steps = played(before_pictures(store), 10.0, True)
    (wait,) = (step for step in steps if isinstance(step, Wait))
    assert wait.seconds == 20 * 60
    assert store.kept[WARM] == 30.0


def test_who_does_not_wait_is_warned_and_the_session_says_so() -> None:
    store = Kept()
    steps = played(before_pictures(store), 4.0, False, False)
    said = [step.text for step in steps if isinstance(step, Say)]
    assert "not warm" in said[0]
    assert "0.03 % of the focal length" in said[1]
    assert store.kept == {WARM: 4.0, FLAT: False}
    assert not any(isinstance(step, Wait) for step in steps)


def test_a_temperature_that_cell_file_or_device_tell_is_not_asked() -> None:
    assert played(temperature_told(Kept())) == []


@pytest.mark.parametrize(
    ("typed", "kept"),
    [
        ("21.5", 21.5),
        ("21,5", 21.5),
        ("21 C", 21.0),
        ("21 \N{DEGREE SIGN}C", 21.0),
        ("21.5C", 21.5),
        (None, "unknown"),
        ("", "unknown"),
        ("Unknown", "unknown"),
    ],
)
def test_the_operator_is_asked_for_the_temperature_once(
    typed: Answer, kept: float | str
) -> None:
    store: Any = Kept(temperature_c=None)
    asked, *said = played(temperature_told(store), *([typed] if typed else []))
    assert isinstance(asked, Ask)
    assert asked.default == "unknown"
    assert store.kept == {TEMPERATURE: kept}
    warnings = [step.grade for step in said if isinstance(step, Say)]
    known = kept != "unknown"
    assert warnings == ([] if known else ["warning"])
    told = (kept, "operator") if known else (None, "unknown")
    assert temperature_of(store) == told
    assert played(temperature_told(store)) == []  # a resumed session


@pytest.mark.parametrize(
    ("typed", "why"),
    [
        ("warm", "warm is not a number of degrees Celsius"),
        ("294.6", "not between -40 and 90 deg C"),
        ("300 C", "not between -40 and 90 deg C"),
        ("nan", "not between -40 and 90 deg C"),
        (Word.UNDO, "nothing to take back"),
    ],
)
def test_a_mistyped_temperature_is_asked_again_with_the_reason(
    typed: Answer, why: str
) -> None:
    store: Any = Kept(temperature_c=None)
    first, said, second = played(temperature_told(store), typed, "21 C")
    assert isinstance(said, Say)
    assert why in said.text
    assert first == second
    assert store.kept == {TEMPERATURE: 21.0}


def test_every_wizard_asks_for_the_temperature_first(tmp_path: Path) -> None:
    cell = Cell("camera")
    try:
        for wizard in (CameraWizard(), LensWizard(), HandEyeWizard(), PartWizard()):
            store = SessionStore.create(tmp_path / wizard.key, cell.facts)
            steps = wizard.steps(cell.bench, store, WizardOptions())
            asked = next(step for step in steps if isinstance(step, Ask))
            assert asked.key == TEMPERATURE
    finally:
        cell.close()


def test_hand_eye_says_why_a_nominal_camera_is_poor_to_build_on(tmp_path: Path) -> None:
    said_of = {"few-views": "its data sheet is used", IMPORTED: "was imported"}
    cell = Cell("hand-eye")
    try:
        for code, words in said_of.items():
            cause = VerdictCause(code=code, grade="marginal", message="m", action="a")
            judged = Quality(verdict="marginal", causes=[cause])
            made = cell.facts.camera.provenance.model_copy(update={"origin": "nominal"})
            camera = cell.facts.camera.model_copy(
                update={"provenance": made, "quality": judged}
            )
            facts = cell.facts.model_copy(update={"camera": camera})
            store = SessionStore.create(tmp_path / code, facts)
            steps = HandEyeWizard().steps(cell.bench, store, WizardOptions())
            said = (step.text for step in steps if isinstance(step, Say))
            assert words in next(text for text in said if text.startswith("the camera"))
    finally:
        cell.close()


@pytest.mark.parametrize("simulated", [True, False])
def test_a_terminal_counts_down_but_nothing_simulated_warms_up(simulated: bool) -> None:
    slept: list[float] = []
    view = TerminalView(simulated=simulated, auto=True, yes=True, sleep=slept.append)
    assert view.answer(Wait("warming up", 2.5)) is None
    assert slept == ([] if simulated else [1.0, 1.0, 0.5])


@pytest.mark.parametrize(
    ("typed", "kept"),
    [
        (["-530.2 297.4 31"], [-530.2, 297.4, 31.0]),
        (["-530,2 297,4 31,0"], [-530.2, 297.4, 31.0]),
        (["-530.2, 297.4, 31"], [-530.2, 297.4, 31.0]),
        (["somewhere", "1 2", "0.53 0.29 0.03", "530 290 30"], [530.0, 290.0, 30.0]),
        ([""], "no"),
        ([Word.FINISH], "no"),
    ],
)
def test_a_touched_place_is_three_numbers_in_mm(typed: list[Answer], kept: Any) -> None:
    store = Kept(target=SimpleNamespace(kind="charuco"))
    steps = played(touched(store), *typed)
    assert store.kept[TOUCHED] == kept
    warnings = [step for step in steps if isinstance(step, Say)]
    assert len(warnings) == len(typed) - 1
    assert played(touched(store)) == []


@pytest.fixture(scope="module")
def result() -> HandEyeResult:
    plan = Rehearsal(views=8)
    done = rehearse(plan, np.random.default_rng(3))
    noise = RobotNoise(0.2, 1e-3)
    found = calibrate_hand_eye(done.data, plan.camera, noise)
    assert found.solution is not None
    return found


def outcome_with(result: HandEyeResult) -> Outcome:
    quality = Quality(verdict="go")
    return Outcome("hand-eye", None, quality, ("known to 0.1 mm",), {"result": result})


def test_a_touch_where_hand_eye_puts_the_target_speaks_for_it(
    result: HandEyeResult,
) -> None:
    origin = result.solution.fixed_from_target.translation_mm
    store = Kept(kept={TOUCHED: np.add(origin, (0.3, -0.2, 0.2)).tolist()})
    told = with_touch(store, outcome_with(result))
    assert told.quality.verdict == "go"
    assert "touch test: 0.41 mm from where" in told.lines[-1]


def test_a_touch_far_away_is_marginal_and_says_what_to_look_at(
    result: HandEyeResult,
) -> None:
    origin = result.solution.fixed_from_target.translation_mm
    store = Kept(kept={TOUCHED: np.add(origin, (0.0, 12.0, 0.0)).tolist()})
    told = with_touch(store, outcome_with(result))
    assert told.quality.verdict == "marginal"
    (cause,) = told.quality.causes
    assert cause.code == "touch-test-off"
    assert "12.00 mm from where" in cause.message
    assert "tool centre point" in told.quality.next_action


def test_without_a_touch_test_nothing_is_said(result: HandEyeResult) -> None:
    before = outcome_with(result)
    assert with_touch(Kept(kept={TOUCHED: "no"}), before) is before
    assert with_touch(Kept(), before) is before
