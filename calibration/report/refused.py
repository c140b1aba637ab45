"""The report of a calibration that gave no result at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibration.report.model import ReportData
from calibration.verdict import Cause, Verdict

if TYPE_CHECKING:
    from calibration.report.model import About, ReportKind
    from mvp.errors import CalibrationError


def refused_report(
    kind: ReportKind, error: CalibrationError, about: About
) -> ReportData:
    """A page that says why there is nothing to show, and what to do."""
    cause = Cause("no-result", "no-go", error.message, error.hint or "")
    return ReportData(
        kind,
        about,
        "No result: the data allow none.",
        Verdict((cause,)),
        (),
        (),
    )
