"""``mvp-cell devices``: what is plugged into this computer."""

from __future__ import annotations

from mvp.cli.options import JsonOption


def devices(as_json: JsonOption = False) -> int:
    """List serial ports and video devices; nothing is opened."""
    from rich.table import Table

    from mvp.cell.plugged_in import plugged_in
    from mvp.cli.output import console, print_model

    document = plugged_in()
    table = Table("kind", "address", "description")
    for item in document.devices:
        table.add_row(item.kind, item.address, item.description)
    lines = console()
    if document.devices:
        lines.print(table)
    else:
        lines.print("no serial port and no camera found")
    if as_json:
        print_model(document)
    return 0
