"""One command at a time on the devices of one cell.

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


def lock_file(cell_file: Path) -> Path:
    """Where the lock of a real cell is.

    Beside its ``cell.toml``; where that folder is bundled or cannot be written, in a
    private folder of the user for temporary files.

    Raises:
        OutputError: the private folder is not the user's own.
    """
    cell_file = cell_file.resolve()
    folder = cell_file.parent
    bundled = folder.is_relative_to(bundled_root().resolve())
    if not bundled and os.access(folder, os.W_OK):
        return folder / _LOCK_NAME
    return private_file(cell_file, ".lock")


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


@contextmanager
def holding(path: Path, *, what: str) -> Iterator[None]:
    """Hold a file that exists, and leave its content alone.

    Raises:
        RecordError: another process holds it.
        OutputError: the file cannot be opened.
    """
    try:
        file = path.open("r+b", buffering=0)
    except OSError as error:
        raise output_error(path, error) from error
    with file:
        if not _lock_patiently(file):
            raise RecordError(
                f"{what} is going on in another process",
                hint="wait until it has finished, or stop it",
                where=str(path),
            )
        yield


def _lock_patiently(file: FileIO) -> bool:
    """Somebody may only be looking whether it is held."""
    for _ in range(_TRIES):
        if try_lock(file):
            return True
        time.sleep(_TRY_AGAIN_S)
    return False


def remove_dead() -> None:
    """Remove what dead processes have left in the private folder: locks, announcements.

    Raises:
        OutputError: that folder is not the user's own.
    """
    for path in private_folder().glob(".*.lock"):
        with suppress(OSError), path.open("r+b", buffering=0) as file:
            if try_lock(file) and _is_at(path, file):
                path.with_suffix(".json").unlink(missing_ok=True)
                path.unlink()


def _say_who(path: Path, file: FileIO, holder: dict[str, object]) -> None:
    try:
        _replace(file, json.dumps(holder).encode())
    except OSError as error:
        raise output_error(path, error) from error


def held_by(path: Path) -> str | None:
    """The run that holds a lock now; empty when it does not say, None when nobody."""
    content = _held_content(path)
    return None if content is None else str(_holder(content).get("run", ""))


def refuse_held(path: Path) -> None:
    """Look whether somebody holds a lock, without taking it.

    Raises:
        RecordError: another process holds it; names process, host and run.
    """
    content = _held_content(path)
    if content is not None:
        raise _held(path, content)


def _held_content(path: Path) -> bytes | None:
    """What a held lock file says; None when nobody holds it."""
    try:
        file = path.open("r+b", buffering=0)
    except OSError:
        return None
    with file:
        return None if try_lock(file) else _content(file)


def _locked(path: Path) -> FileIO:
    """The open file, locked, and still the one that has this name."""
    content = b""
    for _ in range(_TRIES):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = path.open("a+b", buffering=0)
        except OSError as error:
            raise output_error(path, error) from error
        if try_lock(file):
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


def try_lock(file: FileIO) -> bool:
    """Lock an open file until it is closed; False when another one holds it."""
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
        who = f"process {holder['pid']} on {holder['host']} ({holder['run']})"
    return RecordError(
        f"{who} is running on this cell",
        hint="wait until it has finished, or stop it",
        where=str(path),
    )
