"""Whole runs on the virtual cell, with a clock that runs a hundred times as fast."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from mvp.cell.loading import load_cell, load_task
from mvp.cell.places import bundled_root
from mvp.cell.plan_job import Setting, make_plan, prepare
from mvp.cell.records import (
    Captured,
    Fault,
    RunFinished,
    RunStarted,
    Verified,
    ViewStarted,
    read_records,
)
from mvp.cell.run_document import RunDocument
from mvp.cell.run_folder import RunFolder
from mvp.cell.run_job import RunOptions, start_run
from mvp.cell.session import RunResult, Watcher
from mvp.cell.states import RunState
from mvp.cli.main import invoke
from mvp.errors import (
    DeviceError,
    InfeasibleError,
    OutputError,
    RecordError,
    StoppedByOperator,
)
from mvp.planning.plan import NotCovered
from mvp.testing.require import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.runner import Runner, RunOutcome
    from mvp.cell.states import RunStatus
    from mvp.planning.plan import Plan


def fast_cell(folder: Path, world: str = "") -> Path:
    """A virtual cell of one's own with further lines in [world]."""
    shutil.copytree(bundled_root() / "virtual", folder, copy_function=shutil.copyfile)
    text = (folder / "cell.toml").read_text()
    text = text.replace("clock_speed = 1.0", "clock_speed = 100.0")
    (folder / "cell.toml").write_text(f"{text}\n{world}\n")
    return folder


def setting_of(folder: Path) -> Setting:
    cell = load_cell(str(folder))
    return prepare(cell, load_task(cell, None))


@dataclass(frozen=True)
class Prepared:
    """A plan for two visits of the same place, so that there is a second motion."""

    plan: Plan


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    folder = fast_cell(tmp_path_factory.mktemp("plan") / "cell")
    cell = load_cell(str(folder))
    plan = make_plan(cell, load_task(cell, None)).plan
    assert plan.status == "admissible"
    (view,) = plan.views
    again = view.model_copy(update={"id": "v2"})
    return Prepared(plan.model_copy(update={"views": [view, again]}))


def run(
    prepared: Prepared,
    tmp_path: Path,
    world: str = "",
    *,
    follow: Callable[[Runner], None] = lambda runner: None,
    on_status: Callable[[RunStatus], None] | None = None,
    on_end: Callable[[RunFolder, RunOutcome], None] | None = None,
) -> RunResult:
    setting = setting_of(fast_cell(tmp_path / "cell", world))
    watcher = Watcher(lambda motion: motion.simulated, follow, on_status, on_end)
    return start_run(setting, prepared.plan, RunOptions(tmp_path / "runs"), watcher)


STORY = (
    "run: moving, view v1, 0 of 1 done",
    "arm: towards v1, asked [",
    "arm: stands at v1, reached [",
    "run: adjusting",
    "lens: towards v1, asked {",
    "lens: stands at v1, reached {",
    "run: capturing",
    "arm: still at v1: the picture moved by 0.0",
    "camera: v1 kept as images/v1.png",
    "run: verifying",
    "v1: pass",
)


def told(folder: Path, *story: str) -> bool:
    """Whether the log has lines that begin so, in this order."""
    text = (folder / "log.jsonl").read_text()
    messages = iter([json.loads(line)["message"] for line in text.splitlines()])
    return all(any(m.startswith(part) for m in messages) for part in story)


def test_a_run_keeps_everything_and_verifies_every_edge(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = fast_cell(tmp_path / "cell")
    out = tmp_path / "runs"
    words = ["run", str(cell), "--out", str(out), "--part-id", "no 7", "--json"]
    assert invoke(words) == 0
    document = RunDocument.model_validate_json(capsys.readouterr().out)
    assert document.status == "verified"
    assert document.simulated
    assert document.part_id == "no 7"
    folder = Path(document.folder or "")
    assert folder.parent == out
    for name in ("plan.json", "run.json", "records.jsonl", "log.jsonl", "report.html"):
        assert (folder / name).stat().st_size > 0, name
    (view,) = document.views
    assert view.verification is not None
    measured = {e["feature"]: e for e in view.verification.edges}
    assert set(measured) == {"horizontal edge", "vertical edge"}
    for edge in measured.values():
        assert abs(edge["measured_px"] - edge["predicted_px"]) < 1.0
        assert edge["visible_fraction"] > 0.8
    records = read_records(folder / "records.jsonl")
    kinds = [type(r) for r in records]
    assert kinds == [RunStarted, ViewStarted, Captured, Verified, RunFinished]
    taken = records[2]
    assert isinstance(taken, Captured)
    assert taken.times.exposure_start_s >= taken.times.not_before_s
    assert taken.times.not_before_s >= taken.times.lens_standing_s
    assert taken.exposure_source == "metered"
    assert "picture moved between two frames" in (folder / "report.html").read_text()
    assert str(tmp_path) not in (folder / "report.html").read_text()
    lines = [json.loads(x) for x in (folder / "log.jsonl").read_text().splitlines()]
    assert {line["run"] for line in lines} == {document.run_id}
    assert told(folder, "run: preparing", *STORY, "run: ended (completed)")
    by_arm = [x["message"] for x in lines if x["logger"] == "drivers.virtual_arm"]
    assert by_arm
    assert all(message.startswith("arm: ") for message in by_arm)
    assert invoke(["runs", "--out", str(out), "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["runs"]
    assert [r["run_id"] for r in listed] == [document.run_id]
    (folder / "report.html").unlink()
    assert invoke(["report", str(document.run_id), "--out", str(out)]) == 0
    assert (folder / "report.html").is_file()


def test_a_dry_run_moves_nothing_and_keeps_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = fast_cell(tmp_path / "cell")
    out = tmp_path / "runs"
    assert invoke(["run", str(cell), "--dry-run", "--out", str(out), "--json"]) == 0
    document = RunDocument.model_validate_json(capsys.readouterr().out)
    assert document.status == "checked"
    assert document.started_utc
    assert document.finished_utc is not None
    assert document.started_utc <= document.finished_utc
    assert [view.status for view in document.views] == ["checked"]
    assert not out.exists()


FAULTS = {
    "arm": "[world.faults.arm]\nprotective_stop_after_s = 0.1",
    "lens": '[world.faults.lens]\nstall = "focus"',
    "camera": "[world.faults.camera]\ndead_after_frames = 1",
}


@pytest.mark.parametrize("device", FAULTS)
def test_after_a_device_fault_nothing_more_is_commanded(
    device: str, prepared: Prepared, tmp_path: Path
) -> None:
    result = run(prepared, tmp_path, FAULTS[device])
    assert result.outcome.reason == "fault"
    assert isinstance(result.outcome.error, DeviceError)
    assert result.outcome.error.device == device
    assert result.document.status == "fault"
    records = result.folder.records()
    assert isinstance(records[-1], RunFinished)
    assert isinstance(records[-2], Fault)
    assert records[-2].where == device
    assert [r.view for r in records if isinstance(r, ViewStarted)] == ["v1"]
    assert not [r for r in records if isinstance(r, Captured)]
    assert told(
        result.folder.path, "run: moving, view v1", "run: fault: ", "run: ended"
    )


@pytest.mark.parametrize("state", [RunState.MOVING, RunState.ADJUSTING])
def test_ctrl_c_stops_the_devices_and_ends_the_run(
    state: RunState, prepared: Prepared, tmp_path: Path
) -> None:
    pressed = False

    def follow(runner: Runner) -> None:
        nonlocal pressed
        if pressed:
            return
        runner.wait(lambda s: s.state is state, timeout_s=30)
        # The state is told a moment before the view is recorded as begun.
        (records,) = (tmp_path / "runs").glob("*/records.jsonl")
        wait_until(lambda: "view_started" in records.read_text(), "the view began")
        pressed = True
        raise KeyboardInterrupt

    told_first: list[str] = []

    def on_end(folder: RunFolder, outcome: RunOutcome) -> None:
        told_first.append(folder.read_document().status)
        told_first.append(outcome.may_still_move)

    result = run(prepared, tmp_path, follow=follow, on_end=on_end)
    assert result.outcome.reason == "aborted"
    assert result.document.status == "aborted"
    assert told_first[0] == "running"
    # Nothing moves yet when Ctrl-C comes between the state and the command.
    device = {RunState.MOVING: "the arm", RunState.ADJUSTING: "the lens"}[state]
    assert told_first[1] == (result.document.may_still_move or "")
    assert not told_first[1] or told_first[1].startswith(device)
    assert result.outcome.stands == result.document.stands == "arm and lens"
    assert result.outcome.may_still_move == ""
    log = (result.folder.path / "log.jsonl").read_text()
    assert log.count("stopping arm, lens and camera") == 1
    records = result.folder.records()
    assert isinstance(records[-1], RunFinished)
    assert [r.view for r in records if isinstance(r, ViewStarted)] == ["v1"]


def test_a_folder_that_vanishes_ends_the_run_before_the_next_motion(
    prepared: Prepared, tmp_path: Path
) -> None:
    def on_status(status: RunStatus) -> None:
        if status.state is RunState.CAPTURING:
            (images,) = (tmp_path / "runs").glob("*/images")
            shutil.rmtree(images)
            images.write_text("no folder any more")

    result = run(prepared, tmp_path, on_status=on_status)
    assert result.outcome.reason == "error"
    assert isinstance(result.outcome.error, OutputError)
    starts = [r for r in result.folder.records() if isinstance(r, ViewStarted)]
    assert [r.view for r in starts] == ["v1"]


def test_two_processes_never_work_on_one_run(
    prepared: Prepared, tmp_path: Path
) -> None:
    def follow(runner: Runner) -> None:
        (folder,) = (tmp_path / "runs").iterdir()
        with (
            pytest.raises(RecordError, match="is going on in another process"),
            RunFolder(folder).in_progress(),
        ):
            pass

    result = run(prepared, tmp_path, follow=follow)
    assert not result.folder.is_in_progress


def test_motion_that_is_not_allowed_leaves_nothing_behind(
    prepared: Prepared, tmp_path: Path
) -> None:
    setting = setting_of(fast_cell(tmp_path / "cell"))
    watcher = Watcher(lambda motion: False, lambda runner: None)
    with pytest.raises(StoppedByOperator):
        start_run(setting, prepared.plan, RunOptions(tmp_path / "runs"), watcher)
    assert not (tmp_path / "runs").exists()


def test_a_device_that_does_not_answer_is_named_before_anything_is_kept(
    prepared: Prepared, tmp_path: Path
) -> None:
    world = (
        "[world.faults.lens]\nunreachable = true\n"
        "[world.faults.camera]\nunreachable = true"
    )
    with pytest.raises(DeviceError, match=r"lens.*camera"):
        run(prepared, tmp_path, world)
    assert not (tmp_path / "runs").exists()


def test_a_wrong_part_fails_verification_and_names_a_cause(
    prepared: Prepared, tmp_path: Path
) -> None:
    first = prepared.plan.model_copy(update={"views": prepared.plan.views[:1]})
    one = replace(prepared, plan=first)
    result = run(one, tmp_path, "[world.errors]\npart_mm = [9.0, -6.0, 0.0]")
    assert result.outcome.reason == "completed"
    assert result.document.status == "failed"
    (view,) = result.document.views
    assert view.verification is not None
    assert view.verification.cause == "misalignment"


def test_a_plan_for_another_tube_is_not_driven(
    prepared: Prepared, tmp_path: Path
) -> None:
    (view, *_) = prepared.plan.views
    tubed = view.model_copy(update={"extension_tube_mm": 0.5})
    other = Prepared(prepared.plan.model_copy(update={"views": [tubed]}))
    with pytest.raises(Exception, match=r"0\.5 mm extension tube"):
        run(other, tmp_path)
    assert not (tmp_path / "runs").exists()


def test_step_waits_before_every_view(prepared: Prepared, tmp_path: Path) -> None:
    waited: list[str | None] = []

    def follow(runner: Runner) -> None:
        while True:
            status = runner.wait(
                lambda s: s.state in (RunState.PAUSED, RunState.FINISHED),
                timeout_s=60,
            )
            if status.state is RunState.FINISHED:
                return
            waited.append(status.view)
            runner.resume()

    setting = setting_of(fast_cell(tmp_path / "cell"))
    watcher = Watcher(lambda motion: True, follow)
    options = RunOptions(tmp_path / "runs", step=True)
    result = start_run(setting, prepared.plan, options, watcher)
    assert result.outcome.reason == "completed"
    assert waited == ["v1", "v2"]


def test_a_partial_plan_runs_only_when_asked_for(
    prepared: Prepared, tmp_path: Path
) -> None:
    missing = NotCovered(feature="belly", reason="it lies below", fix="turn the part")
    one = prepared.plan.model_copy(
        update={
            "status": "partial",
            "views": prepared.plan.views[:1],
            "not_covered": [missing],
        }
    )
    setting = setting_of(fast_cell(tmp_path / "cell"))
    watcher = Watcher(lambda motion: True, lambda runner: None)
    out = tmp_path / "runs"
    with pytest.raises(InfeasibleError, match="belly") as caught:
        start_run(setting, one, RunOptions(out), watcher)
    assert "--partial" in caught.value.hint
    assert not out.exists()
    result = start_run(setting, one, RunOptions(out, partial=True), watcher)
    assert result.document.status == "verified"
    assert result.document.partial
    assert result.document.not_covered == [missing]


HARD = """
[[features]]
id = "too fine"
kind = "edge"
from_mm = [12.7, 0.0, -12.7]
to_mm = [12.7, 0.0, 12.7]
resolution = { detail_mm = 0.02, pixels = 4 }
"""


@pytest.mark.full
@pytest.mark.parametrize(
    ("alone", "status"), [(True, "infeasible"), (False, "partial")]
)
def test_what_cannot_be_planned_is_explained_with_exit_code_3(
    alone: bool, status: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = fast_cell(tmp_path / "cell")
    task = cell / "tasks" / "paper_object.toml"
    head, _, features = task.read_text().partition("[[features]]")
    easy = "" if alone else f"[[features]]{features.partition('[[features]]')[0]}"
    task.write_text(f"{head}{easy}{HARD}")
    assert invoke(["plan", str(cell), "--json"]) == 3
    plan = json.loads(capsys.readouterr().out)
    assert plan["status"] == status
    (missing,) = plan["not_covered"]
    assert missing["feature"] == "too fine"
    assert missing["reason"]
    assert missing["fix"]
    assert invoke(["run", str(cell), "--out", str(tmp_path / "runs"), "--json"]) == 3
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "mvp-cell/error/1"
    assert not (tmp_path / "runs").exists()
