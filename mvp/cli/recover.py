"""``mvp-cell recover CELL``: the way back from a stop, each step confirmed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from mvp.cli.ask import ask, terminal
from mvp.cli.options import AcceptOption, CellArgument, JsonOption, TaskOption
from mvp.cli.output import console
from mvp.errors import DeviceError, UsageError

if TYPE_CHECKING:
    from mvp.cell.recover_job import RecoveredDevice
    from mvp.devices import RecoveryStep


def recover(
    cell: CellArgument,
    task: TaskOption = None,
    accept_calibration: AcceptOption = "",
    as_json: JsonOption = False,
) -> int:
    """Lead devices back from a fault; asks before every step.

    Devices that know no way back of their own are only asked how they are: whatever they need is said, and has to be done by hand.

    Nothing moves unless a step says so. There is no --yes: whether an arm is free and nobody is near it, only a person sees.
    """
    from mvp.cell.loading import load_cell, load_task
    from mvp.cell.recover_job import Guide, recover_cell
    from mvp.cli.naming import named
    from mvp.cli.output import print_model
    from mvp.cli.progress import phase

    loaded = load_cell(cell, accept_calibration=accept_calibration)
    found = recover_cell(
        loaded,
        load_task(loaded, task),
        Guide(
            agree=lambda device, step: agree(
                device, replace(step, text=named(step.text, cell))
            ),
            tell=_tell,
        ),
        phase,
    )
    devices = [
        one.model_copy(update={"hint": named(one.hint, cell)}) for one in found.devices
    ]
    for device in devices:
        _show(device)
    if as_json:
        print_model(found.model_copy(update={"devices": devices}))
    return 0 if all(one.ready for one in devices) else DeviceError.exit_code


def _show(device: RecoveredDevice) -> None:
    """One line for a device that is ready; else what it needs by hand."""
    lines = console()
    if device.ready:
        more = f" ({device.hint})" if device.hint else ""
        lines.print(f"{device.name}: {device.detail}{more}", markup=False)
        return
    lines.print(
        f"{device.name}: NOT ready: {device.detail}",
        style="bold red",
        markup=False,
    )
    lines.print(f"by hand: {device.hint}", markup=False)


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
