"""The result of a run as data: ``mvp-cell/run/1``, also kept as ``run.json``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

from pydantic import ConfigDict, Field

from mvp.cell.records import (
    Captured,
    DeviceRecord,
    Fault,
    InputHashes,
    PartLocated,
    Reached,
    RunFinished,
    RunStarted,
    Stillness,
    Verified,
    ViewSkipped,
)
from mvp.fileedge import FileModel
from mvp.planning.plan import NotCovered

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.records import Record
    from mvp.planning.plan import Plan

RUN_SCHEMA: Literal["mvp-cell/run/1"] = "mvp-cell/run/1"

RunVerdict: TypeAlias = Literal[
    "running", "verified", "failed", "aborted", "fault", "error", "checked"
]
ViewVerdict: TypeAlias = Literal[
    "verified", "failed", "not measurable", "captured", "skipped", "pending", "checked"
]
_VERDICTS: dict[str, ViewVerdict] = {
    "pass": "verified",
    "fail": "failed",
    "not measurable": "not measurable",
}


class VerificationDocument(FileModel):
    """What was measured in one picture; further keys carry the detail."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)

    edges: list[dict[str, object]] = Field(default_factory=list)
    blur: dict[str, object] = Field(default_factory=dict)
    verdict: Literal["pass", "fail", "not measurable"]
    cause: str | None = None


class ViewDocument(FileModel):
    """One view of a run."""

    id: str
    features: list[str]
    status: ViewVerdict
    image: str | None = None
    sha256: str | None = None
    exposure_s: float | None = None
    reached: Reached | None = None
    stillness: Stillness | None = None
    verification: VerificationDocument | None = None


class LocatedDocument(FileModel):
    """Where the part was found before the plan was made, and how far off that was."""

    base_from_part: list[list[float]]
    moved_mm: float
    moved_deg: float
    error_95_mm: float | None
    verdict: str
    lines: list[str]


class RunDocument(FileModel):
    """The whole run. ``folder`` and ``run_id`` are None when nothing was kept.

    ``may_still_move`` is what was under way as the run ended early, ``stands`` what was
    seen to stand a moment later. ``located``: of a run that looked for the part first.
    ``believed_axes``: those that nothing measures, and by whose word they are there.
    """

    schema_: Literal["mvp-cell/run/1"] = Field(default=RUN_SCHEMA, alias="schema")
    run_id: str | None
    folder: str | None
    status: RunVerdict
    cell: str
    task: str
    part_id: str = ""
    simulated: bool
    started_utc: str = ""
    finished_utc: str | None = None
    version: str = ""
    partial: bool = False
    views: list[ViewDocument]
    not_covered: list[NotCovered] = Field(default_factory=list)
    inputs: InputHashes | None = None
    devices: list[DeviceRecord] = Field(default_factory=list)
    accepted_calibration: dict[str, str] = Field(default_factory=dict)
    believed_axes: dict[str, str] = Field(default_factory=dict)
    located: LocatedDocument | None = None
    fault: str | None = None
    may_still_move: str | None = None
    stands: str | None = None
    timing_s: dict[str, float] = Field(default_factory=dict)


def view_documents(plan: Plan, records: Sequence[Record]) -> list[ViewDocument]:
    """The state of every planned view, from the records alone."""
    captured = {r.view: r for r in records if isinstance(r, Captured)}
    verified = {r.view: r for r in records if isinstance(r, Verified)}
    skipped = {r.view for r in records if isinstance(r, ViewSkipped)}
    documents = []
    for view in plan.views:
        if view.id in captured:
            document = _captured_view(
                view.features, captured[view.id], verified.get(view.id)
            )
        else:
            status: ViewVerdict = "skipped" if view.id in skipped else "pending"
            document = ViewDocument(id=view.id, features=view.features, status=status)
        documents.append(document)
    return documents


def _captured_view(
    features: list[str], captured: Captured, verified: Verified | None
) -> ViewDocument:
    verification = None
    if verified is not None:
        verification = VerificationDocument.model_validate(verified.verification)
    return ViewDocument(
        id=captured.view,
        features=features,
        status=_VERDICTS[verified.verdict] if verified is not None else "captured",
        image=captured.image,
        sha256=captured.sha256,
        exposure_s=captured.exposure_s,
        reached=captured.reached,
        stillness=captured.stillness,
        verification=verification,
    )


def _located(record: PartLocated) -> LocatedDocument:
    return LocatedDocument(
        base_from_part=record.base_from_part,
        moved_mm=record.moved_mm,
        moved_deg=record.moved_deg,
        error_95_mm=record.error_95_mm,
        verdict=record.verdict,
        lines=record.lines,
    )


def run_document(
    plan: Plan,
    records: Sequence[Record],
    *,
    folder: str,
    task: str,
    timing_s: dict[str, float],
    stands: str = "",
) -> RunDocument:
    """The document of a run from its plan and records.

    Args:
        plan: what was to be taken.
        records: what happened.
        folder: of the run.
        task: its name.
        timing_s: by stage.
        stands: what was seen to stand after an early end.
    """
    views = view_documents(plan, records)
    starts = [r for r in records if isinstance(r, RunStarted)]
    end = records[-1] if isinstance(records[-1], RunFinished) else None
    located = next((r for r in records if isinstance(r, PartLocated)), None)
    last_start = max(i for i, r in enumerate(records) if isinstance(r, RunStarted))
    faults = [r for r in records[last_start:] if isinstance(r, Fault)]
    return RunDocument(
        run_id=starts[0].run_id,
        folder=folder,
        status=_verdict(views, end),
        cell=plan.cell.name,
        task=task,
        part_id=starts[0].part_id,
        simulated=starts[0].simulated,
        started_utc=starts[0].t_utc,
        finished_utc=None if end is None else end.t_utc,
        version=starts[-1].version,
        partial=plan.status == "partial",
        views=views,
        not_covered=plan.not_covered,
        inputs=starts[0].inputs,
        located=None if located is None else _located(located),
        devices=starts[-1].devices,
        accepted_calibration=starts[-1].accepted_calibration,
        believed_axes=starts[-1].believed_axes,
        fault=faults[-1].message if faults else None,
        may_still_move=(faults[-1].may_still_move or None) if faults else None,
        stands=stands or None,
        timing_s=timing_s,
    )


def _verdict(views: list[ViewDocument], end: RunFinished | None) -> RunVerdict:
    if end is None:
        return "running"
    if end.reason == "completed":
        passed = all(view.status == "verified" for view in views)
        return "verified" if passed else "failed"
    return end.reason


EXIT_CODES: dict[RunVerdict, int] = {
    "verified": 0,
    "checked": 0,
    "failed": 5,
    "aborted": 6,
    "fault": 4,
    "error": 1,
    "running": 1,
}
