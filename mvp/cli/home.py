"""``mvp-cell home CELL``: lens to its references, arm to its home."""

from __future__ import annotations

from mvp.cli.options import (
    AcceptOption,
    CellArgument,
    JsonOption,
    TaskOption,
    YesOption,
)


def home(
    cell: CellArgument,
    task: TaskOption = None,
    accept_calibration: AcceptOption = "",
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> int:
    """Home arm and lens, drive the arm home on a checked path."""
    from mvp.cell.home_job import home_cell
    from mvp.cell.loading import load_cell, load_task
    from mvp.cli.ask import allow_motion, whose_word
    from mvp.cli.output import console, print_model
    from mvp.cli.progress import phase
    from mvp.cli.tables import tell_believed

    loaded = load_cell(cell, accept_calibration=accept_calibration)
    document = home_cell(
        loaded,
        load_task(loaded, task),
        lambda motion: allow_motion(motion, yes=yes),
        phase,
        word=whose_word(yes=yes),
    )
    steps = ", ".join(f"{k} {v}" for k, v in document.lens_steps.items())
    console().print(f"{document.cell}: arm at home; lens homed ({steps})")
    tell_believed(document.believed_axes)
    if as_json:
        print_model(document)
    return 0
