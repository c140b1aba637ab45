"""Loopback addresses for simulated cameras, one each."""

from __future__ import annotations

import os
import socket
import time
from pathlib import Path
from tempfile import gettempdir
from typing import TYPE_CHECKING

from drivers.simulators.leftovers import is_at, lock, remove_dead_locks

if TYPE_CHECKING:
    from io import BufferedRandom

GVCP_PORT = 3956
BIRTHPLACE = "127.0.0.1"
_LOCKS = "mvp-cell-gige-*.lock"
_POLL_S = 0.05
_LAST = 254


class CameraProblem(Exception):
    """The simulated camera cannot run; the text says why."""


class AddressLock:
    """One simulated camera per address: two would both answer, without an error.

    Args:
        host: IPv4 address of an interface.
        wait_s: how long another one may take to end.
    """

    def __init__(self, host: str, wait_s: float) -> None:
        self._host = host
        self._wait_s = wait_s
        self._path = Path(gettempdir()) / _LOCKS.replace("*", host)
        self._file: BufferedRandom | None = None

    def take(self) -> None:
        """Wait for the address.

        Raises:
            CameraProblem: it is still in use.
        """
        remove_dead_locks(_LOCKS)
        until_s = time.monotonic() + self._wait_s
        while not (self._locked() and self._free()):
            if time.monotonic() > until_s:
                self.release()
                raise CameraProblem(f"another camera answers on {self._host}")
            time.sleep(_POLL_S)

    def release(self) -> None:
        """Let others have it; safe to repeat."""
        file, self._file = self._file, None
        if file is None:
            return
        if is_at(self._path, file):
            self._path.unlink(missing_ok=True)
        file.close()

    def _locked(self) -> bool:
        """Hold the file that has this name now; its last holder has removed its own."""
        if self._file is not None:
            return True
        file = self._path.open("a+b")
        if lock(file) and is_at(self._path, file):
            self._file = file
            return True
        file.close()
        return False

    def _free(self) -> bool:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind((self._host, GVCP_PORT))
            except OSError:
                return False
        return True


def free_address() -> str:
    """A loopback address that no camera has; begins where others hardly do.

    Raises:
        CameraProblem: all are in use.
    """
    first = os.getpid() % (_LAST - 1)
    for step in range(_LAST - 1):
        host = f"127.0.0.{2 + (first + step) % (_LAST - 1)}"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind((host, GVCP_PORT))
            except OSError:
                continue
        return host
    raise CameraProblem("every loopback address has a camera")


def open_sockets() -> frozenset[int]:
    """Descriptors of this process that are sockets."""
    return frozenset(
        int(link.name)
        for link in Path("/proc/self/fd").iterdir()
        if _target(link).startswith("socket:")
    )


def _target(link: Path) -> str:
    try:
        return str(link.readlink())
    except OSError:
        return ""


def move_sockets(descriptors: frozenset[int], host: str) -> None:
    """Exchange sockets that are bound to 127.0.0.1 for sockets on another address.

    The library only knows descriptors: what they lead to may change under it.

    Raises:
        OSError: the port is taken there.
    """
    for descriptor in descriptors:
        with socket.socket(fileno=os.dup(descriptor)) as old:
            place, kind = old.getsockname(), old.type
        if kind != socket.SOCK_DGRAM or not place or place[0] != BIRTHPLACE:
            continue
        port = GVCP_PORT if place[1] == GVCP_PORT else 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as new:
            new.setblocking(False)
            new.bind((host, port))
            os.dup2(new.fileno(), descriptor, inheritable=False)
