"""``mvp-cell jog CELL``: move arm and lens by hand, look at the picture."""

from __future__ import annotations

import sys
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from mvp.cli.options import (
    AcceptOption,
    CellArgument,
    JsonOption,
    TaskOption,
    YesOption,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.cell.jog_job import Jogger
    from mvp.cell.plan_job import Setting
    from mvp.devices import Frame


def jog(
    cell: CellArgument,
    task: TaskOption = None,
    do: Annotated[
        list[str] | None,
        typer.Option(
            "--do", metavar="COMMAND", help="carry this out instead of asking"
        ),
    ] = None,
    speed: Annotated[
        float, typer.Option("--speed", min=0.01, max=1.0, help="share of full speed")
    ] = 0.25,
    accept_calibration: AcceptOption = "",
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> int:
    """Move arm and lens by hand, and look at the live picture.

    Inside the limits of a run; arm in base, tool or camera axes, lens in steps or mm. A terminal shows where all is
    while it moves; `live` shows what the camera sees, there or in a file. `help` lists the words.
    """
    from mvp.cell.hardware import check_driver_configs
    from mvp.cell.in_use import using_devices
    from mvp.cell.loading import load_cell, load_task
    from mvp.cell.plan_job import prepare
    from mvp.cli.ask import terminal
    from mvp.cli.output import print_model
    from mvp.cli.progress import phase
    from mvp.errors import UsageError

    loaded = load_cell(cell, accept_calibration=accept_calibration)
    check_driver_configs(loaded)
    loaded_task = load_task(loaded, task)
    if not do and not terminal():
        raise UsageError(
            "jog asks for commands, and there is no terminal to ask on",
            hint='give them: --do "frame camera" --do "z 5"',
        )
    with using_devices(loaded, who="jog"):
        phase(f"loading {loaded_task.part_file.name}")
        setting = prepare(loaded, loaded_task)
        with _allowed(setting, speed, yes=yes) as jogger:
            _follow(jogger, do, cell, follow=sys.stderr.isatty() and not as_json)
            if as_json:
                print_model(jogger.document())
    return 0


@contextmanager
def _allowed(setting: Setting, speed: float, *, yes: bool) -> Iterator[Jogger]:
    """Open devices, a person's consent, and a stop when anything goes wrong.

    Raises:
        StoppedByOperator: motion was not allowed.
    """
    from mvp.cell.hardware import check_simulated, opened
    from mvp.cell.homing import homing_of
    from mvp.cell.jog_job import Jogger
    from mvp.cell.session import Motion, devices_for
    from mvp.cell.standstill import stopped_on_error
    from mvp.cli.ask import allow_motion
    from mvp.cli.picture import save_picture
    from mvp.cli.progress import phase
    from mvp.errors import StoppedByOperator

    cell = setting.cell
    with ExitStack() as stack:
        devices = stack.enter_context(devices_for(setting, phase))
        phase("connecting to arm, lens and camera")
        infos = stack.enter_context(opened(devices))
        check_simulated(cell, infos)
        homing = homing_of(devices.arm)
        errand = "move by hand, one command after the other"
        motion = Motion(cell.config.name, 1, infos, homing, errand)
        if not allow_motion(motion, yes=yes):
            raise StoppedByOperator("the operator did not allow the arm to move")
        jogger = Jogger(
            setting, devices, save_picture, _show, speed, homing_told=homing
        )
        # A motion is stopped before the live picture is, which may take its time.
        stack.callback(_without_live, jogger)
        with stopped_on_error(devices, jogger.under_way, phase):
            yield jogger


def _without_live(jogger: Jogger) -> None:
    """Nobody uses the camera any more when it is closed; Ctrl-C waits no longer."""
    from mvp.cli.progress import phase

    try:
        if jogger.live.is_on:
            phase("ending the live picture")
        jogger.live.end()
    except KeyboardInterrupt:
        # What ended the command stays what is told; the devices are closed all the same.
        phase("closing the camera before the live picture has ended")


def _follow(
    jogger: Jogger, given: list[str] | None, cell: str, *, follow: bool
) -> None:
    """One command after the other; at the prompt a refusal ends only its command."""
    from mvp.cell.jog_words import Plain, parse
    from mvp.cli.jog_screen import asked, carry_out, tell_news
    from mvp.cli.naming import named
    from mvp.cli.output import console
    from mvp.errors import InfeasibleError, LimitError, OutputError, UsageError

    say = console()
    for line in given if given else asked(jogger.live):
        try:
            command = parse(line)
            if command == Plain("quit"):
                return
            said = carry_out(jogger, command, follow=follow)
            say.print(said, markup=False, highlight=False)
        except (UsageError, LimitError, InfeasibleError, OutputError) as error:
            if given:
                raise
            hint = named(error.hint, cell)
            say.print(f"{error.message}. {hint}", style="yellow", markup=False)
        tell_news(jogger.live)


def _show(frame: Frame) -> None:
    """The picture as grey blocks, in the terminal."""
    from mvp.cli.output import console
    from mvp.cli.picture import show_picture

    show_picture(frame, console())
