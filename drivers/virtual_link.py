"""What the simulated devices share: a world to live in, and an identity."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.devices import DeviceInfo
from mvp.errors import ConnectError

if TYPE_CHECKING:
    from drivers.virtual_settings import ArmFaults, CameraFaults, LensFaults


def require_reachable(
    faults: ArmFaults | LensFaults | CameraFaults, name: str, *, look_at: str
) -> None:
    """Raise ``ConnectError`` when the device has been made unreachable."""
    if faults.unreachable:
        raise ConnectError("nobody answers", device=name, hint=look_at)


def identity(name: str, *, driver: str, model: str, serial: str) -> DeviceInfo:
    """Who answers in a virtual world."""
    return DeviceInfo(name, driver, model, serial, firmware="1", simulated=True)
