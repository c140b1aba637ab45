"""``mvp-cell recover CELL``: the way back from a stop, each step confirmed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.cli.ask import ask, terminal
from mvp.cli.options import AcceptOption, CellArgument, JsonOption, TaskOption
from mvp.cli.output import console
from mvp.errors import UsageError

if TYPE_CHECKING:
    from mvp.devices import RecoveryStep


def recover(
    cell: CellArgument,
    task: TaskOption = None,
    accept_calibration: AcceptOption = "",
    as_json: JsonOption = False,
) -> int:
    """Lead devices back from a fault; asks before every step.

    Nothing moves unless a step says so. There is no --yes: whether an arm is free and nobody is near it, only a person sees.
    """
    from mvp.cell.loading import load_cell, load_task
    from mvp.cell.recover_job import Guide, recover_cell
    from mvp.cli.output import print_model

    loaded = load_cell(cell, accept_calibration=accept_calibration)
    document = recover_cell(
        loaded, load_task(loaded, task), Guide(agree=agree, tell=_tell)
    )
    lines = console()
    for device in document.devices:
        said = "ready" if device.recoverable else "knows no way back of its own"
        lines.print(f"{device.name}: {said}", markup=False)
    if as_json:
        print_model(document)
    return 0


def agree(device: str, step: RecoveryStep) -> bool:
    """Show one step and ask.

    Raises:
        UsageError: nobody can be asked.
    """
    if not terminal():
        raise UsageError(
            f"{device}: {step.text}",
            hint="run it on a terminal: every step has to be confirmed by a person",
            where=device,
        )
    style = "bold yellow" if step.acknowledge else ""
    console().print(f"{device}: {step.text}", style=style, markup=False)
    question = "Seen to, and go on? [y/N] " if step.acknowledge else "Go on? [y/N] "
    return ask(question).strip().lower() in ("y", "yes")


def _tell(device: str, reached: str) -> None:
    console().print(f"{device}: {reached}", style="green", markup=False)
