"""``mvp-cell plan CELL``: where the camera would go, and how safe that is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mvp.cli.options import (
    AcceptOption,
    CellArgument,
    JsonOption,
    SeedOption,
    TaskOption,
)


def plan(
    cell: CellArgument,
    task: TaskOption = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="PLAN.json", help="write the plan there as well"),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(
            "--figures", metavar="DIR", help="draw regions, viewpoints, expected views"
        ),
    ] = None,
    seed: SeedOption = 0,
    accept_calibration: AcceptOption = "",
    as_json: JsonOption = False,
) -> int:
    """Find camera poses and lens settings; nothing moves."""
    from mvp.cell.durable import check_file_writable, check_writable, write_durably
    from mvp.cell.hardware import check_driver_configs
    from mvp.cell.loading import load_cell, load_task
    from mvp.cell.plan_job import make_plan
    from mvp.cli.output import print_model
    from mvp.cli.progress import stages
    from mvp.cli.tables import print_plan

    loaded = load_cell(cell, accept_calibration=accept_calibration)
    check_driver_configs(loaded)
    asked = load_task(loaded, task)
    if out is not None:
        check_file_writable(out, needed_bytes=1_000_000)
    if figures is not None:
        check_writable(figures, needed_bytes=10_000_000)
    with stages() as tell:
        planned = make_plan(loaded, asked, seed=seed, tell=tell)
        if figures is not None:
            from mvp.cell.figures import write_plan_pictures

            tell("drawing figures")
            write_plan_pictures(planned.setting, planned.plan, figures)
    if out is not None:
        text = planned.plan.model_dump_json(by_alias=True, indent=1)
        write_durably(out, text.encode())
    print_plan(planned.plan)
    if as_json:
        print_model(planned.plan)
    return 0 if planned.plan.status == "admissible" else 3
