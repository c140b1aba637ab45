"""``mvp-cell init DIR``: a bundled cell to edit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mvp.cli.options import JsonOption


def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="a new folder")],
    source: Annotated[
        str, typer.Option("--from", metavar="NAME", help="bundled cell or template")
    ] = "virtual",
    as_json: JsonOption = False,
) -> int:
    """Copy a bundled cell with all its files, to edit."""
    from mvp.cell.documents import InitDocument
    from mvp.cell.init_job import copy_cell, lines_to_edit
    from mvp.cli.output import console, print_model

    files = copy_cell(source, folder)
    lines = console()
    lines.print(f"{len(files)} files of the {source} cell are now in {folder}")
    edits = lines_to_edit(folder)
    if edits:
        lines.print(f"edit these {len(edits)} lines of {folder / 'cell.toml'}:")
        for number, line in edits:
            lines.print(f"{number:5d}  {line.strip()}", markup=False, highlight=False)
        lines.print(f"then `mvp-cell check {folder}`, which moves nothing")
    else:
        lines.print(f"next: edit {folder / 'cell.toml'}, then `mvp-cell run {folder}`")
    if as_json:
        print_model(InitDocument(folder=str(folder), files=files))
    return 0
