"""Drive a calibration wizard on a cell, or compute a stored session once more."""

from __future__ import annotations

import logging
import shlex
import shutil
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from pydantic import JsonValue, TypeAdapter, ValidationError

from mvp.cell.beside import call_beside
from mvp.cell.calibrate_bench import CellBench
from mvp.cell.calibrate_document import CalibrateDocument
from mvp.cell.calibrate_facts import facts_of
from mvp.cell.calibrate_folders import (
    REPORT_FILE,
    RESULT_FILE,
    existing_session,
    new_session,
    put_in_place,
    unfinished_session,
)
from mvp.cell.calibration_gates import of_serials, require_accepted
from mvp.cell.durable import check_writable, write_durably
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
from mvp.wizard import Outcome, Store, Wizard, WizardOptions, load_wizard

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mvp.cell.loading import LoadedCell
    from mvp.cell.plan_job import Setting
    from mvp.devices import DeviceInfo
    from mvp.fileedge import FileModel
    from mvp.wizard import Answer, SessionFacts, Step

_LOG = logging.getLogger(__name__)
_SESSION_BYTES = 200_000_000
_LOCK_NAME = ".calibrate.lock"
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
    folder = _folder(setting, wizard)
    check_writable(folder, needed_bytes=_SESSION_BYTES)
    with ExitStack() as stack:
        who = f"calibrate {request.key}"
        stack.enter_context(using_devices(setting.cell, who=who))
        stack.enter_context(cell_lock(folder / _LOCK_NAME, run_id=who))
        path = _session_path(folder, request)
        devices = stack.enter_context(devices_for(setting, tell))
        tell("connecting to arm, lens and camera")
        infos = stack.enter_context(opened(devices))
        check_simulated(setting.cell, infos)
        check_reliance(setting.cell, infos, request.key, request.accept)
        fresh = facts_of(
            setting.cell, devices, infos, key=request.key, seed=request.seed
        )
        store = _store(wizard, path, fresh, resume=request.resume)
        speed = start_speed(setting, devices, infos)
        bench = CellBench(setting, devices, store.facts, start_speed=speed)
        with (
            log_to(store.path / _LOG_FILE, store.path.name),
            _resumable(setting, store, request.key),
            stopped_on_error(devices, bench.under_way, tell),
        ):
            log_devices(infos.values())
            allow_and_home(setting, bench, infos, front, request.key)
            outcome = drive(wizard, bench, store, request.options, front)
    with uninterrupted():
        document = _put_in_place(setting, wizard, store, outcome)
    tell("drawing the report")
    return _with_page(wizard, store, outcome, document)


def recompute(request: CalibrateRequest, folder: Path) -> CalibrateDocument:
    """The result of a stored session, from its files alone; nothing is put in place.

    Raises:
        RecordError: not a session of this wizard, damaged, or changed.
        CalibrationError: there is nothing to compute from.
    """
    wizard = load_wizard(request.key)
    store = wizard.sessions.open(existing_session(folder))
    _check_key(store, request.key)
    outcome = wizard.outcome(store)
    document = _document(store, outcome)
    stored = _stored_document(store.path / RESULT_FILE)
    if stored is not None:
        same = stored.document == document.document
        document = document.model_copy(update={"same_numbers": same})
    return _drawn(wizard, store, outcome, document)


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
    _check_key(store, fresh.key)
    then, now = store.facts.model_dump(), fresh.model_dump()
    free = {"date", "temperature_c", "seed"}
    changed = sorted(k for k in then if k not in free and then[k] != now[k])
    if changed:
        raise RecordError(
            f"{path}: the cell has changed since this session began: "
            f"{', '.join(changed)}",
            hint="begin a new session; leave out --resume",
            where=str(path),
        )
    return store


def _check_key(store: Store, key: str) -> None:
    if store.facts.key != key:
        raise RecordError(
            f"{store.path}: a session of `calibrate {store.facts.key}`, not of "
            f"`calibrate {key}`",
            hint=f"say `mvp-cell calibrate {store.facts.key} CELL --session DIR`",
            where=str(store.path),
        )


def check_reliance(
    cell: LoadedCell, infos: dict[str, DeviceInfo], key: str, accept: str
) -> None:
    """Refuse to build on a calibration that is poor, or of another device.

    Raises:
        CalibrationError: it is, must be measured first, and nobody accepts it.
    """
    found, needed = cell.calibrations, _RELIES_ON.get(key, ())
    serials = {role: info.serial for role, info in infos.items()}
    objections = [*found.objections, *of_serials(found, serials)]
    require_accepted([one for one in objections if one.name in needed], accept)


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


def _put_in_place(
    setting: Setting, wizard: Wizard[Any], store: Store, outcome: Outcome
) -> CalibrateDocument:
    """Put the result in place unless it is a NO-GO, and write what was found."""
    document = _document(store, outcome)
    if outcome.document is not None and outcome.quality.verdict != "no-go":
        target = setting.cell.calibrations.files[wizard.writes]
        text = outcome.document.model_dump_json(by_alias=True, indent=1) + "\n"
        kept = put_in_place(target, text.encode())
        document = document.model_copy(
            update={"placed": str(target), "kept": str(kept) if kept else None}
        )
    _write_result(store, document)
    return document


def _write_result(store: Store, document: CalibrateDocument) -> None:
    text = document.model_dump_json(by_alias=True, indent=1) + "\n"
    write_durably(store.path / RESULT_FILE, text.encode())


def _document(store: Store, outcome: Outcome) -> CalibrateDocument:
    return CalibrateDocument(
        key=outcome.key,
        cell=store.facts.cell,
        simulated=store.facts.simulated,
        session=str(store.path),
        verdict=outcome.quality.verdict,
        samples=store.count,
        input_sha256=store.sha256(),
        lines=list(outcome.lines),
        quality=outcome.quality,
        document=_plain(outcome.document),
    )


def _plain(document: FileModel | None) -> JsonValue:
    """As it will be read back from its file, to the last digit."""
    if document is None:
        return None
    text = document.model_dump_json(by_alias=True)
    value: JsonValue = TypeAdapter(JsonValue).validate_json(text)
    return value


def _stored_document(path: Path) -> CalibrateDocument | None:
    try:
        return CalibrateDocument.model_validate_json(path.read_bytes())
    except (OSError, ValidationError):
        return None


def _with_page(
    wizard: Wizard[Any], store: Store, outcome: Outcome, document: CalibrateDocument
) -> CalibrateDocument:
    """The document with its report, in the folder, too."""
    drawn = _drawn(wizard, store, outcome, document)
    _write_result(store, drawn)
    return drawn


def _drawn(
    wizard: Wizard[Any], store: Store, outcome: Outcome, document: CalibrateDocument
) -> CalibrateDocument:
    """Draw the report; one that fails never spoils the result."""
    try:
        page = wizard.page(store, outcome)
        if not page:
            return document
        path = store.path / REPORT_FILE
        write_durably(path, page.encode())
    except Exception as error:
        _LOG.debug("no report", exc_info=error)
        why = f"no report: {type(error).__name__}: {error}"
        return document.model_copy(update={"lines": [*document.lines, why]})
    return document.model_copy(update={"report": str(path)})
