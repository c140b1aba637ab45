"""What a driver finds on this computer before anybody opens the device.

A driver class may have, beside what ``DriverClass`` asks for:

- ``libraries``: names of the distributions that it talks through, for ``check``;
- ``usb_ids``: by ``vid:pid``, what it drives behind such a port, for ``devices``;
- ``check_host(config)``: findings about this computer; opens and changes nothing;
- ``find_cameras()``: cameras that answer or are plugged in; takes no control of any.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from mvp.devices.cameras import CameraFound
    from mvp.devices.registry import DriverClass
    from mvp.fileedge import FileModel

Level: TypeAlias = Literal["ok", "warning", "failed"]


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        name: what it is about, in a few words.
        level: a warning lets a run begin.
        detail: what was found.
        hint: what to do about it.
    """

    name: str
    level: Level
    detail: str
    hint: str = ""


def libraries_of(driver: DriverClass) -> tuple[str, ...]:
    """Distributions that the driver talks through."""
    return tuple(cast("Sequence[str]", getattr(driver, "libraries", ())))


def usb_ids_of(driver: DriverClass) -> dict[str, str]:
    """What it drives, by ``vid:pid`` in lower case."""
    return dict(cast("Mapping[str, str]", getattr(driver, "usb_ids", {})))


def host_findings(driver: DriverClass, config: FileModel) -> tuple[Finding, ...]:
    """What the driver has to say about this computer."""
    look = getattr(driver, "check_host", None)
    if look is None:
        return ()
    return tuple(cast("Callable[[FileModel], Sequence[Finding]]", look)(config))


def camera_search(
    driver: DriverClass,
) -> Callable[[], Sequence[CameraFound]] | None:
    """The driver's search for cameras; None when it has none."""
    found = getattr(driver, "find_cameras", None)
    return cast("Callable[[], Sequence[CameraFound]] | None", found)
