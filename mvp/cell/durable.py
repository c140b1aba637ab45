"""Files that survive a power cut and a full disk: whole, or as they were before."""

from __future__ import annotations

import errno
import os
import shutil
from contextlib import suppress
from typing import TYPE_CHECKING

from mvp.errors import OutputError

if TYPE_CHECKING:
    from io import FileIO
    from pathlib import Path

_FULL = {
    errno.ENOSPC: ("the disk is full", "make room on that disk"),
    errno.EDQUOT: (
        "the quota is used up",
        "remove files of yours on that disk or have the quota raised",
    ),
    errno.EFBIG: (
        "the disk or the limit on file sizes takes no more",
        "make room on that disk and look at `ulimit -f`",
    ),
}


def output_error(path: Path, error: OSError) -> OutputError:
    """What an operating-system error means to the reader."""
    if error.errno in _FULL:
        why, hint = _FULL[error.errno]
        free = _size(_free_bytes(path))
        return OutputError(f"{path}: {why}, {free} free", hint=hint, where=str(path))
    return OutputError(
        f"{path}: {error.strerror or error}",
        hint="check the permissions or write to another folder (--out, --picture)",
        where=str(path),
    )


def _free_bytes(path: Path) -> int:
    """Room on the disk that has, or would have, this path."""
    return shutil.disk_usage(_existing(path)).free


def _existing(path: Path) -> Path:
    """The path, or its nearest ancestor that exists."""
    path = path.absolute()
    while not path.exists() and path != path.parent:
        path = path.parent
    return path


def _size(count: int) -> str:
    return f"{count / 1e6:.0f} MB" if count >= 1e6 else f"{count / 1e3:.0f} kB"


def write_durably(path: Path, content: bytes) -> None:
    """Write a file so that after a crash it is whole or absent.

    Raises:
        OutputError: the folder or disk does not take it.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        with partial.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise output_error(path, error) from error


def append_durably(path: Path, line: str) -> None:
    """Append one line and flush it to disk; nothing of it stays where that fails.

    Raises:
        OutputError: the disk does not take it.
    """
    try:
        new = not path.exists()
        with path.open("ab", buffering=0) as file:
            append_whole(file, line.encode() + b"\n", flush=True)
        if new:
            sync_folder(path.parent)
    except OSError as error:
        raise output_error(path, error) from error


def append_whole(file: FileIO, content: bytes, *, flush: bool = False) -> None:
    """Append all of it, or leave the file as it was.

    Args:
        file: open for appending, without a buffer.
        content: what is appended.
        flush: on disk when this returns.

    Raises:
        OSError: the disk does not take it.
    """
    before = os.fstat(file.fileno()).st_size
    try:
        rest = memoryview(content)
        while rest:
            rest = rest[file.write(rest) :]
        if flush:
            os.fsync(file.fileno())
    except OSError:
        with suppress(OSError):
            file.truncate(before)
        raise


def cut_durably(path: Path, size: int) -> None:
    """Cut a file off behind ``size`` bytes; needs no room.

    Raises:
        OutputError: the file cannot be changed.
    """
    try:
        with path.open("r+b", buffering=0) as file:
            file.truncate(size)
            os.fsync(file.fileno())
    except OSError as error:
        raise output_error(path, error) from error


def sync_folder(folder: Path) -> None:
    """Flush a folder's entries, where the system can (not on Windows)."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.EBADF):
            raise
    finally:
        os.close(handle)


def check_file_writable(path: Path, *, needed_bytes: int) -> None:
    """The same for one file that will be written.

    Raises:
        OutputError: it is a folder, or its folder cannot take it.
    """
    if path.is_dir():
        raise OutputError(
            f"{path}: is a folder, a file is needed",
            hint="name a file",
            where=str(path),
        )
    check_writable(path.parent, needed_bytes=needed_bytes)


def check_writable(folder: Path, *, needed_bytes: int) -> None:
    """Find out before anything moves whether the results can be kept.

    The folder, or its nearest existing ancestor, must be a writable folder with
    enough room. Nothing is left behind.

    Raises:
        OutputError: it is not, or there is not enough room.
    """
    existing = _existing(folder)
    probe = existing / f".mvp-cell-probe-{os.getpid()}"
    try:
        with probe.open("xb", buffering=0) as file:
            append_whole(file, b"\0" * 4096, flush=True)
        free = _free_bytes(existing)
    except OSError as error:
        raise output_error(folder, error) from error
    finally:
        with suppress(OSError):
            probe.unlink(missing_ok=True)
    if free < needed_bytes:
        raise OutputError(
            f"{folder}: {_size(free)} free, but {_size(needed_bytes)} may be needed",
            hint="make room on that disk or name another folder with --out",
            where=str(folder),
        )
