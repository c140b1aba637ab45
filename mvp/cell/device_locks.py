"""One process of this machine at a time on one physical device.

The lock of a cell file does not see that a copy of it, or another cell, names the same
robot or port. The operating system holds these locks for the life of the process, so a
killed one leaves none behind; the text in a file only tells people who holds it. All
users of the machine share them.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from mvp.cell.lock import try_lock
from mvp.devices import Exclusive
from mvp.errors import ConnectError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from io import FileIO

    from mvp.devices import Device

_SHARED = (Path("/run/lock"), Path("/tmp"))
_EVERYBODY = 0o666
_TRIES = 5
_TRY_AGAIN_S = 0.02
_LONGEST = 4096


@contextmanager
def devices_held(
    devices: Mapping[str, Device], *, folder: Path | None = None
) -> Iterator[None]:
    """Hold every device that says what it drives; connects to none.

    Args:
        devices: by role.
        folder: where the locks are; None: where every program of this machine looks.

    Raises:
        ConnectError: another process drives one of them, or two of them are the same.
    """
    mine: dict[str, str] = {}
    with ExitStack() as stack:
        for role, device in devices.items():
            name = device.resource() if isinstance(device, Exclusive) else ""
            if not name:
                continue
            if name in mine:
                raise ConnectError(
                    f"{name} is the {mine[name]} already",
                    device=role,
                    hint=f"correct the address in [{role}] or [{mine[name]}]",
                )
            mine[name] = role
            stack.enter_context(_held(name, role, folder or _shared_folder()))
        yield


@contextmanager
def _held(name: str, role: str, folder: Path) -> Iterator[None]:
    """Hold one lock; its file is emptied, not removed: others may own the folder."""
    file = _locked(folder / _file_name(name), name, role)
    try:
        _write(file, json.dumps({"pid": os.getpid(), "what": _program()}).encode())
        yield
    finally:
        _write(file, b"")
        file.close()


def _locked(path: Path, name: str, role: str) -> FileIO:
    who = ""
    for _ in range(_TRIES):
        file = _opened(path, role)
        if try_lock(file):
            return file
        who = _holder(file)
        file.close()
        time.sleep(_TRY_AGAIN_S)
    raise ConnectError(
        f"{name} is driven by {who}",
        device=role,
        hint="wait until it has finished, or stop it; two cell files may name one device",
    )


def _opened(path: Path, role: str) -> FileIO:
    """The lock file, for everybody; never through a link that somebody has laid."""
    flags = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
    try:
        try:
            handle = os.open(path, flags)
        except FileNotFoundError:
            handle = os.open(path, flags | os.O_CREAT, _EVERYBODY)
            if sys.platform != "win32":
                os.fchmod(handle, _EVERYBODY)  # the umask has narrowed it
    except OSError as error:
        raise ConnectError(
            f"{path}: it cannot be seen whether another process drives this device: "
            f"{error.strerror or error}",
            device=role,
            hint="remove that file when nothing uses the device",
        ) from error
    return open(handle, "r+b", buffering=0)


def _write(file: FileIO, content: bytes) -> None:
    """What people read; the lock holds without it."""
    with suppress(OSError):
        file.seek(0)
        file.truncate()
        file.write(content)


def _holder(file: FileIO) -> str:
    """The other process, in words, as far as it has said."""
    try:
        file.seek(0)
        said = json.loads(file.read(_LONGEST))
        return f"process {int(said['pid'])} ({said['what']})"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"


def _program() -> str:
    """What this process is, as its user started it."""
    words = [Path(sys.argv[0]).name if sys.argv else "python", *sys.argv[1:3]]
    return " ".join(words)[:120]


def _file_name(name: str) -> str:
    plain = re.sub(r"[^A-Za-z0-9.]+", "-", name)[:60]
    digest = hashlib.sha256(name.encode()).hexdigest()[:8]
    return f"mvp-cell-{plain}-{digest}.lock"


def _shared_folder() -> Path:
    """The same for every program and user of this machine."""
    for folder in _SHARED:
        if folder.is_dir() and os.access(folder, os.W_OK | os.X_OK):
            return folder
    return Path(tempfile.gettempdir())
