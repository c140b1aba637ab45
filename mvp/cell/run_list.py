"""What is kept in a folder of runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.cell.documents import RunSummary
from mvp.cell.run_folder import list_runs
from mvp.errors import RecordError

if TYPE_CHECKING:
    from pathlib import Path


def summaries(parent: Path) -> list[RunSummary]:
    """Every run below a folder; a damaged one is listed as such."""
    found = []
    for folder in list_runs(parent):
        try:
            document = folder.read_document()
        except RecordError:
            found.append(
                RunSummary(
                    run_id=folder.run_id, folder=str(folder.path), status="damaged"
                )
            )
            continue
        found.append(
            RunSummary(
                run_id=folder.run_id,
                folder=str(folder.path),
                status=document.status,
                cell=document.cell,
                task=document.task,
                part_id=document.part_id,
                started_utc=document.started_utc,
                simulated=document.simulated,
                views=len(document.views),
                verified=sum(v.status == "verified" for v in document.views),
            )
        )
    return found
