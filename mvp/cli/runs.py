"""``mvp-cell runs``: the runs of a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mvp.cli.options import JsonOption


def runs(
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="the folder that holds the runs"),
    ] = Path("runs"),
    as_json: JsonOption = False,
) -> int:
    """List the runs kept in a folder."""
    from rich.table import Column, Table

    from mvp.cell.documents import RunsDocument
    from mvp.cell.run_list import summaries
    from mvp.cli.output import console, print_model

    found = summaries(out)
    table = Table(
        Column("run", overflow="fold"), "cell", "task", "part", "status", "views"
    )
    for run in found:
        views = f"{run.verified} of {run.views} verified"
        if run.status in ("broken off", "running"):
            views = f"{run.captured} of {run.views} captured"
        table.add_row(run.run_id, run.cell, run.task, run.part_id, run.status, views)
    lines = console()
    if found:
        lines.print(table)
        for run in found:
            if run.resume:
                lines.print(f"go on with: {run.resume}", markup=False)
    else:
        lines.print(f"no runs in {out}")
    if as_json:
        print_model(RunsDocument(runs=found))
    return 0
