"""One run at a time on one cell.

The operating system holds the lock for the life of the process, so a killed run never
leaves a stale one behind; the text in the file only tells people who holds it.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING

from mvp.cell.durable import output_error
from mvp.errors import RecordError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextmanager
def cell_lock(path: Path, *, run_id: str) -> Iterator[bool]:
    """Hold the lock file; yields True when the last holder died without releasing it.

    Raises:
        RecordError: another process holds it; names process, host and run.
        OutputError: the file cannot be made.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("a+b")
    except OSError as error:
        raise output_error(path, error) from error
    with file:
        if not _acquire(file):
            raise _held(path, _content(file))
        crashed = bool(_content(file))
        holder = {"pid": os.getpid(), "host": socket.gethostname(), "run": run_id}
        try:
            _replace(file, json.dumps(holder).encode())
            yield crashed
        finally:
            _replace(file, b"")


def _content(file: IO[bytes]) -> bytes:
    file.seek(0)
    return file.read()


def _replace(file: IO[bytes], content: bytes) -> None:
    file.seek(0)
    file.truncate()
    file.write(content)
    file.flush()


def _acquire(file: IO[bytes]) -> bool:
    try:
        if sys.platform == "win32":
            import msvcrt

            # A byte far behind the text, so that others can still read who holds it.
            file.seek(1 << 30)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _held(path: Path, content: bytes) -> RecordError:
    try:
        holder = json.loads(content)
        who = f"process {holder['pid']} on {holder['host']} (run {holder['run']})"
    except (ValueError, KeyError, TypeError):
        who = "another process"
    return RecordError(
        f"{path}: {who} is running on this cell",
        hint="wait until it has finished, or stop it",
        where=str(path),
    )
