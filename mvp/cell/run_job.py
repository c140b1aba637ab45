"""The run: plan, check everything, drive, capture, verify, record.

Nothing is written before everything that can be checked without moving has been
checked, and nothing moves before the folder that keeps the results exists.
"""

from __future__ import annotations

import hashlib
import logging
import re
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from mvp.cell.durable import check_writable, write_durably
from mvp.cell.hardware import opened
from mvp.cell.in_use import using_devices
from mvp.cell.preflight import Routes
from mvp.cell.progress import Tell, unheard
from mvp.cell.records import InputHashes, RecordLog, RunStarted
from mvp.cell.run_document import RunDocument, ViewDocument
from mvp.cell.run_folder import (
    RunFolder,
    create_run_folder,
    parent_dropped_on_error,
)
from mvp.cell.session import (
    RunResult,
    Session,
    Watcher,
    check_before,
    device_records,
    devices_for,
    write_document,
)
from mvp.errors import InfeasibleError

if TYPE_CHECKING:
    from mvp.cell.locate_job import LocatedPart
    from mvp.cell.plan_job import Setting
    from mvp.planning.plan import Plan

_LOG = logging.getLogger(__name__)
_RUN_OVERHEAD_BYTES = 50_000_000
_BYTES_PER_PIXEL = 4


@dataclass(frozen=True)
class RunOptions:
    """How a run is done.

    Attributes:
        out: parent of the run's folder.
        part_id: what the operator calls this specimen.
        step: pause before every view.
        partial: run a plan that does not cover everything.
    """

    out: Path = Path("runs")
    part_id: str = ""
    step: bool = False
    partial: bool = False


def utc_now() -> str:
    """Date and time, UTC, to the millisecond."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def require_runnable(setting: Setting, plan: Plan, *, partial: bool) -> None:
    """Refuse a plan that should not be driven.

    Raises:
        InfeasibleError: nothing admissible, only a part of it, or another tube needed.
    """
    missing = "; ".join(f"{m.feature}: {m.reason}" for m in plan.not_covered)
    fixes = "; ".join(dict.fromkeys(m.fix for m in plan.not_covered if m.fix))
    if plan.status == "infeasible":
        raise InfeasibleError(
            f"no admissible plan: {missing}", hint=fixes, where=plan.task.file
        )
    if plan.status == "partial" and not partial:
        raise InfeasibleError(
            f"only a part of the features can be covered: {missing}",
            hint=f"{fixes}; or run what is possible with --partial",
            where=plan.task.file,
        )
    mounted = setting.cell.config.optics.mounted_tube_mm
    for view in plan.views:
        needed = view.extension_tube_mm or 0.0
        if needed != mounted:
            raise InfeasibleError(
                f"{view.id} needs the {needed:g} mm extension tube, but "
                f"{mounted:g} mm is mounted",
                hint=f"mount it and set optics.mounted_tube_mm = {needed:g} in "
                f"{setting.cell.source.path}",
                where=view.id,
            )


def dry_run(setting: Setting, plan: Plan, tell: Tell = unheard) -> RunDocument:
    """Check the whole plan on the devices; nothing moves, nothing is kept.

    Raises:
        DeviceError, CalibrationError, InfeasibleError: what would end the run.
        RecordError: a run is on this cell.
    """
    started = utc_now()
    with ExitStack() as stack:
        stack.enter_context(using_devices(setting.cell, who="dry run"))
        devices = stack.enter_context(devices_for(setting, tell))
        tell("connecting to arm, lens and camera")
        infos = stack.enter_context(opened(devices))
        tell("checking limits and the way to every view")
        check_before(setting, devices, infos, plan.views, Routes(setting.arm))
    views = [
        ViewDocument(id=v.id, features=v.features, status="checked") for v in plan.views
    ]
    return RunDocument(
        run_id=None,
        folder=None,
        status="checked",
        cell=plan.cell.name,
        task=setting.task.config.name,
        simulated=plan.cell.simulated,
        started_utc=started,
        finished_utc=utc_now(),
        version=version("mvp-cell"),
        partial=plan.status == "partial",
        views=views,
        not_covered=plan.not_covered,
        devices=device_records(infos),
        timing_s={"plan": plan.timing_s.total},
    )


def start_run(
    setting: Setting,
    plan: Plan,
    options: RunOptions,
    watcher: Watcher,
    located: LocatedPart | None = None,
) -> RunResult:
    """Take every view of a plan.

    Args:
        setting: what the plan was made from.
        plan: to be run.
        options: how.
        watcher: the person's side.
        located: the part, and the folder in which it was found; a new folder is made
            when left out.

    Raises:
        InfeasibleError: the plan should not be driven, or there is no clear path.
        DeviceError: a device does not answer or refuses; nothing has moved.
        StoppedByOperator: the person did not allow motion.
        OutputError, RecordError: the results could not be kept, or the cell is in use.
    """
    require_runnable(setting, plan, partial=options.partial)
    check_writable(options.out, needed_bytes=needed_bytes(setting, len(plan.views)))
    name = located.folder.run_id if located else run_name(setting, options.part_id)
    with ExitStack() as stack:
        stack.enter_context(using_devices(setting.cell, who=name))
        expected = located.expected if located else None
        session = Session.open(stack, setting, plan.views, watcher, expected)
        with parent_dropped_on_error(options.out):
            folder = located.folder if located else create_run_folder(options.out, name)
            with nullcontext() if located else folder.dropped_on_error():
                journal = _begin(session, folder, plan, options.part_id)
        if located is not None:
            journal.write(located.record)
        stack.enter_context(folder.in_progress())
        return session.drive(folder, journal, plan, plan.views, step=options.step)


def _begin(session: Session, folder: RunFolder, plan: Plan, part_id: str) -> RecordLog:
    """Write plan, first record and first result: from then on it can be resumed."""
    setting = session.setting
    text = plan.model_dump_json(by_alias=True, indent=1).encode()
    write_durably(folder.plan_file, text)
    journal = RecordLog(folder.records_file, folder.run_id, utc_now)
    journal.write(
        RunStarted(
            resumed=False,
            part_id=part_id,
            simulated=plan.cell.simulated,
            inputs=input_hashes(setting, text),
            devices=device_records(session.infos),
            accepted_calibration=session.accepted,
            believed_axes=session.believed,
            version=version("mvp-cell"),
            cell_file=str(setting.cell.source.path),
        )
    )
    write_document(setting, folder, plan, {})
    return journal


def input_hashes(setting: Setting, plan_text: bytes) -> InputHashes:
    """SHA-256 of everything a run depends on."""
    return InputHashes(
        plan=hashlib.sha256(plan_text).hexdigest(),
        part=setting.scene.part.sha256,
        task=setting.task.sha256,
        cell=setting.cell.sha256,
        calibration=setting.cell.calibrations.sha256,
    )


def needed_bytes(setting: Setting, views: int) -> int:
    """Room that so many further views may take, report included."""
    camera = setting.cell.calibrations.camera
    picture = camera.width_px * camera.height_px * _BYTES_PER_PIXEL
    return views * picture + _RUN_OVERHEAD_BYTES


def run_name(setting: Setting, part_id: str) -> str:
    """Date and time, task and specimen."""
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    parts = [stamp, setting.task.config.name, part_id]
    return "-".join(_slug(part) for part in parts if part)


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", text).strip("._-") or "x"
