"""Go on with a run that broke off, at whatever moment it did.

What was promised to be on disk is trusted after its hash was checked; everything else
is set aside and done again. Nothing is resumed when plan, part, task, cell or
calibration have changed.
"""

from __future__ import annotations

from contextlib import ExitStack
from importlib.metadata import version
from typing import TYPE_CHECKING

from mvp.cell.durable import check_writable
from mvp.cell.in_use import refuse_in_use, using_devices
from mvp.cell.loading import load_task
from mvp.cell.locate_job import with_found_pose
from mvp.cell.places import as_found
from mvp.cell.plan_job import Setting, prepare
from mvp.cell.records import (
    Captured,
    Record,
    RecordLog,
    RunFinished,
    RunStarted,
    Verified,
)
from mvp.cell.run_folder import RunFolder, find_run
from mvp.cell.run_job import (
    RunOptions,
    input_hashes,
    needed_bytes,
    utc_now,
)
from mvp.cell.runner import RunOutcome
from mvp.cell.session import (
    RunResult,
    Session,
    Watcher,
    device_records,
    write_document,
)
from mvp.cell.simulation import refuse_other_task
from mvp.cell.verification import Expectations, PictureVerifier, declared_axes
from mvp.errors import RecordError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from mvp.cell.loading import LoadedCell
    from mvp.cell.records import InputHashes
    from mvp.planning.plan import Plan, PlannedView


def resume_run(
    cell: LoadedCell, run: str, options: RunOptions, watcher: Watcher
) -> RunResult:
    """Verify what was captured, capture what was not.

    Raises:
        RecordError: no such run, damaged, in use, or its inputs have changed.
        OutputError, DeviceError, InfeasibleError, StoppedByOperator: as for a new run.
    """
    folder = find_run(run, [options.out])
    refuse_in_use(cell)
    plan = folder.read_plan()
    task_file = as_found(plan.task.file, cell.source.path.parent)
    task = load_task(cell, str(task_file))
    refuse_other_task(cell, task)
    setting = prepare(cell, with_found_pose(folder, task))
    expected = prepare(cell, task) if setting.task is not task else setting
    with ExitStack() as stack:
        stack.enter_context(folder.in_progress())
        stack.enter_context(using_devices(cell, who=folder.run_id))
        records = folder.records(repair=True)
        first = _first(folder, records)
        _check_inputs(folder, first.inputs, setting)
        _check_pictures(folder, records)
        folder.set_aside_unrecorded(records)
        journal = RecordLog(
            folder.records_file, folder.run_id, utc_now, first_seq=len(records)
        )
        left = _not_captured(plan, records)
        if not left:
            return _finish(setting, folder, journal, plan, records)
        check_writable(folder.path, needed_bytes=needed_bytes(setting, len(left)))
        session = Session.open(stack, setting, left, watcher, expected)
        journal.write(_again(first, session))
        write_document(setting, folder, plan, {})
        _verify_rest(setting, folder, journal, plan, records)
        return session.drive(folder, journal, plan, left, step=options.step)


def plan_left(run: str, out: Path) -> Plan:
    """What a run that broke off has not captured yet, for a person to look at.

    Raises:
        RecordError: no such run, or its plan or records cannot be read.
    """
    folder = find_run(run, [out])
    plan = folder.read_plan()
    left = _not_captured(plan, folder.records())
    return plan.model_copy(update={"views": left})


def _first(folder: RunFolder, records: Sequence[Record]) -> RunStarted:
    if not records or not isinstance(records[0], RunStarted):
        raise RecordError(
            f"{folder.records_file}: the run broke off before it began",
            hint="start a new run",
            where=str(folder.records_file),
        )
    return records[0]


def _check_inputs(folder: RunFolder, before: InputHashes, setting: Setting) -> None:
    """Refuse when anything the run depends on is not what it was."""
    now = input_hashes(setting, folder.plan_file.read_bytes())
    files = _files(folder, setting)
    changed = [
        f"{name} ({files[name]})"
        for name in ("plan", "part", "task", "cell")
        if getattr(before, name) != getattr(now, name)
    ]
    calibrated = setting.cell.calibrations.files
    changed += [
        f"{name} calibration ({calibrated[name]})"
        for name in sorted(now.calibration)
        if before.calibration.get(name) != now.calibration[name]
    ]
    if changed:
        raise RecordError(
            f"{folder.run_id} cannot be resumed: changed since it began: "
            f"{', '.join(changed)}",
            hint="start a new run, or bring back the files as they were",
            where=str(folder.path),
        )


def _files(folder: RunFolder, setting: Setting) -> dict[str, str]:
    """The files behind each hash of the inputs, for a message."""
    cell = (setting.cell.source.path, *setting.cell.fixture_files.values())
    return {
        "plan": str(folder.plan_file),
        "part": str(setting.task.part_file),
        "task": str(setting.task.source.path),
        "cell": " or ".join(str(path) for path in cell),
    }


def _check_pictures(folder: RunFolder, records: Sequence[Record]) -> None:
    for record in records:
        if isinstance(record, Captured):
            folder.load(record)


def _not_captured(plan: Plan, records: Sequence[Record]) -> list[PlannedView]:
    captured = {r.view for r in records if isinstance(r, Captured)}
    return [view for view in plan.views if view.id not in captured]


def _again(first: RunStarted, session: Session) -> RunStarted:
    return RunStarted(
        resumed=True,
        part_id=first.part_id,
        simulated=first.simulated,
        inputs=first.inputs,
        devices=device_records(session.infos),
        accepted_calibration=session.accepted,
        believed_axes=session.believed,
        version=version("mvp-cell"),
        cell_file=str(session.setting.cell.source.path),
    )


def _verify_rest(
    setting: Setting,
    folder: RunFolder,
    journal: RecordLog,
    plan: Plan,
    records: Sequence[Record],
) -> list[Verified]:
    """Measure pictures that were taken but not yet judged."""
    done = {r.view for r in records if isinstance(r, Verified)}
    starts = [record for record in records if isinstance(record, RunStarted)]
    verifier = PictureVerifier(
        Expectations(setting), folder.load, declared_axes(starts[-1].devices)
    )
    views = {view.id: view for view in plan.views}
    found = []
    for record in records:
        if isinstance(record, Captured) and record.view not in done:
            verified = verifier(views[record.view], record)
            journal.write(verified)
            found.append(verified)
    return found


def _finish(
    setting: Setting,
    folder: RunFolder,
    journal: RecordLog,
    plan: Plan,
    records: Sequence[Record],
) -> RunResult:
    """Every picture is there: judge the rest and close the run; nothing moves."""
    verified = [r for r in records if isinstance(r, Verified)]
    verified += _verify_rest(setting, folder, journal, plan, records)
    last = records[-1]
    if not (isinstance(last, RunFinished) and last.reason == "completed"):
        passed = sum(v.verdict == "pass" for v in verified)
        journal.write(
            RunFinished(
                reason="completed",
                views_captured=len(verified),
                views_passed=passed,
            )
        )
    document = write_document(setting, folder, plan, {"plan": plan.timing_s.total})
    outcome = RunOutcome("completed", tuple(verified))
    return RunResult(setting, document, folder, outcome)
