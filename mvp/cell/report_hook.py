"""Write the report after a run; a report that fails never spoils the run."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.cell.run_job import RunResult

_LOG = logging.getLogger(__name__)


def write_report_if_possible(result: RunResult) -> Path | None:
    """Pictures and report of a run; None, with the reason in the log, if it fails."""
    from mvp.cell.figures import write_plan_pictures
    from mvp.cell.report import write_report

    folder = result.folder
    try:
        write_plan_pictures(result.setting, folder.read_plan(), folder.figures)
        return write_report(folder.path)
    except Exception:
        _LOG.exception("the report of %s could not be written", folder.path)
        return None
