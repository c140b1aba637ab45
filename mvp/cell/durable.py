"""Files that survive a power cut: write, flush to disk, then make visible."""

from __future__ import annotations

import errno
import os
import shutil
from contextlib import suppress
from typing import TYPE_CHECKING

from mvp.errors import OutputError

if TYPE_CHECKING:
    from pathlib import Path


def output_error(path: Path, error: OSError) -> OutputError:
    """What an operating-system error means to the reader."""
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    return OutputError(
        f"{path}: {'the disk is full' if full else error.strerror or error}",
        hint="free some space or write to another folder (--out, --picture)"
        if full
        else "check the permissions or write to another folder (--out, --picture)",
        where=str(path),
    )


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
    """Append one line and flush it to disk.

    Raises:
        OutputError: the disk does not take it.
    """
    try:
        new = not path.exists()
        with path.open("ab") as file:
            file.write(line.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        if new:
            sync_folder(path.parent)
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
    existing = folder.absolute()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    probe = existing / f".mvp-cell-probe-{os.getpid()}"
    try:
        with probe.open("xb") as file:
            file.write(b"\0" * 4096)
            file.flush()
            os.fsync(file.fileno())
        free = shutil.disk_usage(existing).free
    except OSError as error:
        raise output_error(folder, error) from error
    finally:
        with suppress(OSError):
            probe.unlink(missing_ok=True)
    if free < needed_bytes:
        raise OutputError(
            f"{folder}: {free / 1e6:.0f} MB free, but the run may need "
            f"{needed_bytes / 1e6:.0f} MB",
            hint="free some space or name another folder with --out",
            where=str(folder),
        )
