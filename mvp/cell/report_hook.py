"""Write the report after a run; a report that fails never spoils the run."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from mvp.cell.logs import log_to
from mvp.errors import MvpCellError

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.cell.session import RunResult

_LOG = logging.getLogger(__name__)


def write_report_if_possible(result: RunResult) -> Path | Exception:
    """Pictures and report of a run, or why there is none."""
    from mvp.cell.figures import write_plan_pictures
    from mvp.cell.report import write_report

    folder = result.folder
    try:
        write_plan_pictures(result.setting, folder.read_plan(), folder.figures)
        return write_report(folder.path)
    except Exception as error:
        with log_to(folder.log_file, folder.run_id):
            _LOG.error(
                "the report could not be written: %s: %s",
                type(error).__name__,
                error,
                exc_info=None if isinstance(error, MvpCellError) else error,
            )
        return error
