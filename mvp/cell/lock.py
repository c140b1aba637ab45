"""One run at a time on one cell.

The operating system holds the lock for the life of the process, so a killed run never
leaves a stale one behind; the text in the file only tells people who holds it. The file
is removed by whoever holds it, so that nothing is left after a run.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from mvp.cell.durable import append_whole, output_error
from mvp.cell.places import bundled_root
from mvp.errors import OutputError, RecordError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from io import FileIO

_LOCK_NAME = ".mvp-cell.lock"
_TRIES = 5
_TRY_AGAIN_S = 0.02


def lock_file(cell_file: Path, out: Path, *, simulated: bool) -> Path:
    """Where the lock of a cell is.

    A real cell has one lock, beside its ``cell.toml``; where that folder is bundled or
    cannot be written, in a private folder of the user for temporary files. A simulated
    world lives in one process and cannot be disturbed by another one: its lock, in the
    folder of the results, protects those alone.

    Args:
        cell_file: the ``cell.toml``.
        out: parent of the run's folder.
        simulated: the cell is simulated.

    Raises:
        OutputError: the private folder is not the user's own.
    """
    cell_file = cell_file.resolve()
    name = f".{hashlib.sha256(os.fsencode(cell_file)).hexdigest()[:16]}.lock"
    if simulated:
        return out / name
    folder = cell_file.parent
    bundled = folder.is_relative_to(bundled_root().resolve())
    if not bundled and os.access(folder, os.W_OK):
        return folder / _LOCK_NAME
    return private_folder() / name


def private_file(cell_file: Path, suffix: str) -> Path:
    """A file about a cell in the user's private folder for temporary files.

    Raises:
        OutputError: that folder is not the user's own.
    """
    name = hashlib.sha256(os.fsencode(cell_file.resolve())).hexdigest()[:16]
    return private_folder() / f".{name}{suffix}"


def private_folder() -> Path:
    """Of this user, among the temporary files: locks, announcements, dumps.

    Raises:
        OutputError: that folder is not the user's own.
    """
    user = os.getuid() if sys.platform != "win32" else os.getlogin()
    folder = Path(tempfile.gettempdir()) / f"mvp-cell-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError as error:
        raise output_error(folder, error) from error
    if sys.platform != "win32" and (
        status.st_uid != user or status.st_mode & 0o077 or not folder.is_dir()
    ):
        raise OutputError(
            f"{folder}: not a private folder of yours, so it cannot hold the cell's lock",
            hint="remove it, or set TMPDIR to a folder of your own",
            where=str(folder),
        )
    return folder


@contextmanager
def cell_lock(path: Path, *, run_id: str) -> Iterator[bool]:
    """Hold the lock file; yields True when the last holder died without releasing it.

    Raises:
        RecordError: another process holds it; names process, host and run.
        OutputError: the file cannot be made.
    """
    with _locked(path) as file:
        crashed = bool(_content(file))
        holder = {"pid": os.getpid(), "host": socket.gethostname(), "run": run_id}
        try:
            _say_who(path, file, holder)
            yield crashed
        finally:
            _release(path, file)


def _say_who(path: Path, file: FileIO, holder: dict[str, object]) -> None:
    try:
        _replace(file, json.dumps(holder).encode())
    except OSError as error:
        raise output_error(path, error) from error


def held_by(path: Path) -> str | None:
    """The run that holds a lock now; empty when it does not say, None when nobody."""
    try:
        file = path.open("r+b", buffering=0)
    except OSError:
        return None
    with file:
        if _acquire(file):
            return None
        return str(_holder(_content(file)).get("run", ""))


def _locked(path: Path) -> FileIO:
    """The open file, locked, and still the one that has this name."""
    content = b""
    for _ in range(_TRIES):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = path.open("a+b", buffering=0)
        except OSError as error:
            raise output_error(path, error) from error
        if _acquire(file):
            if _is_at(path, file):
                return file
            file.close()  # its last holder has removed it meanwhile
            continue
        content = _content(file)
        file.close()
        # Somebody may only be looking who holds it.
        time.sleep(_TRY_AGAIN_S)
    raise _held(path, content)


def _is_at(path: Path, file: FileIO) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def _release(path: Path, file: FileIO) -> None:
    """Remove the file while it is held, so that nobody else can be holding it."""
    _replace(file, b"")
    if sys.platform != "win32" and _is_at(path, file):
        with suppress(OSError):
            path.unlink()


def _content(file: FileIO) -> bytes:
    file.seek(0)
    return file.read()


def _replace(file: FileIO, content: bytes) -> None:
    file.seek(0)
    file.truncate()
    append_whole(file, content)


def _acquire(file: FileIO) -> bool:
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


def _holder(content: bytes) -> dict[str, object]:
    try:
        holder = json.loads(content)
    except ValueError:
        return {}
    return holder if isinstance(holder, dict) else {}


def _held(path: Path, content: bytes) -> RecordError:
    holder = _holder(content)
    who = "another process"
    if {"pid", "host", "run"} <= holder.keys():
        who = f"process {holder['pid']} on {holder['host']} (run {holder['run']})"
    return RecordError(
        f"{path}: {who} is running on this cell",
        hint="wait until it has finished, or stop it",
        where=str(path),
    )
