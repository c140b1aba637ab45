"""Whether a serial port can be used by this person on this computer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from mvp.devices.findings import Finding
from mvp.devices.ports import holders_of, resolve_port
from mvp.errors import ConnectError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.devices.transport import TransportConfig

_PROBERS = {
    "ModemManager": "sends AT commands to new ports for about ten seconds",
    "brltty": "takes ports with common USB serial chips for Braille displays",
}


def port_findings(config: TransportConfig) -> tuple[Finding, ...]:
    """Rights, other users, and services that meddle; opens nothing."""
    if "://" in config.port:
        return ()
    try:
        path = resolve_port(config.port, device="port")
    except ConnectError:
        return ()  # opening tells it, with the ports that there are
    return (_rights(path), *_others(path), *_meddlers(path))


def _rights(path: str) -> Finding:
    if os.access(path, os.R_OK | os.W_OK):
        return Finding("port", "ok", f"{path} may be used")
    group = Path(path).group()
    return Finding(
        "port",
        "failed",
        f"this user may not use {path}",
        f"`sudo usermod -aG {group} $USER`, then log in again",
    )


def _others(path: str) -> Iterator[Finding]:
    holders = [one for one in holders_of(path) if f"({os.getpid()})" not in one]
    if holders:
        yield Finding(
            "port in use",
            "failed",
            f"{path} is open in {', '.join(holders)}",
            "end that program; two of them on one port mix up each other's answers",
        )


def _meddlers(path: str) -> Iterator[Finding]:
    """Services that talk to USB ports unasked; pseudo-terminals are spared."""
    if path.startswith("/dev/pts/"):
        return
    running = _programs()
    for name, what in _PROBERS.items():
        if name in running:
            yield Finding(
                name,
                "warning",
                f"{name} runs on this computer and {what}",
                f"stop it (`sudo systemctl disable --now {name}`), or give the port a "
                'udev rule with ENV{ID_MM_DEVICE_IGNORE}="1"',
            )


def _programs() -> set[str]:
    found = set()
    for process in Path("/proc").glob("[0-9]*/comm"):
        try:
            found.add(process.read_text().strip())
        except OSError:
            continue
    return found
