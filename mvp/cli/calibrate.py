"""``mvp-cell calibrate KIND CELL``: measure camera, lens, hand-eye or part."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from mvp.cli.options import (
    AcceptOption,
    CellArgument,
    JsonOption,
    SeedOption,
    TaskOption,
    YesOption,
)

if TYPE_CHECKING:
    from mvp.cell.calibrate_document import CalibrateDocument
    from mvp.cell.calibrate_job import CalibrateRequest

AutoOption: TypeAlias = Annotated[
    bool,
    typer.Option("--auto", help="answer every question with its default, unattended"),
]
SessionOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--session",
        metavar="DIR",
        help="compute a stored session once more, without any device",
    ),
]

# A calibration that is about to be measured again need not be good.
_ABOUT_TO_BE_MEASURED = "about to be measured"


def calibrate(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND", help="camera, lens, hand-eye or part; in that order"
        ),
    ],
    cell: CellArgument,
    task: TaskOption = None,
    auto: AutoOption = False,
    session: SessionOption = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="go on with the session that broke off")
    ] = False,
    seed: SeedOption = 0,
    accept_calibration: AcceptOption = "",
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> int:
    """Measure a part of the cell, with a verdict in millimetres.

    The result is put beside the cell file; the one before is kept.
    """
    _one_thread_for_sums()
    from mvp.cell.calibrate_job import CalibrateRequest
    from mvp.cli.output import print_model
    from mvp.cli.wizard_view import print_result
    from mvp.wizard import WizardOptions

    options = WizardOptions(auto=auto)
    request = CalibrateRequest(kind, session, resume, seed, accept_calibration, options)
    if session is not None and not resume:
        document = _recomputed(cell, request, session)
    else:
        document = _live(cell, task, request, auto=auto, yes=yes)
    print_result(document)
    if as_json:
        print_model(document)
    return 5 if document.verdict == "no-go" else 0


def _one_thread_for_sums() -> None:
    """Sums that are shared out to threads change their last digit with how many.

    The linear algebra library reads this when it is loaded.
    """
    if "numpy" not in sys.modules:
        for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ[name] = "1"


def _recomputed(
    cell: str, request: CalibrateRequest, session: Path
) -> CalibrateDocument:
    from mvp.cell.calibrate_result import recompute
    from mvp.cell.loading import read_cell
    from mvp.cli.output import tell_warning

    name = read_cell(cell)[1].name
    document = recompute(request.key, session)
    if document.cell != name:
        tell_warning(f"this session was taken in the cell {document.cell}, not {name}")
    return document


def _live(
    cell: str, task: str | None, request: CalibrateRequest, *, auto: bool, yes: bool
) -> CalibrateDocument:
    from mvp.cell.calibrate_job import calibrate as carry_out
    from mvp.cell.calibrate_job import refuse_bundled
    from mvp.cell.hardware import check_driver_configs
    from mvp.cell.loading import load_cell, load_task, read_cell
    from mvp.cell.plan_job import prepare
    from mvp.cli.wizard_view import TerminalView
    from mvp.wizard import load_wizard

    load_wizard(request.key)
    refuse_bundled(read_cell(cell)[0].path)
    loaded = load_cell(cell, accept_calibration=_ABOUT_TO_BE_MEASURED)
    check_driver_configs(loaded)
    view = TerminalView(simulated=loaded.config.simulated, auto=auto, yes=yes)
    view.refuse_if_nobody_answers()
    setting = prepare(loaded, load_task(loaded, task))
    with view:
        return carry_out(setting, request, view, view.tell)
