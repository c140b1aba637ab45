"""``mvp-cell runs``: the runs of a folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mvp.cli.options import JsonOption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.documents import RunSummary

_ID_WIDTH = 44  # a longer id moves its own line only


def runs(
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="the folder that holds the runs"),
    ] = Path("runs"),
    as_json: JsonOption = False,
) -> int:
    """List the runs kept in a folder."""
    from mvp.cell.documents import RunsDocument
    from mvp.cell.run_list import summaries
    from mvp.cli.output import console, print_model

    found = summaries(out)
    lines = console()
    if found:
        print_runs(found)
        for run in found:
            if run.resume:
                lines.print(f"go on with: {run.resume}", markup=False)
    else:
        lines.print(f"no runs in {out}", markup=False)
    if as_json:
        print_model(RunsDocument(runs=found))
    return 0


def print_runs(found: Sequence[RunSummary]) -> None:
    """One line each, never wrapped: an id that is cut cannot be copied."""
    from mvp.cli.output import console

    rows = [("run", "status", "views", "cell")]
    for run in found:
        done, count = "verified", run.verified
        if run.status in ("broken off", "running"):
            done, count = "captured", run.captured
        views = f"{count} of {run.views} {done}" if run.views else ""
        rows.append((run.run_id, run.status, views, run.cell))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    widths[0] = min(widths[0], _ID_WIDTH)
    for row in rows:
        padded = (f"{text:<{width}}" for text, width in zip(row, widths, strict=True))
        console().print("  ".join(padded).rstrip(), markup=False)
