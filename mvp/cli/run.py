"""``mvp-cell run CELL``: plan, drive, capture, verify, record."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mvp.cli.options import (
    AcceptOption,
    CellArgument,
    JsonOption,
    SeedOption,
    TaskOption,
    YesOption,
)

if TYPE_CHECKING:
    from mvp.cell.session import RunResult


def run(
    cell: CellArgument,
    task: TaskOption = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="parent of the run's folder")
    ] = Path("runs"),
    dry: Annotated[
        bool, typer.Option("--dry-run", help="check the whole plan; nothing moves")
    ] = False,
    step: Annotated[
        bool, typer.Option("--step", help="wait for a key before every view")
    ] = False,
    partial: Annotated[
        bool, typer.Option("--partial", help="run what can be covered")
    ] = False,
    locate: Annotated[
        bool,
        typer.Option("--locate", help="find the part from its own features first"),
    ] = False,
    part_id: Annotated[
        str, typer.Option("--part-id", metavar="ID", help="name of this specimen")
    ] = "",
    resume: Annotated[
        str | None,
        typer.Option("--resume", metavar="RUN", help="go on with a run that broke off"),
    ] = None,
    seed: SeedOption = 0,
    accept_calibration: AcceptOption = "",
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> int:
    """Plan the views, take the pictures, prove the task in them."""
    from mvp.cell.hardware import check_driver_configs
    from mvp.cell.loading import load_cell
    from mvp.cell.run_job import RunOptions
    from mvp.cli import run_flow

    if locate:
        _refuse_without_motion(dry=dry, resume=resume)
    loaded = load_cell(cell, accept_calibration=accept_calibration, finds_part=locate)
    check_driver_configs(loaded)
    options = RunOptions(out=out, part_id=part_id, step=step, partial=partial)
    flow = run_flow.RunFlow(cell, loaded, task, options, seed=seed, yes=yes)
    if resume is not None:
        return _finished(cell, flow.resume(resume), as_json)
    if dry:
        return flow.dry_run(as_json)
    result = flow.locate_and_start() if locate else flow.start()
    return _finished(cell, result, as_json)


def _refuse_without_motion(*, dry: bool, resume: str | None) -> None:
    """The part is looked for by moving, and once for a run."""
    from mvp.errors import UsageError

    if dry:
        raise UsageError(
            "--locate moves the arm, and --dry-run moves nothing",
            hint="leave out one of them",
        )
    if resume is not None:
        raise UsageError(
            "a resumed run goes on with the part where it was found",
            hint="leave out --locate, or start a new run",
        )


def _finished(cell: str, result: RunResult, as_json: bool) -> int:
    """Table or document; an early end is an error that names the run's folder."""
    from mvp.cell.interrupts import uninterrupted
    from mvp.cell.run_document import EXIT_CODES
    from mvp.cli.output import print_model
    from mvp.cli.tables import print_run

    document = result.document
    with uninterrupted():
        print_run(document)
        if result.outcome.reason != "completed":
            return _ended_early(cell, result, as_json)
        if as_json:
            print_model(document)
        return EXIT_CODES[document.status]


def _ended_early(cell: str, result: RunResult, as_json: bool) -> int:
    """The document for the program; the person was told at once when it ended."""
    from mvp.cli.naming import name_cell
    from mvp.cli.output import report_error
    from mvp.cli.run_flow import early_end

    outcome = result.outcome
    error = early_end(result.setting.cell, result.folder, outcome)
    if error is None:
        raise outcome.error or RuntimeError("the run ended early without an error")
    name_cell(error, cell)
    folder = str(result.folder.path)
    return report_error(error, as_json=as_json, folder=folder, told=True)
