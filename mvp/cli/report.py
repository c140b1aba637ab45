"""``mvp-cell report RUN``: write the report of a run again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mvp.cli.options import JsonOption


def report(
    run: Annotated[str, typer.Argument(metavar="RUN", help="a run folder or its id")],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="the folder that holds the runs"),
    ] = Path("runs"),
    as_json: JsonOption = False,
) -> int:
    """Write report.html of a run again, from its folder alone."""
    from mvp.cell.documents import ReportDocument
    from mvp.cell.report import write_report
    from mvp.cell.run_folder import find_run
    from mvp.cli.output import console, print_model

    folder = find_run(run, [out])
    page = write_report(folder.path)
    console().print(f"report: {page}")
    if as_json:
        print_model(ReportDocument(run_id=folder.run_id, file=str(page)))
    return 0
