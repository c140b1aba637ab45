"""``mvp-cell run --locate`` on a virtual cell whose part lies elsewhere than believed."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvp.cell.loading import load_cell, load_task
from mvp.cell.locate_job import LocatedPart, locate_first
from mvp.cell.plan_job import make_plan
from mvp.cell.records import PartLocated, RunStarted, read_records
from mvp.cell.run_document import RunDocument
from mvp.cell.run_job import RunOptions
from mvp.cli.main import invoke
from mvp.geometry import Pose
from mvp.planning.plan import Plan
from mvp.wizard import Allow
from tests.measured_cells import measured_cell

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.cell.session import Motion
    from mvp.wizard import Answer, Step

# Chi-square with six degrees of freedom: exceeded once in a thousand.
IMPROBABLE = 22.46


class Willing:
    """A person who allows everything."""

    def allow(self, motion: Motion) -> bool:
        return True

    def answer(self, step: Step) -> Answer:
        return True if isinstance(step, Allow) else None


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> LocatedPart:
    home = tmp_path_factory.mktemp("found")
    cell = load_cell(str(measured_cell(home / "cell")))
    planned = make_plan(cell, load_task(cell, None))
    return locate_first(planned, RunOptions(out=home / "runs"), Willing())


def error_of(pose_file: Path, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Of a found pose against the truth of its cell, and the covariance stated."""
    stored = json.loads(pose_file.read_text())
    told, truth = (
        Pose.from_matrix("base", "part", np.array(one["matrix"]))
        for one in (stored, json.loads((folder / "truth/part_pose.json").read_text()))
    )
    turn = truth.rotation @ told.rotation.T
    small = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    shift = truth.translation_mm - told.translation_mm
    return np.r_[shift, np.array(small) / 2], np.array(stored["covariance"])


def test_the_true_pose_lies_within_the_stated_interval(found: LocatedPart):
    pose_file = found.task.pose_file
    assert pose_file == found.folder.part_pose_file
    error, covariance = error_of(pose_file, found.expected.cell.folder)
    assert error @ np.linalg.solve(covariance, error) < IMPROBABLE
    assert np.linalg.norm(error[:3]) < 0.5


def test_the_record_says_how_far_off_the_part_was(found: LocatedPart):
    record = found.record
    assert record.moved_mm == pytest.approx(4.08, abs=0.3)
    assert record.moved_deg == pytest.approx(0.97, abs=0.1)
    assert record.moved_mm < record.within_mm
    assert record.verdict == "go"
    assert "mm" in record.lines[0]
    stored = json.loads(found.folder.part_pose_file.read_text())
    assert stored["provenance"]["origin"] == "measured"
    page = (found.folder.locating / "report.html").read_text()
    assert "from where it was believed to lie" in page


@dataclass(frozen=True)
class Done:
    cell: Path
    code: int
    run: Path
    document: RunDocument


@pytest.fixture(scope="module")
def located(tmp_path_factory: pytest.TempPathFactory) -> Done:
    home = tmp_path_factory.mktemp("locate")
    cell = measured_cell(home / "cell")
    code = invoke(["run", str(cell), "--locate", "--yes", "--out", str(home / "runs")])
    (run,) = (home / "runs").iterdir()
    document = RunDocument.model_validate_json((run / "run.json").read_text())
    return Done(cell, code, run, document)


@pytest.mark.full
def test_a_part_that_lies_elsewhere_is_found_and_every_promise_is_kept(located: Done):
    assert located.code == 0
    assert located.document.status == "verified"


@pytest.mark.full
def test_the_records_say_where_the_part_was_found_and_how_far_off(located: Done):
    first, second, *_ = read_records(located.run / "records.jsonl")
    assert isinstance(first, RunStarted)
    assert isinstance(second, PartLocated)
    assert located.document.located is not None
    assert located.document.located.moved_mm == second.moved_mm
    assert (located.run / "locating" / "samples.jsonl").is_file()


@pytest.mark.full
def test_the_plan_was_made_for_where_the_part_lies(located: Done):
    plan = Plan.model_validate_json((located.run / "plan.json").read_text())
    assert any("from where it was believed to lie" in note for note in plan.notes)
    for view in plan.views:
        assert view.probability is not None
        assert "part_pose" in view.probability.spread.sources
        assert view.probability.spread.position_95_mm < 1.0


@pytest.mark.full
def test_the_session_of_a_run_is_computed_again_without_a_device(
    located: Done, capsys: pytest.CaptureFixture[str]
):
    session = str(located.run / "locating")
    cell = str(located.cell)
    assert invoke(["calibrate", "part", cell, "--session", session, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)["document"]
    stored = json.loads((located.run / "part_pose.json").read_text())
    assert again == stored


@pytest.mark.full
def test_a_located_run_is_resumed_with_the_part_where_it_was_found(located: Done):
    run = str(located.run)
    arguments = ["--out", str(located.run.parent), "--yes", "--json"]
    code = invoke(["run", str(located.cell), "--resume", run, *arguments])
    assert code == 0


def test_locating_moves_the_arm_and_a_dry_run_does_not(tmp_path: Path):
    cell = measured_cell(tmp_path / "cell")
    assert invoke(["run", str(cell), "--locate", "--dry-run"]) == 2
    assert invoke(["run", str(cell), "--locate", "--resume", "x"]) == 2


@pytest.mark.full
def test_a_part_that_lies_too_far_off_is_refused_with_the_distance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    cell = measured_cell(tmp_path / "cell", within_mm=2.0, within_deg=5.0)
    runs = tmp_path / "runs"
    code = invoke(["run", str(cell), "--locate", "--yes", "--out", str(runs)])
    assert code == 5
    told = " ".join(capsys.readouterr().err.split())
    assert re.search(r"the part lies [34]\.\d mm and [01]\.\d deg from", told), told
    assert "part_placement" in told
    (run,) = runs.iterdir()
    assert any((run / "locating" / "images").iterdir())
    assert not (run / "run.json").exists()
