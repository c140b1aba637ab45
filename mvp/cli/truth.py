"""``mvp-cell truth CELL``: how far calibrations of a simulated cell are from the truth."""

from __future__ import annotations

from mvp.cli.options import CellArgument, JsonOption


def truth(cell: CellArgument, as_json: JsonOption = False) -> int:
    """Compare a simulated cell's calibrations with the truth."""
    from mvp.cell.check_job import load_unjudged
    from mvp.cell.truth_compared import told, truth_document
    from mvp.cli.output import console, print_model

    document = truth_document(load_unjudged(cell))
    for line in told(document.values):
        console().print(line, markup=False, highlight=False)
    if as_json:
        print_model(document)
    return 0
