"""The run: plan, check everything, drive, capture, verify, record.

Nothing is written before everything that can be checked without moving has been
checked, and nothing moves before the folder that keeps the results exists.
"""

from __future__ import annotations

import hashlib
import logging
import re
import time
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from mvp.cell.beside import run_beside
from mvp.cell.durable import check_writable, write_durably
from mvp.cell.engine import CellEngine
from mvp.cell.hardware import WorldBodies, build_devices, check_serials, opened
from mvp.cell.interrupts import uninterrupted
from mvp.cell.lock import cell_lock, lock_file
from mvp.cell.logs import log_devices, log_to
from mvp.cell.preflight import Routes, check_limits
from mvp.cell.records import DeviceRecord, InputHashes, RecordLog, RunStarted
from mvp.cell.run_document import RunDocument, ViewDocument, run_document
from mvp.cell.run_folder import RunFolder, create_run_folder
from mvp.cell.runner import Runner, RunOutcome
from mvp.cell.verification import Expectations, PictureVerifier, TaskExposure
from mvp.errors import InfeasibleError, StoppedByOperator

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mvp.cell.engine import CellDevices
    from mvp.cell.plan_job import Setting
    from mvp.cell.states import RunStatus
    from mvp.devices import DeviceInfo
    from mvp.planning.plan import Plan, PlannedView

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


@dataclass(frozen=True)
class Motion:
    """What a person is asked to allow."""

    cell: str
    views: int
    infos: dict[str, DeviceInfo]

    @property
    def simulated(self) -> bool:
        """Every device says that it is simulated."""
        return all(info.simulated for info in self.infos.values())


@dataclass(frozen=True)
class Watcher:
    """The person's side of a run.

    Attributes:
        allow: asked once before the first motion; False ends the run.
        follow: called in the caller's thread until the run has ended; may raise
            ``KeyboardInterrupt``, which stops the devices.
        on_status: told about every change.
        on_end: told how the run ended, before anything else is written.
    """

    allow: Callable[[Motion], bool]
    follow: Callable[[Runner], None]
    on_status: Callable[[RunStatus], None] | None = None
    on_end: Callable[[RunFolder, RunOutcome], None] | None = None

    def tell_end(self, folder: RunFolder, outcome: RunOutcome) -> None:
        """Tell how it ended; a failure to do so never spoils the run."""
        if self.on_end is None:
            return
        try:
            self.on_end(folder, outcome)
        except Exception:
            _LOG.exception("the end of the run could not be told")


@dataclass(frozen=True)
class RunResult:
    """What a run left behind, and what it was made from."""

    setting: Setting
    document: RunDocument
    folder: RunFolder
    outcome: RunOutcome


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


def build_for(setting: Setting) -> CellDevices:
    """The devices of a cell, with the task's part in a simulated world."""
    scene = setting.scene
    return build_devices(
        setting.cell, WorldBodies(scene.scene.part, scene.fixtures_base)
    )


def dry_run(setting: Setting, plan: Plan) -> RunDocument:
    """Check the whole plan on the devices; nothing moves, nothing is kept.

    Raises:
        DeviceError, CalibrationError, InfeasibleError: what would end the run.
    """
    started = utc_now()
    devices = build_for(setting)
    with opened(devices) as infos:
        _check_before(setting, devices, infos, plan.views, Routes(setting.arm))
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
    setting: Setting, plan: Plan, options: RunOptions, watcher: Watcher
) -> RunResult:
    """Take every view of a plan.

    Raises:
        InfeasibleError: the plan should not be driven, or there is no clear path.
        DeviceError: a device does not answer or refuses; nothing has moved.
        StoppedByOperator: the person did not allow motion.
        OutputError, RecordError: the results could not be kept, or the cell is in use.
    """
    require_runnable(setting, plan, partial=options.partial)
    check_writable(options.out, needed_bytes=_needed_bytes(setting, len(plan.views)))
    name = _run_name(setting, options.part_id)
    with ExitStack() as stack:
        stack.enter_context(cell_lock(lock_of(setting, options.out), run_id=name))
        session = Session.open(stack, setting, plan.views, watcher)
        folder = create_run_folder(options.out, name)
        text = plan.model_dump_json(by_alias=True, indent=1).encode()
        write_durably(folder.plan_file, text)
        journal = RecordLog(folder.records_file, folder.run_id, utc_now)
        journal.write(
            RunStarted(
                resumed=False,
                part_id=options.part_id,
                simulated=plan.cell.simulated,
                inputs=input_hashes(setting, text),
                devices=device_records(session.infos),
                accepted_calibration=setting.cell.calibrations.accepted,
                version=version("mvp-cell"),
                cell_file=str(setting.cell.source.path),
            )
        )
        return session.drive(folder, journal, plan, plan.views, step=options.step)


def input_hashes(setting: Setting, plan_text: bytes) -> InputHashes:
    """SHA-256 of everything a run depends on."""
    return InputHashes(
        plan=hashlib.sha256(plan_text).hexdigest(),
        part=setting.scene.part.sha256,
        task=setting.task.sha256,
        cell=setting.cell.sha256,
        calibration=setting.cell.calibrations.sha256,
    )


def lock_of(setting: Setting, out: Path) -> Path:
    """The lock file of a cell; see ``mvp.cell.lock``."""
    cell = setting.cell
    return lock_file(cell.source.path, out, simulated=cell.config.simulated)


def _check_before(
    setting: Setting,
    devices: CellDevices,
    infos: dict[str, DeviceInfo],
    views: Sequence[PlannedView],
    routes: Routes,
) -> None:
    """Everything that can be found out without moving."""
    check_serials(setting.cell, infos)
    check_limits(devices, views, setting.task.config.exposure.exposure_s)
    routes.check_all(devices.arm.state().joints, views)


@dataclass(frozen=True, eq=False)
class Session:
    """Opened devices and a checked plan."""

    setting: Setting
    devices: CellDevices
    infos: dict[str, DeviceInfo]
    routes: Routes
    watcher: Watcher

    @classmethod
    def open(
        cls,
        stack: ExitStack,
        setting: Setting,
        views: Sequence[PlannedView],
        watcher: Watcher,
    ) -> Session:
        """Open the devices, check everything, ask the person."""
        devices = build_for(setting)
        infos = stack.enter_context(opened(devices))
        routes = Routes(setting.arm)
        _check_before(setting, devices, infos, views, routes)
        if not watcher.allow(Motion(setting.cell.config.name, len(views), infos)):
            raise StoppedByOperator("the operator did not allow the arm to move")
        return cls(setting, devices, infos, routes, watcher)

    def drive(
        self,
        folder: RunFolder,
        journal: RecordLog,
        plan: Plan,
        views: Sequence[PlannedView],
        *,
        step: bool,
    ) -> RunResult:
        """Take the views and write the result."""
        began = time.perf_counter()
        with log_to(folder.log_file, folder.run_id):
            self._log_start(plan, views)
            write_document(self.setting, folder, plan, {})
            runner = Runner(
                self._engine(folder, views),
                journal,
                views,
                step=step,
                on_status=self.watcher.on_status,
            )
            outcome = run_beside(runner, self.watcher.follow)
            timing = {"run": time.perf_counter() - began, "plan": plan.timing_s.total}
            with uninterrupted():
                self.watcher.tell_end(folder, outcome)
                document = write_document(self.setting, folder, plan, timing)
            _LOG.info("run: %s after %.2f s", document.status, timing["run"])
        return RunResult(self.setting, document, folder, outcome)

    def _log_start(self, plan: Plan, views: Sequence[PlannedView]) -> None:
        _LOG.info(
            "run: cell %s%s, task %s, part %s, %s plan, to take: %s",
            plan.cell.name,
            " (simulated)" if plan.cell.simulated else "",
            self.setting.task.config.name,
            self.setting.scene.part.sha256[:12],
            plan.status,
            ", ".join(view.id for view in views),
        )
        log_devices(self.infos.values())

    def _engine(self, folder: RunFolder, views: Sequence[PlannedView]) -> CellEngine:
        settle = self.setting.cell.config.settle
        exposure = self.setting.task.config.exposure
        expectations = Expectations(self.setting)
        return CellEngine(
            self.devices,
            settle_s=(settle.arm_s, settle.lens_s),
            preflight=lambda: _check_before(
                self.setting, self.devices, self.infos, views, self.routes
            ),
            route=lambda start, view: self.routes.find(start, view).tolist(),
            exposure=TaskExposure(
                expectations,
                exposure.exposure_s,
                exposure.gain,
                self.devices.camera.exposure_range_s(),
            ),
            store=folder.store,
            verifier=PictureVerifier(expectations, folder.load),
        )


def write_document(
    setting: Setting, folder: RunFolder, plan: Plan, timing_s: dict[str, float]
) -> RunDocument:
    """Write the result from plan and records, durably."""
    document = run_document(
        plan,
        folder.records(),
        folder=str(folder.path),
        task=setting.task.config.name,
        timing_s=timing_s,
    )
    folder.write_document(document)
    return document


def device_records(infos: dict[str, DeviceInfo]) -> list[DeviceRecord]:
    """Who answered, for the record."""
    return [
        DeviceRecord(
            role=role,
            driver=info.driver,
            model=info.model,
            serial=info.serial,
            firmware=info.firmware,
            simulated=info.simulated,
        )
        for role, info in infos.items()
    ]


def _needed_bytes(setting: Setting, views: int) -> int:
    camera = setting.cell.calibrations.camera
    picture = camera.width_px * camera.height_px * _BYTES_PER_PIXEL
    return views * picture + _RUN_OVERHEAD_BYTES


def _run_name(setting: Setting, part_id: str) -> str:
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    parts = [stamp, setting.task.config.name, part_id]
    return "-".join(_slug(part) for part in parts if part)


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", text).strip("._-") or "x"
