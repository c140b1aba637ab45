"""``mvp-cell check CELL``: reach every device, move none."""

from __future__ import annotations

from mvp.cli.options import AcceptOption, CellArgument, JsonOption, TaskOption


def check(
    cell: CellArgument,
    task: TaskOption = None,
    accept_calibration: AcceptOption = "",
    as_json: JsonOption = False,
) -> int:
    """Reach every device, check calibration and limits; all failures at once."""
    from rich.table import Table

    from mvp.cell.check_job import check_cell
    from mvp.cell.loading import load_cell, load_task
    from mvp.cli.output import console, print_model

    loaded = load_cell(cell, accept_calibration=accept_calibration)
    document = check_cell(loaded, load_task(loaded, task))
    table = Table("what", "", "detail")
    for item in document.items:
        mark = "[green]ok[/]" if item.passed else "[red]FAILED[/]"
        detail = f"{item.detail}\n{item.hint}" if item.hint else item.detail
        table.add_row(item.name, mark, detail)
    lines = console()
    lines.print(table)
    lines.print(f"{document.cell}: {'ready' if document.passed else 'NOT ready'}")
    if as_json:
        print_model(document)
    return 0 if document.passed else 4
