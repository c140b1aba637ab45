"""Drive a calibration wizard on a cell, or compute a stored session once more."""

from __future__ import annotations

import logging
import shlex
import shutil
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from mvp.cell.beside import call_beside
from mvp.cell.calibrate_bench import CellBench
from mvp.cell.calibrate_facts import facts_of, keep_size
from mvp.cell.calibrate_folders import (
    existing_session,
    new_session,
    unfinished_session,
)
from mvp.cell.calibrate_result import check_key, keep_result, with_page
from mvp.cell.calibrated_devices import device_objections
from mvp.cell.calibration_gates import of_views, require_accepted
from mvp.cell.durable import check_writable
from mvp.cell.hardware import check_simulated, opened
from mvp.cell.homing import HOMING_S, home_arm, homing_of
from mvp.cell.in_use import using_devices
from mvp.cell.interrupts import uninterrupted
from mvp.cell.lock import cell_lock
from mvp.cell.logs import log_devices, log_to
from mvp.cell.places import bundled_root
from mvp.cell.progress import Tell, unheard
from mvp.cell.session import Motion, devices_for, start_speed
from mvp.cell.standstill import stopped_on_error
from mvp.errors import MvpCellError, RecordError, StoppedByOperator, UsageError
from mvp.wizard import Outcome, Say, Store, Wizard, WizardOptions, load_wizard

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from mvp.cell.calibrate_document import CalibrateDocument
    from mvp.cell.calibration_gates import Objection
    from mvp.cell.engine import CellDevices
    from mvp.cell.loading import LoadedCell
    from mvp.cell.plan_job import Setting
    from mvp.devices import DeviceInfo
    from mvp.planning.plan import PlannedView
    from mvp.wizard import Answer, SessionFacts, Step

_LOG = logging.getLogger(__name__)
_SPARE_BYTES, _PICTURES = 20_000_000, 100
LOCK_NAME = ".calibrate.lock"
_LOG_FILE = "log.jsonl"
_PLACES = 30  # about as many as a wizard visits
# What a wizard relies on must have been measured with the devices that are there.
_RELIES_ON = {
    "lens": ("camera",),
    "hand-eye": ("camera", "lens_table"),
    "part": ("camera", "lens_table", "hand_eye"),
}


class FrontEnd(Protocol):
    """The person's side of a session."""

    def allow(self, motion: Motion) -> bool:
        """Asked once, before anything moves."""
        ...

    def answer(self, step: Step) -> Answer:
        """Show a step; the answer to it, None where none is due.

        Raises:
            UsageError: it needs an answer, and nobody can be asked.
            KeyboardInterrupt: the person ends the session.
        """
        ...


@dataclass(frozen=True)
class CalibrateRequest:
    """What is asked for.

    Attributes:
        key: of the wizard.
        session: of ``--session``; None: a new one, or with ``resume`` the newest.
        resume: go on with a session that broke off.
        seed: of a new session.
        accept: why a person takes the responsibility for poor calibrations that this
            one builds on; empty: they are refused.
        options: for the wizard.
    """

    key: str
    session: Path | None = None
    resume: bool = False
    seed: int = 0
    accept: str = ""
    options: WizardOptions = field(default_factory=WizardOptions)


def refuse_bundled(cell_file: Path) -> None:
    """Bundled cells are shared by everybody and may be replaced by an update.

    Raises:
        UsageError: it is one.
    """
    if cell_file.resolve().is_relative_to(bundled_root().resolve()):
        name = cell_file.parent.name
        raise UsageError(
            f"{name} is a bundled cell and cannot be calibrated in place",
            hint=f"run `mvp-cell init DIR --from {name}` first, then calibrate "
            "DIR/cell.toml",
            where=str(cell_file),
        )


def calibrate(
    setting: Setting,
    request: CalibrateRequest,
    front: FrontEnd,
    tell: Tell = unheard,
) -> CalibrateDocument:
    """Take a session at the cell to its end, and put the result in place.

    Raises:
        DeviceError: a device failed; the session can be resumed.
        StoppedByOperator: a person ended it; so can this one.
        CalibrationError: the wizard cannot do it in this cell.
        RecordError: the session to resume belongs to another state of the cell.
    """
    refuse_bundled(setting.cell.source.path)
    wizard = load_wizard(request.key)
    place = setting.cell.calibrations.files[wizard.writes]
    camera = setting.cell.calibrations.camera
    pictures = _PICTURES * camera.width_px * camera.height_px
    check_writable(place.parent, needed_bytes=_SPARE_BYTES + pictures)
    store, outcome = _taken(setting, request, wizard, front, tell)
    with uninterrupted():
        keep_size(setting.cell.calibrations.files, store.facts.target)
        document = keep_result(place, store, outcome)
    tell("drawing the report")
    return with_page(wizard, store, outcome, document)


def _taken(
    setting: Setting,
    request: CalibrateRequest,
    wizard: Wizard[Any],
    front: FrontEnd,
    tell: Tell,
) -> tuple[Store, Outcome]:
    """The session with the devices open, from where it has come to."""
    key, folder = request.key, _folder(setting, wizard)
    with ExitStack() as stack:
        stack.enter_context(using_devices(setting.cell, who=f"calibrate {key}"))
        lock = folder / LOCK_NAME
        stack.enter_context(cell_lock(lock, run_id=f"calibrate {key}"))
        path = _session_path(folder, request)
        devices = stack.enter_context(devices_for(setting, tell))
        tell("connecting to arm, lens and camera")
        infos = stack.enter_context(opened(devices))
        check_simulated(setting.cell, infos)
        cell = setting.cell
        for one in check_reliance(cell, devices, infos, key, request.accept):
            front.answer(Say(f"{one.text}; {one.fix}", "warning"))
        fresh = facts_of(
            setting.cell,
            devices,
            infos,
            key=key,
            seed=request.seed,
            accepted=request.accept,
        )
        store = _store(wizard, path, fresh, resume=request.resume)
        speed = start_speed(setting, devices, infos)
        bench = CellBench(setting, devices, store.facts, start_speed=speed)
        with (
            log_to(store.path / _LOG_FILE, store.path.name),
            _resumable(setting, store, key),
            stopped_on_error(devices, bench.under_way, tell),
        ):
            log_devices(infos.values())
            allow_and_home(setting, bench, infos, front, key)
            return store, drive(wizard, bench, store, request.options, front)


def drive(
    wizard: Wizard[Any],
    bench: CellBench,
    store: Store,
    options: WizardOptions,
    front: FrontEnd,
) -> Outcome:
    """Let a wizard go its way; whatever moves does so beside this thread.

    Raises:
        KeyboardInterrupt: Ctrl-C; all devices have been stopped.
        MvpCellError: as the wizard and the devices raise.
    """
    steps = wizard.steps(bench, store, options)
    answer: Answer = None
    ended: list[Outcome] = []

    def further() -> Step | None:
        try:
            return steps.send(answer)
        except StopIteration as stop:
            ended.append(stop.value)
            return None

    try:
        while True:
            step = call_beside(further, bench.stop)
            if step is None:
                return ended[0]
            answer = front.answer(step)
    finally:
        with suppress(Exception):
            steps.close()


def _folder(setting: Setting, wizard: Wizard[Any]) -> Path:
    """Where the cell keeps the file that the wizard makes."""
    return setting.cell.calibrations.files[wizard.writes].parent


def _session_path(folder: Path, request: CalibrateRequest) -> Path:
    if request.session is not None:
        return existing_session(request.session)
    if request.resume:
        return unfinished_session(folder, request.key)
    return new_session(folder, request.key)


def _store(
    wizard: Wizard[Any], path: Path, fresh: SessionFacts, *, resume: bool
) -> Store:
    """A new session, or one that broke off, if the cell is still the same."""
    if not resume:
        store: Store = wizard.sessions.create(path, fresh)
        return store
    store = wizard.sessions.open(path, repair=True)
    check_key(store, fresh.key)
    target = store.facts.target
    if fresh.target is not None and target is not None:  # measured before it broke off
        sized = fresh.target.sized(target.measured)
        fresh = fresh.model_copy(update={"target": sized})
    then, now = store.facts.model_dump(), fresh.model_dump()
    free = {"date", "temperature_c", "temperature_source", "seed"}
    free |= {"accepted_calibration"}
    changed = sorted(k for k in then if k not in free and then[k] != now[k])
    if changed:
        raise RecordError(
            f"{path}: the cell has changed since this session began: "
            f"{', '.join(changed)}",
            hint="begin a new session; leave out --resume",
            where=str(path),
        )
    return store


def check_reliance(
    cell: LoadedCell,
    devices: CellDevices,
    infos: Mapping[str, DeviceInfo],
    key: str,
    accept: str,
    views: Sequence[PlannedView] = (),
) -> list[Objection]:
    """Refuse to build on a calibration that does not hold here and now.

    One that is poor, of another device, from the other side of approach, out of its
    temperature, or for other lens steps than the views need. One that is stale is only
    told: its turn may be yet to come. Nothing moves.

    Returns:
        What a person should be told before it goes on.

    Raises:
        CalibrationError: it must be measured first, and nobody accepts it.
    """
    found, needed = cell.calibrations, _RELIES_ON.get(key, ())
    answered = device_objections(cell, devices, infos)
    objections = [*found.objections, *answered, *of_views(found, views)]
    mine = [one for one in objections if one.name in needed]
    require_accepted([one for one in mine if not one.stale], accept)
    stale = [_becoming_stale(one) for one in mine if one.stale]
    doubtful = [one for one in answered if one in mine and not one.refused]
    return [*stale, *doubtful]


def _becoming_stale(objection: Objection) -> Objection:
    """What is built on a stale calibration is stale as soon as that is made anew."""
    text = f"{objection.text}; what is built on it will be, too"
    return replace(objection, text=text, fix=f"first, {objection.fix}")


def allow_and_home(
    setting: Setting,
    bench: CellBench,
    infos: dict[str, DeviceInfo],
    front: FrontEnd,
    key: str,
) -> None:
    """A person's consent, then the arm's references if it needs them."""
    devices, arm = bench.devices, setting.arm
    homing = homing_of(devices.arm)
    name, errand = setting.cell.config.name, f"take pictures for `calibrate {key}`"
    if not front.allow(Motion(name, _PLACES, infos, homing, errand=errand)):
        raise StoppedByOperator("the operator did not allow the arm to move")
    if homing is None:
        return
    with bench.under_way.moving("the arm, homing", HOMING_S):
        call_beside(lambda: home_arm(devices, arm.bodies, arm.clearance_mm), bench.stop)


@contextmanager
def _resumable(setting: Setting, store: Store, key: str) -> Iterator[None]:
    """Let an error say how the session goes on; one without a picture is dropped."""
    try:
        yield
    except BaseException as error:
        _LOG.info("ended early: %s: %s", type(error).__name__, error)
        if not store.count:
            shutil.rmtree(store.path, ignore_errors=True)
        elif isinstance(error, MvpCellError):
            first = f"{error.hint}; then " if error.hint else ""
            error.hint = f"{first}go on with: {_resume_command(setting, key)}"
        raise


def _resume_command(setting: Setting, key: str) -> str:
    cell, task = setting.cell, setting.task.source.path
    words = ["mvp-cell", "calibrate", key, str(cell.source.path), "--resume"]
    if task != (cell.folder / cell.config.default_task).resolve():
        words += ["--task", str(task)]
    return shlex.join(words)
