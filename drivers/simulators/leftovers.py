"""Temporary folders and lock files, and what dead processes have left of them.

Each is locked as long as its process lives; the operating system lets go of it however
that process dies. Whatever is found unlocked belongs to nobody.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO

_PREFIX = "mvp-cell-simulator-"
_UNFINISHED = ".mvp-cell-simulator-"
_ALIVE = ".alive"


class OwnFolder:
    """A new temporary folder; those of dead processes are removed on the way."""

    def __init__(self) -> None:
        remove_dead_folders()
        new = Path(tempfile.mkdtemp(prefix=_UNFINISHED))
        self._alive = (new / _ALIVE).open("xb")
        lock(self._alive)
        # It gets the name that others look for only now that it is locked.
        self.path = new.with_name(_PREFIX + new.name.removeprefix(_UNFINISHED))
        new.rename(self.path)

    def remove(self) -> None:
        """Take it away; safe to repeat."""
        shutil.rmtree(self.path, ignore_errors=True)
        self._alive.close()


def remove_dead_folders() -> None:
    """Remove the folders of processes that have ended without doing so."""
    for folder in _temporary(f"{_PREFIX}*"):
        with suppress(OSError), (folder / _ALIVE).open("r+b") as alive:
            if lock(alive):
                shutil.rmtree(folder, ignore_errors=True)


def remove_dead_locks(pattern: str) -> None:
    """Remove the lock files of that name which nobody holds."""
    for path in _temporary(pattern):
        with suppress(OSError), path.open("r+b") as file:
            if lock(file) and is_at(path, file):
                path.unlink()


def lock(file: IO[bytes]) -> bool:
    """Lock an open file until it is closed; False when another one holds it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def is_at(path: Path, file: IO[bytes]) -> bool:
    """Whether the open file still has this name: its holder may have removed it."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def _temporary(pattern: str) -> list[Path]:
    return list(Path(tempfile.gettempdir()).glob(pattern))
