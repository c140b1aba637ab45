"""What the commands print: people read stderr, programs read stdout."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from mvp.errors import MvpCellError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from pydantic import BaseModel
    from rich.console import Console

ERROR_SCHEMA: Literal["mvp-cell/error/1"] = "mvp-cell/error/1"


class ErrorDocument(FileModel):
    """The one document on stdout when a command with ``--json`` fails.

    ``code`` is the exit code, ``kind`` the name of the error, ``where`` the file (with
    line), device or feature, ``folder`` the run folder when one was begun.
    """

    schema_: Literal["mvp-cell/error/1"] = Field(default=ERROR_SCHEMA, alias="schema")
    code: int
    kind: str
    where: str
    message: str
    hint: str
    folder: str | None = None
    may_still_move: str | None = None


def console() -> Console:
    """Where human text goes."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, soft_wrap=True)


def print_model(model: BaseModel) -> None:
    """The one JSON document of a command, on stdout."""
    print_text(model.model_dump_json(by_alias=True, indent=1))


def print_document(document: dict[str, object]) -> None:
    """The one JSON document of a command, on stdout."""
    print_text(json.dumps(document, indent=1, allow_nan=False))


def print_text(text: str) -> None:
    """A finished document on stdout."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def report_error(
    error: MvpCellError,
    *,
    as_json: bool,
    folder: str | None = None,
    moving: str | None = None,
) -> int:
    """Tell person and program what went wrong; returns the exit code."""
    lines = console()
    lines.print(f"error: {error.message}", style="bold red", markup=False)
    if error.hint:
        lines.print(f"hint:  {error.hint}", markup=False)
    if moving:
        lines.print(f"may still be moving: {moving}", style="bold red", markup=False)
    if as_json:
        print_model(
            ErrorDocument(
                code=error.exit_code,
                kind=type(error).__name__,
                where=error.where,
                message=error.message,
                hint=error.hint,
                folder=folder,
                may_still_move=moving,
            )
        )
    return error.exit_code
