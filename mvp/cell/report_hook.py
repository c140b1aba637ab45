"""Write the report after a run; a report that fails never spoils the run."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

_LOG = logging.getLogger(__name__)


def write_report_if_possible(folder: Path) -> Path | None:
    """The report's path, or None with the reason in the log."""
    from mvp.cell.report import write_report

    try:
        return write_report(folder)
    except Exception:
        _LOG.exception("the report of %s could not be written", folder)
        return None
