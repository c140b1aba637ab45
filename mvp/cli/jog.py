"""``mvp-cell jog CELL``: move arm and lens by hand, look at the picture."""

from __future__ import annotations

import sys
from contextlib import ExitStack, contextmanager
from functools import partial
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
    from pathlib import Path

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
    """Move arm and lens by hand, and look at the picture.

    Inside the limits of a run; arm in base, tool or camera axes, lens in steps or mm. `help` lists the words.
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
            _follow(jogger, do, cell)
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
        jogger = Jogger(setting, devices, _save, _show, speed, homing_told=homing)
        with stopped_on_error(devices, jogger.under_way, phase):
            yield jogger


def _follow(jogger: Jogger, given: list[str] | None, cell: str) -> None:
    """One command after the other; at the prompt a refusal ends only its command."""
    from mvp.cell.beside import call_beside
    from mvp.cell.jog_words import Plain, parse
    from mvp.cli.naming import named
    from mvp.cli.output import console
    from mvp.errors import InfeasibleError, LimitError, OutputError, UsageError

    say = console()
    for line in given if given else _asked():
        try:
            command = parse(line)
            if command == Plain("quit"):
                return
            said = call_beside(partial(jogger.do, command), jogger.devices.stop)
            say.print(said, markup=False, highlight=False)
        except (UsageError, LimitError, InfeasibleError, OutputError) as error:
            if given:
                raise
            hint = named(error.hint, cell)
            say.print(f"{error.message}. {hint}", style="yellow", markup=False)


def _asked() -> Iterator[str]:
    """Lines typed at the prompt, until the end of input."""
    sys.stderr.write("help lists the words, quit ends\n")
    while True:
        sys.stderr.write("jog> ")
        sys.stderr.flush()
        line = sys.stdin.readline()
        if not line:
            return
        if line.strip():
            yield line


def _save(path: Path, frame: Frame) -> None:
    """The picture as it is, lossless."""
    import cv2

    from mvp.errors import OutputError

    done, data = cv2.imencode(".png", frame.pixels)
    try:
        path.write_bytes(data.tobytes() if done else b"")
    except OSError as error:
        raise OutputError(
            f"{path}: {error.strerror or error}",
            hint="name a file in a folder that can be written",
            where=str(path),
        ) from error


def _show(frame: Frame) -> None:
    """The picture as grey blocks, two rows of pixels in a line of text."""
    import cv2
    import numpy as np
    from rich.text import Text

    from mvp.cli.output import console

    say = console()
    width = max(min(say.width - 1, 160), 20)
    rows, columns = frame.pixels.shape
    height = max(round(width * rows / columns / 2), 2) * 2
    small = cv2.resize(frame.pixels, (width, height), interpolation=cv2.INTER_AREA)
    grey = (small.astype(np.float64) * 255 / frame.full_scale).round().astype(int)
    for above, below in zip(grey[0::2], grey[1::2], strict=True):
        line = Text(no_wrap=True, end="\n")
        for top, bottom in zip(above, below, strict=True):
            line.append(
                "\u2580", f"rgb({top},{top},{top}) on rgb({bottom},{bottom},{bottom})"
            )
        say.print(line, end="")
