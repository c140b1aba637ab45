"""Serial ports of this computer and cameras in reach, without opening any.

Every driver for cameras that can search does so at the same time; a search that takes too
long is given up and told. A port is compared with the USB identities that drivers name.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from pydantic import Field

from mvp.devices import (
    Role,
    camera_search,
    list_drivers,
    list_ports,
    load_driver,
    usb_ids_of,
)
from mvp.errors import MvpCellError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from mvp.devices import CameraFound, DriverClass, PortFound

    Search = Callable[[], Sequence[CameraFound]]

DEVICES_SCHEMA: Literal["mvp-cell/devices/1"] = "mvp-cell/devices/1"
SEARCH_S = 8.0
_VIDEO = Path("/sys/class/video4linux")
_BY_ID = Path("/dev/serial/by-id")
_LOG = logging.getLogger(__name__)


class PluggedIn(FileModel):
    """One device; ``address`` is what a cell file takes.

    Attributes:
        path: device node of a port or a USB camera.
        usb: ``vid:pid`` or ``vid:pid:serial``.
        serial: serial number, where it tells one.
        drivers: keys of the drivers that it is probably for.
        through: how a camera was found.
    """

    kind: Literal["serial", "camera"]
    address: str
    description: str
    path: str = ""
    usb: str = ""
    serial: str = ""
    drivers: list[str] = Field(default_factory=list)
    through: str = ""


class DevicesDocument(FileModel):
    """Everything found, and what could not be searched."""

    schema_: Literal["mvp-cell/devices/1"] = Field(
        default=DEVICES_SCHEMA, alias="schema"
    )
    devices: list[PluggedIn]
    notes: list[str] = Field(default_factory=list)


def plugged_in(*, search_s: float = SEARCH_S) -> DevicesDocument:
    """Ask the operating system and the network; nothing is opened and nothing moves.

    Args:
        search_s: after which a search for cameras is given up.
    """
    drivers, notes = _installed()
    searches = {
        key: search
        for key, driver in drivers.items()
        if (search := camera_search(driver)) is not None
    }
    found, troubles = searched(searches, search_s)
    names = {key: usb_ids_of(driver) for key, driver in drivers.items()}
    ports = [port_entry(port, names) for port in list_ports()]
    cameras = [_camera(one) for one in found]
    known = {str(Path(camera.address).resolve()) for camera in cameras}
    return DevicesDocument(
        devices=[*ports, *cameras, *_other_nodes(known)], notes=[*notes, *troubles]
    )


def _installed() -> tuple[dict[str, DriverClass], list[str]]:
    """Every driver that loads, by key, and why the others do not."""
    roles: dict[str, Role] = {role: role for role in get_args(Role)}
    drivers, notes = {}, []
    for entry in list_drivers():
        if entry.role in roles:
            drivers[entry.key] = load_driver(entry.key, roles[entry.role])
        else:
            notes.append(f"driver {entry.key} does not load: {entry.error}")
    return drivers, notes


def searched(
    searches: Mapping[str, Search], search_s: float
) -> tuple[list[CameraFound], list[str]]:
    """Run every search at once, for so long at most.

    Args:
        searches: by key of the driver.
        search_s: wall time, s.

    Returns:
        Cameras by driver and address, and what went wrong.
    """
    results: queue.SimpleQueue[tuple[str, Sequence[CameraFound], str]]
    results = queue.SimpleQueue()

    def run(key: str, search: Search) -> None:
        try:
            results.put((key, search(), ""))
        except Exception as error:
            _LOG.debug("%s: the search failed", key, exc_info=True)
            text = error.message if isinstance(error, MvpCellError) else repr(error)
            results.put((key, (), text))

    for key, search in searches.items():
        # A search that hangs in a library must not keep the program from ending.
        threading.Thread(target=run, args=(key, search), daemon=True).start()
    found: list[CameraFound] = []
    notes: list[str] = []
    left, until = set(searches), time.monotonic() + search_s
    while left:
        try:
            key, cameras, trouble = results.get(
                timeout=max(0, until - time.monotonic())
            )
        except queue.Empty:
            break
        left.discard(key)
        found += cameras
        notes += [f"the search of driver {key} failed: {trouble}"] if trouble else []
    notes += [
        f"the search of driver {key} took more than {search_s:g} s and was given up"
        for key in sorted(left)
    ]
    return sorted(found, key=lambda one: (one.driver, one.address)), notes


def port_entry(port: PortFound, names: Mapping[str, Mapping[str, str]]) -> PluggedIn:
    """A serial port, and who is probably behind it.

    Args:
        port: as the system knows it.
        names: by key of a driver, what it drives by ``vid:pid``.
    """
    identity = port.usb[:9]
    likely = {
        key: ids[identity] for key, ids in names.items() if identity and identity in ids
    }
    guesses = "; ".join(f"perhaps {what} ({key})" for key, what in likely.items())
    return PluggedIn(
        kind="serial",
        address=str(_BY_ID / port.by_id) if port.by_id else port.path,
        description="; ".join(t for t in (port.description, guesses) if t),
        path=port.path,
        usb=port.usb,
        serial=port.usb[10:],
        drivers=list(likely),
    )


def _camera(found: CameraFound) -> PluggedIn:
    return PluggedIn(
        kind="camera",
        address=found.address,
        description=found.model,
        serial=found.serial,
        drivers=[found.driver],
        through=found.through,
    )


def _other_nodes(known: set[str]) -> list[PluggedIn]:
    """Video nodes that no driver has told, with what the kernel calls them."""
    if not _VIDEO.is_dir():
        return []
    nodes = []
    for entry in sorted(_VIDEO.iterdir()):
        path = f"/dev/{entry.name}"
        if path in known:
            continue
        name = entry / "name"
        text = name.read_text(errors="replace").strip() if name.is_file() else ""
        nodes.append(
            PluggedIn(
                kind="camera",
                address=path,
                description=text,
                path=path,
                through="V4L2; may be a node without pictures",
            )
        )
    return nodes
