"""What a device is called on this machine, however a cell file addresses it."""

from __future__ import annotations

import socket
from pathlib import Path

from mvp.devices.ports import resolve_port
from mvp.devices.transport import SOCKET
from mvp.errors import ConnectError


def link_resource(address: str, *, device: str) -> str:
    """Name of the port or far end that a link's address means at this moment.

    Args:
        address: as in ``TransportConfig.port``.
        device: name of the device.

    Returns:
        ``serial:`` and the device node, or ``tcp:`` and the endpoint; empty where there
        is no such port, which opening it will tell.
    """
    if address.startswith(SOCKET):
        host, _, port = address.removeprefix(SOCKET).rpartition(":")
        return f"{host_resource('tcp', host)}:{port}"
    try:
        path = Path(resolve_port(address, device=device))
    except ConnectError:
        return ""
    return f"serial:{path.resolve()}" if path.exists() else ""


def host_resource(kind: str, host: str) -> str:
    """``kind:`` and the numeric address of a host; its name where it has none now."""
    try:
        found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return f"{kind}:{host.lower()}"
    return f"{kind}:{found[0][4][0]}"
