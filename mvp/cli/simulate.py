"""``mvp-cell simulate CELL``: world and simulators of a simulated cell."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from typing import Annotated

import typer

from mvp.cell.interrupts import uninterrupted
from mvp.cli.options import AcceptOption, CellArgument, TaskOption
from mvp.cli.output import console
from mvp.cli.progress import phase

_LOOK_EVERY_S = 0.5


def simulate(
    cell: CellArgument,
    task: TaskOption = None,
    accept_calibration: AcceptOption = "",
    until_eof: Annotated[
        bool,
        typer.Option(
            "--until-eof",
            help="end with standard input; other commands do not see this simulation",
        ),
    ] = False,
) -> int:
    """Start the far ends of a simulated cell, until Ctrl-C.

    Says READY and where they listen. Other commands on the same cell use them until Ctrl-C ends it.
    """
    from mvp.cell.loading import load_cell, load_task
    from mvp.cell.lock import refuse_held
    from mvp.cell.simulation import simulation_lock
    from mvp.cell.simulation_host import found_by_others, hosted

    loaded = load_cell(cell, accept_calibration=accept_calibration)
    loaded_task = load_task(loaded, task)
    if not until_eof:
        refuse_held(simulation_lock(loaded.source.path))
    with ExitStack() as stack:
        simulation = stack.enter_context(hosted(loaded, loaded_task, phase))
        if not until_eof:
            stack.enter_context(found_by_others(loaded, simulation))
        print("READY", simulation.model_dump_json(by_alias=True), flush=True)
        try:
            _wait_for_end(loaded.config.name, until_eof=until_eof)
        finally:
            with uninterrupted():
                stack.close()
    return 0


def _wait_for_end(name: str, *, until_eof: bool) -> None:
    """Until standard input ends; else until Ctrl-C or SIGTERM, which raise."""
    if until_eof:
        while sys.stdin.buffer.read(4096):
            pass
        return
    console().print(f"{name} is simulated until Ctrl-C", markup=False)
    while True:
        time.sleep(_LOOK_EVERY_S)
