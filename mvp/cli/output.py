"""What the commands print: people read stderr, programs read stdout."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from mvp.errors import MvpCellError, OutputError

if TYPE_CHECKING:
    from pydantic import BaseModel
    from rich.console import Console


def console() -> Console:
    """Where human text goes."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, soft_wrap=True)


def print_model(model: BaseModel) -> None:
    """The one JSON document of a command, on stdout."""
    print_text(model.model_dump_json(by_alias=True, indent=1))


def print_text(text: str) -> None:
    """A finished document on stdout.

    Raises:
        OutputError: nobody takes it.
    """
    try:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()
    except OSError as error:
        # What is left in the buffer would fail once more when the program ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise OutputError(
            f"standard output: {error.strerror or error}",
            hint="make room where it is sent to, or send it elsewhere",
            where="standard output",
        ) from error


def report_error(
    error: MvpCellError,
    *,
    as_json: bool,
    folder: str | None = None,
    told: bool = False,
) -> int:
    """Tell person and program what went wrong; returns the exit code.

    Args:
        error: what went wrong.
        as_json: print the document too.
        folder: of the run that was begun.
        told: the person knows already.
    """
    from mvp.cell.documents import ErrorDocument

    if not told:
        tell_error(error)
    if as_json:
        document = ErrorDocument(
            code=error.exit_code,
            kind=type(error).__name__,
            where=error.where,
            message=error.message,
            hint=error.hint,
            folder=folder,
            may_still_move=error.may_still_move or None,
            stands=error.stands or None,
        )
        # Nobody reads it; the person was told what went wrong in the first place.
        with suppress(OutputError):
            print_model(document)
    return error.exit_code


def tell_error(error: MvpCellError) -> None:
    """What went wrong, what may still be moving, and what to do, for a person."""
    lines = console()
    lines.print(f"error: {error.message}", style="bold red", markup=False)
    tell_rest(stands=error.stands, moving=error.may_still_move)
    if error.hint:
        lines.print(f"hint:  {error.hint}", markup=False)


def tell_rest(*, stands: str, moving: str) -> None:
    """What was seen to stand after a stop, and what was not."""
    lines = console()
    if stands:
        lines.print(f"seen to stand: {stands}", markup=False)
    if moving:
        lines.print(f"may still be moving: {moving}", style="bold red", markup=False)


def tell_warning(message: str, *, hint: str = "") -> None:
    """Something that does not change how the command ends, for a person."""
    lines = console()
    lines.print(f"warning: {message}", style="yellow", markup=False)
    if hint:
        lines.print(f"hint:    {hint}", markup=False)
