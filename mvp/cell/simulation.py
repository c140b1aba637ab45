"""The simulators behind a cell: found where they run already, or started for a run.

A simulated cell keeps its world and its simulators in a process of their own, so that
the devices under test share nothing with them but the wire.
"""

from __future__ import annotations

import contextlib
import logging
import selectors
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal

from pydantic import Field, ValidationError

from mvp.cell.lock import held_by, private_file
from mvp.cell.progress import Tell, unheard
from mvp.errors import ConnectError, MvpCellError, UsageError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import IO

    from mvp.cell.hardware import Announced
    from mvp.cell.loading import LoadedCell, LoadedTask

_LOG = logging.getLogger(__name__)
_START_S = 90.0
_END_S = 10.0
SIMULATION_SCHEMA: Literal["mvp-cell/simulation/1"] = "mvp-cell/simulation/1"


class SimulatedDevice(FileModel):
    """Where one simulator listens.

    Attributes:
        table: keys for the device's table of the cell file.
        control_port: of its private fault channel on 127.0.0.1.
    """

    table: dict[str, str | int | float | bool]
    control_port: int = Field(ge=0, le=65535)


class Simulation(FileModel):
    """A running simulation, as its READY line says it."""

    schema_: Literal["mvp-cell/simulation/1"] = Field(
        default=SIMULATION_SCHEMA, alias="schema"
    )
    cell: str
    task: str
    devices: dict[Literal["arm", "lens", "camera"], SimulatedDevice]

    @property
    def announced(self) -> Announced:
        """The keys that complete the devices' own tables."""
        return {role: dict(device.table) for role, device in self.devices.items()}


def announcement(cell_file: Path) -> Path:
    """Where a running simulation of a cell says what it is."""
    return private_file(cell_file, ".simulation.json")


def simulation_lock(cell_file: Path) -> Path:
    """Held as long as the simulation of a cell runs."""
    return private_file(cell_file, ".simulation.lock")


@contextmanager
def simulation_of(
    cell: LoadedCell, task: LoadedTask, tell: Tell = unheard
) -> Iterator[Announced]:
    """Where the simulators of a cell listen; nothing for a cell without simulators.

    One that ``mvp-cell simulate`` has started is used as it stands; otherwise one is
    started, and ended with this context.

    Args:
        cell: with or without simulators.
        task: what stands in their world.
        tell: hears what takes time.

    Raises:
        ConnectError: it does not start.
        UsageError: the one that runs shows another task.
    """
    if not cell.config.simulators.by_role:
        yield {}
        return
    running = _running(cell, task)
    if running is not None:
        tell("using the simulation that runs")
        _LOG.info("simulation: using the one that runs")
        yield running.announced
        return
    tell(f"starting the simulators of {cell.config.name}")
    with _started(cell, task) as simulation:
        yield simulation.announced


def refuse_other_task(cell: LoadedCell, task: LoadedTask) -> None:
    """Before work that would be in vain: somebody simulates the cell with another part.

    Raises:
        UsageError: as for ``simulation_of``.
    """
    if cell.config.simulators.by_role:
        _running(cell, task)


def _running(cell: LoadedCell, task: LoadedTask) -> Simulation | None:
    """The simulation that somebody else has started."""
    place = cell.source.path
    if held_by(simulation_lock(place)) is None:
        return None
    try:
        text = announcement(place).read_text(encoding="utf-8")
        found = Simulation.model_validate_json(text)
    except (OSError, ValidationError):
        return None  # it has only begun, or has just ended
    if found.task != str(task.source.path):
        raise UsageError(
            f"the simulation of {cell.config.name} that runs shows {found.task}, "
            f"not {task.source.path}",
            hint=f"give this command --task {found.task}; or end that simulation and "
            f"start it again with --task {task.source.path}",
            where=found.task,
        )
    return found


@contextmanager
def _started(cell: LoadedCell, task: LoadedTask) -> Iterator[Simulation]:
    """A simulation of our own, in a process that ends when we do."""
    command = [sys.executable, "-m", "mvp", "simulate", str(cell.source.path)]
    command += ["--task", str(task.source.path), "--until-eof"]
    if cell.accept_calibration:
        command += ["--accept-calibration", cell.accept_calibration]
    _LOG.info("simulation: starting")
    with tempfile.TemporaryFile() as words:
        # Its own session: Ctrl-C must reach the devices first, not the simulators.
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=words,
            start_new_session=True,
        )
        try:
            yield _ready(process, words, cell.config.name)
        finally:
            _end(process)
            _LOG.info("simulation: ended")


def _ready(process: subprocess.Popen[bytes], words: IO[bytes], name: str) -> Simulation:
    """Wait for the line that says where everything listens."""
    if process.stdout is None:
        raise RuntimeError("the simulation was started without a pipe")
    until = time.monotonic() + _START_S
    line = b""
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        while not line.endswith(b"\n") and time.monotonic() < until:
            if selector.select(timeout=0.2):
                piece = process.stdout.read1(65536)  # type: ignore[attr-defined]
                line += piece
                if not piece:
                    break
    try:
        return Simulation.model_validate_json(line.removeprefix(b"READY "))
    except ValidationError as error:
        words.seek(0)
        said = words.read().decode("utf-8", "replace").strip()[-2000:]
        raise _not_started(said, process, name) from error


def _not_started(
    said: str, process: subprocess.Popen[bytes], name: str
) -> MvpCellError:
    """In its own words where it told; with its own kind of error."""
    lines = said.splitlines()
    told = [x.removeprefix("error: ") for x in lines if x.startswith("error: ")]
    hints = [x.removeprefix("hint:").strip() for x in lines if x.startswith("hint:")]
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_END_S)
    if told and process.returncode == UsageError.exit_code:
        return UsageError(told[0], hint=" ".join(hints), where=name)
    why = told[0] if told else said or "it said nothing"
    return ConnectError(
        f"did not start: {why}",
        device=f"simulation of {name}",
        hint=" ".join(hints) or "`mvp-cell simulate CELL` shows more",
    )


def _end(process: subprocess.Popen[bytes]) -> None:
    """The end of its input ends it; a simulation that hangs is killed."""
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        _LOG.warning("simulation: did not end by itself and was killed")
        process.kill()
        process.wait()
