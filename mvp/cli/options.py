"""Arguments and options that several commands share."""

from __future__ import annotations

from typing import Annotated, TypeAlias

import typer

CellArgument: TypeAlias = Annotated[
    str,
    typer.Argument(
        metavar="CELL", help="a cell.toml, its folder, or the name of a bundled cell"
    ),
]
TaskOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--task", metavar="TASK", help="a task file, or the name of a task in the cell"
    ),
]
JsonOption: TypeAlias = Annotated[
    bool,
    typer.Option("--json", help="one JSON document on stdout; the rest is on stderr"),
]
YesOption: TypeAlias = Annotated[
    bool, typer.Option("--yes", help="do not ask before anything moves")
]
AcceptOption: TypeAlias = Annotated[
    str,
    typer.Option(
        "--accept-calibration",
        metavar="REASON",
        help="use calibrations that would be refused; the reason is recorded",
    ),
]
SeedOption: TypeAlias = Annotated[
    int,
    typer.Option(
        "--seed",
        min=0,
        metavar="N",
        help="of the search; the same seed, the same plan",
    ),
]
