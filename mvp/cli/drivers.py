"""``mvp-cell drivers``: installed plugins."""

from __future__ import annotations

from dataclasses import asdict

from mvp.cli.options import JsonOption


def drivers(as_json: JsonOption = False) -> int:
    """List installed drivers, and why one does not load."""
    from rich.table import Table

    from mvp.cell.documents import DriverItem, DriversDocument
    from mvp.cli.output import console, print_model
    from mvp.devices import list_drivers

    found = list_drivers()
    table = Table("driver", "role", "distribution", "version", "error")
    for entry in found:
        table.add_row(
            entry.key, entry.role, entry.distribution, entry.version, entry.error
        )
    console().print(table)
    if as_json:
        print_model(DriversDocument(drivers=[DriverItem(**asdict(e)) for e in found]))
    return 0
