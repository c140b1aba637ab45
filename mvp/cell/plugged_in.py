"""Serial ports and video devices of this computer, without opening any."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from mvp.fileedge import FileModel

DEVICES_SCHEMA: Literal["mvp-cell/devices/1"] = "mvp-cell/devices/1"
_VIDEO = Path("/sys/class/video4linux")


class PluggedIn(FileModel):
    """One device; ``address`` is what a cell file takes."""

    kind: Literal["serial", "camera"]
    address: str
    description: str


class DevicesDocument(FileModel):
    """Everything found."""

    schema_: Literal["mvp-cell/devices/1"] = Field(
        default=DEVICES_SCHEMA, alias="schema"
    )
    devices: list[PluggedIn]


def plugged_in() -> DevicesDocument:
    """Ask the operating system; nothing is opened and nothing moves."""
    return DevicesDocument(devices=[*_serial_ports(), *_cameras()])


def _serial_ports() -> list[PluggedIn]:
    from serial.tools import list_ports

    return [
        PluggedIn(
            kind="serial",
            address=str(port.device),
            description=f"{port.description} (serial number {port.serial_number or '-'})",
        )
        for port in sorted(list_ports.comports(), key=lambda p: str(p.device))
    ]


def _cameras() -> list[PluggedIn]:
    if not _VIDEO.is_dir():
        return []
    found = []
    for entry in sorted(_VIDEO.iterdir()):
        name = entry / "name"
        text = name.read_text(errors="replace").strip() if name.is_file() else ""
        found.append(
            PluggedIn(kind="camera", address=f"/dev/{entry.name}", description=text)
        )
    return found
