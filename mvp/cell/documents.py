"""The smaller JSON documents of the command line, as models with a schema."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mvp.fileedge import FileModel


class ErrorDocument(FileModel):
    """The one document on stdout when a command with ``--json`` fails.

    ``code`` is the exit code, ``kind`` the name of the error, ``where`` the file (with
    line), device or feature, ``folder`` the run folder when one was begun. ``stands`` was
    seen to stand after everything had been told to stop; ``may_still_move`` was not.
    """

    schema_: Literal["mvp-cell/error/1"] = Field(
        default="mvp-cell/error/1", alias="schema"
    )
    code: int
    kind: str
    where: str
    message: str
    hint: str
    folder: str | None = None
    may_still_move: str | None = None
    stands: str | None = None


class DriverItem(FileModel):
    """One installed driver; ``error`` says why it does not load."""

    key: str
    role: str
    distribution: str
    version: str
    target: str
    error: str = ""


class DriversDocument(FileModel):
    """``mvp-cell drivers --json``."""

    schema_: Literal["mvp-cell/drivers/1"] = Field(
        default="mvp-cell/drivers/1", alias="schema"
    )
    drivers: list[DriverItem]


class RunSummary(FileModel):
    """One line of ``mvp-cell runs``.

    ``status`` is that of the run, or "broken off" when its process died, or "damaged".
    ``resume`` is the command that goes on with it, empty when there is nothing to do.
    """

    run_id: str
    folder: str
    status: str
    cell: str = ""
    task: str = ""
    part_id: str = ""
    started_utc: str = ""
    simulated: bool = False
    views: int = 0
    captured: int = 0
    verified: int = 0
    resume: str = ""


class RunsDocument(FileModel):
    """``mvp-cell runs --json``."""

    schema_: Literal["mvp-cell/runs/1"] = Field(
        default="mvp-cell/runs/1", alias="schema"
    )
    runs: list[RunSummary]


class ReportDocument(FileModel):
    """``mvp-cell report --json``."""

    schema_: Literal["mvp-cell/report/1"] = Field(
        default="mvp-cell/report/1", alias="schema"
    )
    run_id: str
    file: str


class InitDocument(FileModel):
    """``mvp-cell init --json``."""

    schema_: Literal["mvp-cell/init/1"] = Field(
        default="mvp-cell/init/1", alias="schema"
    )
    folder: str
    files: list[str]


class TargetDocument(FileModel):
    """``mvp-cell target --json``.

    ``page_mm`` and ``target_mm``: width and height. ``ruler_mm``: between the end ticks of
    the ruler below the target.
    """

    schema_: Literal["mvp-cell/target/1"] = Field(
        default="mvp-cell/target/1", alias="schema"
    )
    file: str
    title: str
    paper: str
    page_mm: tuple[float, float]
    target_mm: tuple[float, float]
    ruler_mm: float
