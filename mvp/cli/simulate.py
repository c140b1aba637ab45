"""``mvp-cell simulate CELL``: world and simulators of a simulated cell."""

from __future__ import annotations

import signal
import sys
import threading
from contextlib import nullcontext
from typing import Annotated

import typer

from mvp.cli.options import AcceptOption, CellArgument, TaskOption


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
    """Start the far ends of a simulated cell; says READY and where they listen.

    Other commands on the same cell use them until Ctrl-C ends it.
    """
    from mvp.cell.loading import load_cell, load_task
    from mvp.cell.simulation_host import found_by_others, hosted
    from mvp.cli.output import console

    loaded = load_cell(cell, accept_calibration=accept_calibration)
    with hosted(loaded, load_task(loaded, task)) as simulation:
        shared = nullcontext() if until_eof else found_by_others(loaded, simulation)
        with shared:
            print("READY", simulation.model_dump_json(by_alias=True), flush=True)
            if not until_eof:
                console().print(f"{loaded.config.name} is simulated until Ctrl-C")
            _wait_for_end(until_eof=until_eof)
    return 0


def _wait_for_end(*, until_eof: bool) -> None:
    """Until standard input ends, or until Ctrl-C or SIGTERM."""
    if until_eof:
        while sys.stdin.buffer.read(4096):
            pass
        return
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    while not ended.wait(0.2):
        pass
