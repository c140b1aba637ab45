"""``mvp-cell check CELL``: reach every device, move none."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.cli.options import AcceptOption, CellArgument, JsonOption, TaskOption

if TYPE_CHECKING:
    from mvp.cell.check_items import CheckDocument, CheckItem


def check(
    cell: CellArgument,
    task: TaskOption = None,
    accept_calibration: AcceptOption = "",
    as_json: JsonOption = False,
) -> int:
    """Reach every device, check calibration and limits.

    All failures are told at once; nothing moves.
    """
    from rich.markup import escape
    from rich.table import Table

    from mvp.cell.calibration_items import only_calibrations_failed
    from mvp.cell.check_job import check_cell, load_unjudged
    from mvp.cell.loading import load_task
    from mvp.cli.naming import named
    from mvp.cli.output import console, print_model
    from mvp.cli.progress import phase

    loaded = load_unjudged(cell, accept_calibration=accept_calibration)
    found = check_cell(loaded, load_task(loaded, task), phase)
    items = [
        item.model_copy(update={"hint": named(item.hint, cell)}) for item in found.items
    ]
    document = found.model_copy(update={"items": items})
    table = Table("what", "", "detail")
    for item in document.items:
        detail = f"{item.detail}\n-> {item.hint}" if item.hint else item.detail
        table.add_row(item.name, _mark(item), escape(detail))
    lines = console()
    lines.print(table)
    lines.print(f"{document.cell}: {_verdict(document)}")
    if as_json:
        print_model(document)
    if document.passed:
        return 0
    return 2 if only_calibrations_failed(document) else 4


def _mark(item: CheckItem) -> str:
    if not item.passed:
        return "[red]FAILED[/]"
    return "[yellow]warning[/]" if item.warning else "[green]ok[/]"


def _verdict(document: CheckDocument) -> str:
    if not document.passed:
        failed = sum(not item.passed for item in document.items)
        return f"NOT ready, {failed} of {len(document.items)} checks failed"
    warnings = sum(item.warning for item in document.items)
    if not warnings:
        return "ready"
    return f"ready, but look at {warnings} warning{'s' * (warnings > 1)}"
