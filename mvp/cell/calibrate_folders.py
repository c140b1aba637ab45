"""Where sessions and their results are kept beside the cell's calibration files."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from mvp.cell.durable import output_error, write_durably
from mvp.errors import CalibrationError, OutputError, RecordError, UsageError
from mvp.fileedge import read_file

if TYPE_CHECKING:
    from pathlib import Path

RESULT_FILE = "result.json"
REPORT_FILE = "report.html"
_SESSION_FILE = "session.json"


def stamp() -> str:
    """Date and time, UTC, as a part of file names."""
    return datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")


def new_session(calibrations: Path, key: str) -> Path:
    """A name for a session's folder that is free.

    Raises:
        OutputError: none is.
    """
    parent = calibrations / "sessions"
    name = f"{key}-{stamp()}"
    for number in range(1, 100):
        path = parent / (name if number == 1 else f"{name}-{number}")
        if not path.exists():
            return path
    raise OutputError(f"{parent}: no free name for {name}", hint="try again")


def unfinished_session(calibrations: Path, key: str) -> Path:
    """The newest session of a wizard that has no result yet.

    Raises:
        UsageError: there is none.
    """
    parent = calibrations / "sessions"
    found = [
        path
        for path in sorted(parent.glob(f"{key}-*"))
        if (path / _SESSION_FILE).is_file() and not (path / RESULT_FILE).exists()
    ]
    if not found:
        raise UsageError(
            f"{parent}: no session of `calibrate {key}` is waiting to be resumed",
            hint="leave out --resume, or name its folder with --session DIR",
            where=str(parent),
        )
    return found[-1]


def existing_session(folder: Path) -> Path:
    """The folder of ``--session``.

    Raises:
        RecordError: not the folder of a session.
    """
    if not (folder / _SESSION_FILE).is_file():
        raise RecordError(
            f"{folder}: not a calibration session: it has no {_SESSION_FILE}",
            hint="name a folder such as calibration/sessions/camera-20260101T120000Z",
            where=str(folder),
        )
    return folder.resolve()


def put_in_place(target: Path, content: bytes) -> Path | None:
    """Replace a calibration file, and keep the one that was there.

    Returns:
        Where the old one is kept; None when there was none, or it was the same.

    Raises:
        OutputError: the disk does not take it; the old one is still in place.
    """
    kept = None
    if target.exists():
        old = read_file(target, CalibrationError, hint="check its permissions")
        if old == content:
            return None
        kept = _free(target.parent / "previous", target.stem)
        try:
            kept.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise output_error(kept.parent, error) from error
        write_durably(kept, old)
    write_durably(target, content)
    return kept


def _free(folder: Path, stem: str) -> Path:
    name = f"{stem}-{stamp()}"
    path, number = folder / f"{name}.json", 1
    while path.exists():
        number += 1
        path = folder / f"{name}-{number}.json"
    return path
