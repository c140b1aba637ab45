"""``mvp-cell target CELL``: the calibration target of a cell, to print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mvp.cli.options import CellArgument, JsonOption


def target(
    cell: CellArgument,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE.pdf", help="where to write it")
    ] = Path("target.pdf"),
    paper: Annotated[
        str, typer.Option("--paper", metavar="NAME", help="A4 A3 A2 A1 A0 letter")
    ] = "A4",
    as_json: JsonOption = False,
) -> int:
    """Write the calibration target of a cell as a PDF, to scale."""
    from mvp.cell.target_job import draw_target
    from mvp.cli.output import console, print_model

    document = draw_target(cell, out, paper)
    lines = console()
    width, height = document.page_mm
    lines.print(f"{document.file}: {document.title}", markup=False)
    lines.print(
        f"print it on {document.paper} ({width:g} x {height:g} mm) at actual size (100 %), "
        "without fitting it to the page",
        markup=False,
    )
    lines.print(
        f"then measure the ruler ({document.ruler_mm:g} mm between its end ticks) and "
        "several squares along both sides; `mvp-cell calibrate` asks for the squares",
        markup=False,
    )
    if as_json:
        print_model(document)
    return 0
