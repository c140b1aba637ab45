"""How sessions begin, are refused, are stopped and end, whatever is calibrated."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

import pytest

from calibration.wizard.session_store import SessionStore
from mvp.cell.calibrate_job import CalibrateRequest, calibrate
from mvp.cell.init_job import copy_cell
from mvp.cell.loading import load_cell, load_task
from mvp.cell.plan_job import prepare
from mvp.cli.main import invoke
from mvp.errors import StoppedByOperator
from mvp.wizard import Allow, Ask, Say, Word
from tests.distributions import install

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mvp.cell.session import Motion
    from mvp.wizard import Answer, Step

# A wizard of somebody else, as small as one can be.
_PROBE = """
import numpy as np
from calibration.wizard.session_store import Finding, SessionStore
from mvp.calibrated import Quality
from mvp.wizard import Allow, Ask, Outcome, Sampled, Say, Word


class Probe:
    key, writes, sessions = "probe", "camera", SessionStore

    def steps(self, bench, store, options):
        yield Say("a probe")
        if store.recall("number") is None:
            said = yield Ask("number", "which number?", "number", 3.0)
            store.remember("number", said)
        while store.count < 2:
            joints = bench.standing().joints + np.radians(0.5) * np.eye(6)[5]
            said = yield Allow(f"to {store.next_number}", bench.way_to(joints).seconds)
            if said is Word.UNDO:
                store.undo()
            elif said is Word.FINISH:
                break
            elif said:
                bench.move(joints)
                one = store.add(bench.shoot(0.002), Finding())
                yield Sampled(one.number, one.name, one.usable)
        return self.outcome(store)

    def outcome(self, store):
        quality = Quality(verdict="no-go", reasons=["only a probe"])
        line = f"{store.recall('number'):g} and {[s.number for s in store.samples]}"
        return Outcome("probe", store.facts.camera, quality, (line,))

    def page(self, store, outcome):
        return ""
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A distribution that brings a wizard."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "acme_probe_wizard.py").write_text(_PROBE)
    wizards = "[mvp_cell.wizards]\nprobe = acme_probe_wizard:Probe\n"
    install(folder, "acme-probe", "1.0", wizards)
    sys.path.insert(0, str(folder))
    yield folder
    sys.path.remove(str(folder))


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    copy_cell("virtual_uncalibrated", tmp_path / "cell")
    file = tmp_path / "cell" / "cell.toml"
    file.write_text(
        file.read_text().replace("clock_speed = 10.0", "clock_speed = 200.0")
    )
    return file


class Scripted:
    """A person who has thought of all answers beforehand."""

    def __init__(self, *answers: Answer | BaseException) -> None:
        self.answers = list(answers)
        self.heard: list[Step] = []

    def allow(self, motion: Motion) -> bool:
        return True

    def answer(self, step: Step) -> Answer:
        self.heard.append(step)
        if not isinstance(step, Ask | Allow):
            return None
        answer = self.answers.pop(0)
        if isinstance(answer, BaseException):
            raise answer
        return answer


def taken(cell: Path, person: Scripted, *, resume: bool = False) -> dict[str, Any]:
    loaded = load_cell(str(cell), accept_calibration="measured anew")
    setting = prepare(loaded, load_task(loaded, None))
    document = calibrate(setting, CalibrateRequest("probe", resume=resume), person)
    return document.model_dump(by_alias=True)


def session_of(cell: Path) -> Path:
    (folder,) = (cell.parent / "calibration" / "sessions").iterdir()
    return folder


def error_of(words: list[str], capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    code = invoke([*words, "--json"])
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert document["code"] == code
    return document


@pytest.mark.usefixtures("site")
def test_a_sample_can_be_taken_back_and_a_poor_result_is_not_put_in_place(
    cell: Path,
) -> None:
    before = (cell.parent / "calibration" / "camera.json").read_bytes()
    person = Scripted(7.0, True, Word.UNDO, False, True, Word.FINISH)
    result = taken(cell, person)
    assert result["verdict"] == "no-go"
    assert result["lines"] == ["7 and [2]"]
    assert result["placed"] is None
    assert (cell.parent / "calibration" / "camera.json").read_bytes() == before
    folder = session_of(cell)
    assert json.loads((folder / "result.json").read_text())["samples"] == 1
    assert isinstance(person.heard[0], Say)


@pytest.mark.usefixtures("site")
def test_ctrl_c_ends_a_session_that_can_be_resumed_with_its_answers(
    cell: Path,
) -> None:
    with pytest.raises(StoppedByOperator) as stopped:
        taken(cell, Scripted(5.0, True, KeyboardInterrupt()))
    assert "--resume" in stopped.value.hint
    assert SessionStore.open(session_of(cell)).count == 1
    result = taken(cell, Scripted(True), resume=True)
    assert result["lines"] == ["5 and [1, 2]"]


@pytest.mark.usefixtures("site")
def test_unattended_a_no_go_is_exit_5_and_a_changed_cell_is_not_resumed(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["calibrate", "probe", str(cell), "--auto", "--yes"]
    assert invoke([*words, "--json"]) == 5
    document = json.loads(capsys.readouterr().out)
    assert document["lines"] == ["3 and [1, 2]"]
    (session_of(cell) / "result.json").unlink()
    text = cell.read_text().replace("blur_circle_um = 13.5", "blur_circle_um = 9.5")
    cell.write_text(text)
    error = error_of([*words, "--resume"], capsys)
    assert (error["code"], error["kind"]) == (2, "RecordError")
    assert "blur_circle_mm" in error["message"]


def test_a_bundled_cell_is_not_calibrated_in_place(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["calibrate", "camera", "virtual_uncalibrated", "--auto", "--yes"]
    error = error_of(words, capsys)
    assert error["code"] == 2
    assert "mvp-cell init" in error["hint"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["calibrate", "lense", "{cell}", "--auto"], "no calibration called 'lense'"),
        (["calibrate", "camera", "{cell}"], "no terminal"),
        (["calibrate", "camera", "{cell}", "--auto", "--resume"], "no session"),
        (["calibrate", "camera", "{cell}", "--session", "{folder}"], "not a calib"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_moves(
    cell: Path, words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    filled = [w.format(cell=cell, folder=cell.parent) for w in words]
    error = error_of(filled, capsys)
    assert error["code"] == 2
    assert told in error["message"]
    assert not (cell.parent / "calibration" / "sessions").exists()


def test_a_cell_without_a_target_says_how_to_get_one(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head, _, tail = cell.read_text().partition("[target]")
    cell.write_text(head + "[workspace]" + tail.partition("[workspace]")[2])
    words = ["calibrate", "camera", str(cell), "--auto", "--yes"]
    error = error_of(words, capsys)
    assert (error["code"], error["kind"]) == (2, "CalibrationError")
    assert "[target]" in error["hint"]


def test_a_session_of_another_calibration_is_not_mistaken(
    cell: Path, site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(["calibrate", "probe", str(cell), "--auto", "--yes"]) == 5
    capsys.readouterr()
    words = ["calibrate", "camera", str(cell), "--session", str(session_of(cell))]
    error = error_of(words, capsys)
    assert error["code"] == 2
    assert "calibrate probe" in error["message"]
