"""What a device leaves behind in this process: threads, descriptors, children."""

from __future__ import annotations

import gc
import threading
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

_PATIENCE_S = 5.0
_POLL_S = 0.05


@dataclass(frozen=True)
class Belongings:
    """What the process has at a moment."""

    threads: frozenset[threading.Thread]
    descriptors: Counter[str]
    children: frozenset[int]

    @classmethod
    def now(cls) -> Belongings:
        return cls(
            frozenset(threading.enumerate()),
            Counter(kind for kind in map(_kind, _open_files()) if kind),
            frozenset(_children()),
        )

    def left_since(self, before: Belongings) -> str:
        """What is there now and was not then; empty when there is nothing."""
        threads = sorted(t.name for t in self.threads - before.threads)
        descriptors = self.descriptors - before.descriptors
        children = sorted(self.children - before.children)
        parts = [f"thread {name}" for name in threads]
        parts += [f"{n} x {kind}" for kind, n in sorted(descriptors.items())]
        return ", ".join([*parts, *(f"process {pid}" for pid in children)])


def left_behind(before: Belongings) -> str:
    """What is still there after some patience; empty when all is gone."""
    gc.collect()  # an error keeps the frames that it passed, and what is in them
    end_s = time.monotonic() + _PATIENCE_S
    while (left := Belongings.now().left_since(before)) and time.monotonic() < end_s:
        time.sleep(_POLL_S)
    return left


def _open_files() -> list[Path]:
    return list(Path("/proc/self/fd").iterdir())


def _kind(link: Path) -> str:
    """Sort of a descriptor: its file, or socket, pipe and so on without their number."""
    try:
        target = str(link.readlink())
    except OSError:
        return ""  # the one that the folder was listed with
    return target if target.startswith("/") else target.partition(":")[0]


def _children() -> list[int]:
    """Processes started by any thread of this one, without the dead."""
    pids = []
    for task in Path("/proc/self/task").iterdir():
        try:
            pids += [int(p) for p in (task / "children").read_text().split()]
        except OSError:
            continue  # a thread that has just ended
    return [pid for pid in pids if _alive(pid)]


def _alive(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"
