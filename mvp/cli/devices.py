"""``mvp-cell devices``: what is plugged into this computer, and cameras in reach."""

from __future__ import annotations

from mvp.cli.options import JsonOption


def devices(as_json: JsonOption = False) -> int:
    """List serial ports and cameras in reach; opens none.

    Says what to write into a cell file for each.
    """
    from rich.markup import escape
    from rich.table import Table

    from mvp.cell.plugged_in import SEARCH_S, plugged_in
    from mvp.cli.output import console, print_model

    lines = console()
    lines.print(f"looking at ports and for cameras, {SEARCH_S:g} s at most")
    document = plugged_in()
    table = Table("kind", "address", "USB, serial number", "driver", "description")
    for item in document.devices:
        table.add_row(
            item.kind,
            escape(item.address),
            escape(item.usb or item.serial),
            ", ".join(item.drivers),
            escape("; ".join(t for t in (item.description, item.through) if t)),
        )
    if document.devices:
        lines.print(table)
    else:
        lines.print("no serial port and no camera found")
    for note in document.notes:
        lines.print(f"note: {escape(note)}")
    if as_json:
        print_model(document)
    return 0
