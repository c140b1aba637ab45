"""What is kept in a folder of runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mvp.cell.documents import RunSummary
from mvp.cell.records import Captured, RunStarted
from mvp.cell.resume_command import resume_command
from mvp.cell.run_document import RunDocument, run_document
from mvp.cell.run_folder import list_runs
from mvp.errors import RecordError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.records import Record
    from mvp.cell.run_folder import RunFolder

_CAN_GO_ON = ("broken off", "aborted", "fault", "error")


def summaries(parent: Path) -> list[RunSummary]:
    """Every run below a folder; a damaged one is listed as such."""
    return [_summary(folder) for folder in list_runs(parent)]


def _summary(folder: RunFolder) -> RunSummary:
    try:
        document = folder.read_document()
        records = folder.records()
        if document.status == "running":
            document = _now(folder, document, records)
        started = [r for r in records if isinstance(r, RunStarted)]
    except RecordError:
        started = []
    if not started:
        return RunSummary(
            run_id=folder.run_id, folder=str(folder.path), status="damaged"
        )
    status: str = document.status
    if status == "running" and not folder.is_in_progress:
        status = "broken off"
    return RunSummary(
        run_id=folder.run_id,
        folder=str(folder.path),
        status=status,
        cell=document.cell,
        task=document.task,
        part_id=document.part_id,
        started_utc=document.started_utc,
        simulated=document.simulated,
        views=len(document.views),
        captured=len({r.view for r in records if isinstance(r, Captured)}),
        verified=sum(v.status == "verified" for v in document.views),
        resume=_resume(folder, started[-1]) if status in _CAN_GO_ON else "",
    )


def _now(
    folder: RunFolder, document: RunDocument, records: Sequence[Record]
) -> RunDocument:
    """The document as the records stand: its file is written only at start and end."""
    return run_document(
        folder.read_plan(),
        records,
        folder=str(folder.path),
        task=document.task,
        timing_s=document.timing_s,
    )


def _resume(folder: RunFolder, started: RunStarted) -> str:
    if not started.cell_file:
        return ""
    reasons = list(started.accepted_calibration.values())
    return resume_command(
        folder.path,
        Path(started.cell_file),
        accept_calibration=reasons[0] if reasons else "",
    )
