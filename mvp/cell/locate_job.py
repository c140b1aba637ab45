"""Find a part from its own features before it is looked at in earnest.

The paper finds the pose of every new part from a first look, (26). Here the part is
looked at from the views of a plan for where it is believed to be; where it is found is
checked against that belief, and the plan is made once more for where it lies.
"""

from __future__ import annotations

import logging
import shutil
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mvp.calibrated import RigidCalibration
from mvp.cell.calibrate_bench import CellBench
from mvp.cell.calibrate_facts import facts_of
from mvp.cell.calibrate_folders import REPORT_FILE
from mvp.cell.calibrate_job import allow_and_home, check_reliance, drive
from mvp.cell.durable import check_writable, write_durably
from mvp.cell.hardware import check_simulated, opened
from mvp.cell.in_use import using_devices
from mvp.cell.locate_sights import TaskSights
from mvp.cell.progress import Tell, unheard
from mvp.cell.records import PartLocated
from mvp.cell.run_folder import RunFolder, create_run_folder
from mvp.cell.run_job import needed_bytes, require_runnable, run_name
from mvp.cell.session import devices_for, start_speed
from mvp.cell.standstill import stopped_on_error
from mvp.errors import PluginError, VerificationFailed
from mvp.geometry import Pose
from mvp.wizard import Say, WizardOptions, load_wizard

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.calibrate_job import FrontEnd
    from mvp.cell.calibration_gates import Objection
    from mvp.cell.loading import LoadedCell, LoadedTask
    from mvp.cell.plan_job import Planned, Setting
    from mvp.cell.run_job import RunOptions
    from mvp.planning.plan import Plan
    from mvp.wizard import Outcome, SessionFacts, Store, Wizard

_LOG = logging.getLogger(__name__)
KEY = "part"


@dataclass(frozen=True, eq=False)
class LocatedPart:
    """Where a part was found.

    Attributes:
        task: the same task, with the part where it lies.
        folder: of the run that goes on with it.
        expected: the cell with the part where it was believed to be.
        record: for the run's records.
    """

    task: LoadedTask
    folder: RunFolder
    expected: Setting
    record: PartLocated


def locate_part(
    planned: Planned,
    folder: RunFolder,
    front: FrontEnd,
    tell: Tell = unheard,
    *,
    seed: int = 0,
) -> LocatedPart:
    """Look at the part, find it, and check it against where it was believed to be.

    Args:
        planned: for where it is believed to be.
        folder: keeps the pictures and the pose.
        front: allows motion and hears what is found.
        tell: hears what is being done.
        seed: of the session.

    Raises:
        VerificationFailed: not found well enough, or too far off; says how far.
        DeviceError: a device failed.
        StoppedByOperator: the person did not allow motion.
        CalibrationError: camera, lens or hand-eye cannot be relied on.
    """
    setting, wizard = planned.setting, load_wizard(KEY)
    cell, task = setting.cell, setting.task
    with ExitStack() as stack:
        stack.enter_context(using_devices(cell, who=folder.run_id))
        devices = stack.enter_context(devices_for(setting, tell))
        tell("connecting to arm, lens and camera")
        infos = stack.enter_context(opened(devices))
        check_simulated(cell, infos)
        views, reason = planned.plan.views, cell.accept_calibration
        _warn(front, check_reliance(cell, devices, infos, KEY, reason, views))
        facts = facts_of(cell, devices, infos, key=KEY, seed=seed, accepted=reason)
        store = wizard.sessions.create(folder.locating, facts)
        speed = start_speed(setting, devices, infos)
        bench = CellBench(setting, devices, facts, start_speed=speed)
        bench.sights = TaskSights(setting, facts, planned, tell)
        with stopped_on_error(devices, bench.under_way, tell):
            allow_and_home(setting, bench, infos, front, KEY)
            options = WizardOptions(auto=True, verify=False)
            outcome = drive(wizard, bench, store, options, front)
    _write_page(wizard, store, outcome)
    found = _accepted(folder, outcome)
    record = _record(cell, facts, store, outcome, found)
    _refuse_far(cell, folder, record)
    _keep(folder, found)
    _LOG.info("locate: %s", "; ".join(outcome.lines))
    found_task = replace(task, pose_file=folder.part_pose_file)
    return LocatedPart(found_task, folder, setting, record)


def _warn(front: FrontEnd, objections: Sequence[Objection]) -> None:
    for one in objections:
        front.answer(Say(f"{one.text}; {one.fix}", "warning"))


def locate_first(
    planned: Planned,
    options: RunOptions,
    front: FrontEnd,
    tell: Tell = unheard,
    *,
    seed: int = 0,
) -> LocatedPart:
    """``locate_part`` in the folder of a new run; none is left without a picture.

    Raises:
        InfeasibleError: the plan for where the part is believed to be cannot be run.
        OutputError: the folder cannot be made.
        MvpCellError: as ``locate_part``.
    """
    setting, plan = planned.setting, planned.plan
    require_runnable(setting, plan, partial=options.partial)
    check_writable(options.out, needed_bytes=needed_bytes(setting, len(plan.views)))
    folder = create_run_folder(options.out, run_name(setting, options.part_id))
    try:
        return locate_part(planned, folder, front, tell, seed=seed)
    except BaseException:
        if not any(folder.locating.glob("images/*.png")):
            shutil.rmtree(folder.path, ignore_errors=True)
        raise


def noted(plan: Plan, located: LocatedPart) -> Plan:
    """The plan for where the part lies, saying so."""
    return plan.model_copy(update={"notes": [*plan.notes, *located.record.lines]})


def with_found_pose(folder: RunFolder, task: LoadedTask) -> LoadedTask:
    """The task with the part where this run found it, if it looked for it."""
    if not folder.part_pose_file.is_file():
        return task
    return replace(task, pose_file=folder.part_pose_file)


def _write_page(wizard: Wizard[Any], store: Store, outcome: Outcome) -> None:
    """The report of the search; one that fails never spoils the run."""
    try:
        page = wizard.page(store, outcome)
        if page:
            write_durably(store.path / REPORT_FILE, page.encode())
    except Exception as error:
        _LOG.warning("no report of how the part was found: %s", error)


def _keep(folder: RunFolder, found: RigidCalibration) -> None:
    text = found.model_dump_json(by_alias=True, indent=1) + "\n"
    write_durably(folder.part_pose_file, text.encode())


def _accepted(folder: RunFolder, outcome: Outcome) -> RigidCalibration:
    """The found pose, unless it is not to be used."""
    quality = outcome.quality
    if quality.verdict == "no-go" or outcome.document is None:
        why = "; ".join(quality.reasons) or "no reason given"
        raise VerificationFailed(
            f"the part was not found: {why}",
            hint=f"{quality.next_action or 'look at the pictures'}; they are in "
            f"{folder.locating}",
            where=str(folder.path),
        )
    if not isinstance(outcome.document, RigidCalibration):
        raise PluginError(
            f"the calibration {KEY!r} gave no pose of a part",
            hint="install mvp-cell, or the plugin that brings it, again",
            where=KEY,
        )
    return outcome.document


def _record(
    cell: LoadedCell,
    facts: SessionFacts,
    store: Store,
    outcome: Outcome,
    found: RigidCalibration,
) -> PartLocated:
    before = facts.base_from_part
    now = Pose.from_matrix("base", "part", np.asarray(found.matrix))
    placement = cell.config.part_placement
    return PartLocated(
        base_from_part=found.matrix,
        expected_base_from_part=before.matrix.tolist(),
        moved_mm=float(np.linalg.norm(now.translation_mm - before.translation_mm)),
        moved_deg=float(np.degrees(now.angle_to_rad(before))),
        within_mm=placement.within_mm,
        within_deg=placement.within_deg,
        error_95_mm=found.quality.error_95_mm,
        verdict=found.quality.verdict,
        pictures=store.count,
        lines=list(outcome.lines),
        session_sha256=store.sha256(),
    )


def _refuse_far(cell: LoadedCell, folder: RunFolder, record: PartLocated) -> None:
    """Ways and views were checked for a part near where it was believed to be."""
    near = record.moved_mm <= record.within_mm
    if near and record.moved_deg <= record.within_deg:
        return
    raise VerificationFailed(
        f"the part lies {record.moved_mm:.1f} mm and {record.moved_deg:.1f} deg from "
        f"where it was expected; {record.within_mm:g} mm and {record.within_deg:g} deg "
        "are allowed",
        hint="put it where part_pose says, correct part_pose, or allow more in "
        f"[part_placement] of {cell.source.path}; the pictures are in {folder.locating}",
        where=str(folder.path),
    )
