"""Devices that are open and a plan that was checked: from there a run is driven."""

from __future__ import annotations

import logging
import time
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from mvp.cell.arrival import arrival_tolerance
from mvp.cell.beside import call_beside, run_beside
from mvp.cell.calibrated_devices import accepted_on_devices, warn_of_devices
from mvp.cell.engine import CellEngine
from mvp.cell.hardware import build_devices, check_simulated, opened
from mvp.cell.homing import HOMING_S, home_arm, homing_of, is_homed
from mvp.cell.interrupts import uninterrupted
from mvp.cell.logs import log_devices, log_to
from mvp.cell.preflight import Routes, check_limits
from mvp.cell.progress import Tell, unheard
from mvp.cell.records import DeviceRecord
from mvp.cell.run_document import RunDocument, run_document
from mvp.cell.runner import Runner, RunOutcome
from mvp.cell.simulation import simulation_of
from mvp.cell.standstill import UnderWay, seen_at_rest, stopped_on_error
from mvp.cell.stillness import StillCheck
from mvp.cell.verification import (
    Expectations,
    PictureVerifier,
    TaskExposure,
    declared_axes,
)
from mvp.cell.wire_dumps import keep_with_run
from mvp.cell.world_building import WorldBodies
from mvp.errors import OutputError, StoppedByOperator

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import ExitStack

    from mvp.cell.engine import CellDevices
    from mvp.cell.plan_job import Setting
    from mvp.cell.records import RecordLog
    from mvp.cell.run_folder import RunFolder
    from mvp.cell.states import RunStatus
    from mvp.devices import DeviceInfo, Homing
    from mvp.planning.plan import Plan, PlannedView

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Motion:
    """What a person is asked to allow.

    Attributes:
        homing: what the arm does first to find its references; None when it knows them.
        errand: what it does then, in words; empty for taking the views.
    """

    cell: str
    views: int
    infos: dict[str, DeviceInfo]
    homing: Homing | None = None
    errand: str = ""

    @property
    def simulated(self) -> bool:
        """Every device says that it is simulated."""
        return all(info.simulated for info in self.infos.values())

    def believed(self, word: str) -> dict[str, str]:
        """Axes that nothing measures, with their places, and by whose word."""
        by = "nobody: everything is simulated" if self.simulated else word
        return dict.fromkeys(self.homing.believed if self.homing else (), by)


@dataclass(frozen=True)
class Watcher:
    """The person's side of a run.

    Attributes:
        allow: asked once before the first motion; False ends the run.
        follow: called in the caller's thread until the run has ended; may raise
            ``KeyboardInterrupt``, which stops the devices.
        on_status: told about every change.
        on_end: told how the run ended, before anything else is written.
        on_rest: told a moment later what stands then, and what may still be moving.
        on_phase: told what is being done before the first motion.
        word: whose word it is that axes which nothing measures are at their places.
    """

    allow: Callable[[Motion], bool]
    follow: Callable[[Runner], None]
    on_status: Callable[[RunStatus], None] | None = None
    on_end: Callable[[RunFolder, RunOutcome], None] | None = None
    on_rest: Callable[[RunOutcome], None] | None = None
    on_phase: Tell = unheard
    word: str = "the calling program"

    def tell_rest(self, outcome: RunOutcome) -> None:
        """Tell what stands; a failure to do so never spoils the run."""
        if self.on_rest is None:
            return
        try:
            self.on_rest(outcome)
        except Exception:
            _LOG.exception("what stands could not be told")

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
    """What a run left behind, and what it was made from.

    Attributes:
        log_error: why the log is incomplete, if it is.
    """

    setting: Setting
    document: RunDocument
    folder: RunFolder
    outcome: RunOutcome
    log_error: OutputError | None = None


@contextmanager
def devices_for(setting: Setting, tell: Tell = unheard) -> Iterator[CellDevices]:
    """The devices of a cell, not yet opened, with the task's part in its world.

    Raises:
        ConfigError, PluginError: a key or a driver that cannot be used.
        ConnectError: the simulators of the cell do not start.
    """
    scene = setting.scene
    bodies = WorldBodies(scene.scene.part, scene.fixtures_base)
    with simulation_of(setting.cell, setting.task, tell) as announced:
        yield build_devices(setting.cell, bodies, announced)


def check_before(
    setting: Setting,
    devices: CellDevices,
    infos: dict[str, DeviceInfo],
    views: Sequence[PlannedView],
    routes: Routes,
) -> None:
    """Everything that can be found out without moving.

    The way to the first view is left out while nobody knows where the arm is.
    """
    check_simulated(setting.cell, infos)
    accepted_on_devices(setting.cell, devices, infos, views)
    check_limits(devices, views, setting.task.config.exposure.exposure_s)
    if is_homed(devices.arm):
        routes.check_all(devices.arm.state().joints, views)
    elif views:
        routes.check_all(views[0].joints_rad, views)


def start_speed(
    setting: Setting, devices: CellDevices, infos: dict[str, DeviceInfo]
) -> float:
    """Share of full speed while nobody knows yet that the way is as it is believed.

    Full speed is for arms that exist in the computer alone.
    """
    virtual = infos["arm"].simulated and not devices.simulated_roles
    return 1.0 if virtual else setting.cell.config.motion.start_speed_fraction


@dataclass(frozen=True, eq=False)
class Session:
    """Opened devices and a checked plan.

    Attributes:
        accepted: calibrations that a person takes the responsibility for.
        believed: axes that nothing measures, by whose word.
    """

    setting: Setting
    devices: CellDevices
    infos: dict[str, DeviceInfo]
    routes: Routes
    watcher: Watcher
    accepted: dict[str, str] = field(default_factory=dict)
    believed: dict[str, str] = field(default_factory=dict)

    @classmethod
    def open(
        cls,
        stack: ExitStack,
        setting: Setting,
        views: Sequence[PlannedView],
        watcher: Watcher,
        expected: Setting | None = None,
    ) -> Session:
        """Open the devices, check everything, ask the person, home the arm if need be.

        Args:
            stack: closes what was opened.
            setting: what the views were planned for.
            views: to be taken.
            watcher: the person's side.
            expected: the cell before its part was found elsewhere. A simulated world
                is built from that: finding the part does not move it.

        Raises:
            MvpCellError: something does not hold; nothing has moved but, when the way
                from its references is not clear, the arm to those.
        """
        tell = watcher.on_phase
        devices = stack.enter_context(devices_for(expected or setting, tell))
        tell("connecting to arm, lens and camera")
        infos = stack.enter_context(opened(devices))
        routes = Routes(setting.arm)
        tell("checking limits and the way to every view")
        check_before(setting, devices, infos, views, routes)
        accepted = accepted_on_devices(setting.cell, devices, infos, views)
        warn_of_devices(setting.cell, devices, infos)
        homing = homing_of(devices.arm)
        motion = Motion(setting.cell.config.name, len(views), infos, homing)
        if not watcher.allow(motion):
            raise StoppedByOperator("the operator did not allow the arm to move")
        if homing is not None:
            _home(setting, devices, tell)
            routes.check_all(devices.arm.state().joints, views)
        believed = motion.believed(watcher.word)
        return cls(setting, devices, infos, routes, watcher, accepted, believed)

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
        with log_to(folder.log_file, folder.run_id) as log:
            self._log_start(plan, views)
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
                document, outcome = self._close(folder, plan, outcome, timing)
            _LOG.info("run: %s after %.2f s", document.status, timing["run"])
        return RunResult(self.setting, document, folder, outcome, log.error)

    def _close(
        self,
        folder: RunFolder,
        plan: Plan,
        outcome: RunOutcome,
        timing: dict[str, float],
    ) -> tuple[RunDocument, RunOutcome]:
        """Tell the end and write the result; only the first thing that failed is told."""
        if outcome.error is not None:
            self.watcher.tell_end(folder, outcome)
            outcome = self._seen_at_rest(outcome)
            keep_with_run(self.devices.dumps, folder.path)
        document = _document(self.setting, folder, plan, timing, outcome.stands)
        try:
            folder.write_document(document)
        except OutputError as error:
            _LOG.error("run: %s", error)
            if outcome.error is not None:
                further = (*outcome.further, error)
                return document, replace(outcome, further=further)
            outcome = replace(outcome, reason="error", error=error)
            self.watcher.tell_end(folder, outcome)
        return document, outcome

    def _seen_at_rest(self, outcome: RunOutcome) -> RunOutcome:
        """Look what stands now that everything was told to stop, and tell it."""
        rest = seen_at_rest(self.devices)
        left = rest.may_still_move(outcome.may_still_move)
        outcome = replace(outcome, may_still_move=left, stands=rest.stands)
        self.watcher.tell_rest(outcome)
        return outcome

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
        for axis, word in self.believed.items():
            _LOG.warning("run: axis %s: believed on the word of %s", axis, word)

    def _engine(self, folder: RunFolder, views: Sequence[PlannedView]) -> CellEngine:
        settle = self.setting.cell.config.settle
        exposure = self.setting.task.config.exposure
        expectations = Expectations(self.setting)
        return CellEngine(
            self.devices,
            arrived=arrival_tolerance(self.setting.cell.arm.joint_units),
            settle_s=(settle.arm_s, settle.lens_s),
            start_speed=start_speed(self.setting, self.devices, self.infos),
            preflight=lambda: check_before(
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
            verifier=PictureVerifier(
                expectations,
                folder.load,
                declared_axes(device_records(self.infos)),
            ),
            calibrated=self.setting.cell.calibrations.camera,
            still=StillCheck.of_cell(self.setting),
        )


def _home(setting: Setting, devices: CellDevices, tell: Tell) -> None:
    """Let the arm find its references; an error says what stands then."""
    tell("homing the arm")
    bodies, clearance_mm = setting.arm.bodies, setting.arm.clearance_mm
    under_way = UnderWay()
    with (
        stopped_on_error(devices, under_way, tell),
        under_way.moving("the arm, homing", HOMING_S),
    ):
        call_beside(lambda: home_arm(devices, bodies, clearance_mm), devices.stop)


def write_document(
    setting: Setting, folder: RunFolder, plan: Plan, timing_s: dict[str, float]
) -> RunDocument:
    """Write the result from plan and records, durably.

    Raises:
        OutputError: the disk does not take it.
    """
    document = _document(setting, folder, plan, timing_s)
    folder.write_document(document)
    return document


def _document(
    setting: Setting,
    folder: RunFolder,
    plan: Plan,
    timing_s: dict[str, float],
    stands: str = "",
) -> RunDocument:
    return run_document(
        plan,
        folder.records(),
        folder=str(folder.path),
        task=setting.task.config.name,
        timing_s=timing_s,
        stands=stands,
    )


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
            extra=info.extra,
        )
        for role, info in infos.items()
    ]
