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


def buffer_warning(payload_bytes: int, wanted_bytes: int) -> str:
    """What to tell a person whose kernel keeps less than two pictures; else empty."""
    limit = rmem_max()
    if limit is None or limit >= 2 * payload_bytes:
        return ""
    return (
        f"net.core.rmem_max is {limit} bytes, less than two frames of {payload_bytes}: "
        f"frames may be lost; `sysctl -w net.core.rmem_max={wanted_bytes}` raises it"
    )
