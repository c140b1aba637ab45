"""Which serial ports there are, and which one an address means."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from mvp.errors import ConnectError

_BY_ID = Path("/dev/serial/by-id")
_USB = re.compile(r"(?P<vid>[0-9a-fA-F]{4}):(?P<pid>[0-9a-fA-F]{4})(:(?P<serial>.+))?")


@dataclass(frozen=True)
class PortFound:
    """One serial port of this machine.

    Attributes:
        path: device node.
        by_id: name in /dev/serial/by-id; empty when it has none.
        usb: ``vid:pid`` or ``vid:pid:serial``; empty when it is not a USB port.
        description: what the device calls itself.
    """

    path: str
    by_id: str
    usb: str
    description: str

    def __str__(self) -> str:
        return " = ".join(n for n in (self.path, self.by_id, self.usb) if n)


def list_ports() -> tuple[PortFound, ...]:
    """Every serial port that the system knows, sorted by path."""
    from serial.tools.list_ports import comports

    links = _links()
    found = []
    for port in comports():
        usb = "" if port.vid is None else f"{port.vid:04x}:{port.pid:04x}"
        if usb and port.serial_number:
            usb = f"{usb}:{port.serial_number}"
        name = links.get(str(Path(port.device).resolve()), "")
        found.append(PortFound(port.device, name, usb, port.description or ""))
    return tuple(sorted(found, key=lambda port: port.path))


def resolve_port(address: str, *, device: str) -> str:
    """The device node that ``address`` means at this moment.

    Args:
        address: path, name in /dev/serial/by-id, or ``vid:pid[:serial]``.
        device: name of the device, for errors.

    Raises:
        ConnectError: there is no such port, or more than one.
    """
    usb = _USB.fullmatch(address)
    if usb:
        return _by_usb(usb, device)
    path = Path(address)
    if not path.is_absolute() and (_BY_ID / address).exists():
        path = _BY_ID / address
    if path.is_absolute() and not path.exists():
        raise ConnectError(
            f"there is no port {address}", device=device, hint=_what_there_is()
        )
    return str(path)


def holders_of(path: str) -> tuple[str, ...]:
    """Programs that have ``path`` open, as ``name (pid)``; what this user may see."""
    target = str(Path(path).resolve())
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        if _has_open(process, target):
            found.append(f"{_program(process)} ({process.name})")
    return tuple(sorted(found))


def _has_open(process: Path, target: str) -> bool:
    try:
        return any(str(fd.readlink()) == target for fd in (process / "fd").iterdir())
    except OSError:
        return False


def _program(process: Path) -> str:
    try:
        return (process / "comm").read_text().strip()
    except OSError:
        return "unknown"


def _by_usb(wanted: re.Match[str], device: str) -> str:
    """The one port with this USB identity."""
    prefix = f"{wanted['vid']}:{wanted['pid']}".lower()
    serial = wanted["serial"]
    found = [
        port
        for port in list_ports()
        if port.usb[:9] == prefix and (serial is None or port.usb[10:] == serial)
    ]
    if not found:
        raise ConnectError(
            f"no USB device {wanted[0]} is connected",
            device=device,
            hint=_what_there_is(),
        )
    if len(found) > 1:
        raise ConnectError(
            f"{len(found)} USB devices are {wanted[0]}",
            device=device,
            hint=_told_apart(found),
        )
    return found[0].path


def _told_apart(found: list[PortFound]) -> str:
    """How to name one of them; many adapters have no serial number, or all the same."""
    names = "; ".join(map(str, found))
    if len({port.usb for port in found}) == len(found):
        return f"add the serial number: {names}"
    return (
        "these have no serial numbers of their own: name the USB socket, by its link in "
        f"/dev/serial/by-path, and leave it there: {names}"
    )


def _links() -> dict[str, str]:
    """Names in /dev/serial/by-id by device node."""
    if not _BY_ID.is_dir():
        return {}
    return {str(link.resolve()): link.name for link in _BY_ID.iterdir()}


def _what_there_is() -> str:
    ports = list_ports()
    if not ports:
        return (
            "this machine has no serial port; is the cable in, the device switched on?"
        )
    return f"ports of this machine: {'; '.join(map(str, ports))}"
