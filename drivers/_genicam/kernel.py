"""What the kernel allows a receiving socket."""

from __future__ import annotations

from pathlib import Path

_RMEM_MAX = Path("/proc/sys/net/core/rmem_max")


def rmem_max() -> int | None:
    """The most that the kernel gives a receiving socket, bytes."""
    try:
        return int(_RMEM_MAX.read_text())
    except (OSError, ValueError):
        return None
