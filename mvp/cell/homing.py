"""Arms that know where they are only after they have found their references."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from mvp.devices import Homable

if TYPE_CHECKING:
    from mvp.cell.engine import CellDevices
    from mvp.devices import Device

_LOG = logging.getLogger(__name__)
_HOMING_S = 300.0  # the slowest gantries; a driver may know better


def is_homed(device: Device) -> bool:
    """Whether it is known where a device is; most know it without being homed."""
    return not isinstance(device, Homable) or device.homed


def home_arm(devices: CellDevices) -> None:
    """Let the arm find its references, unless it knows where it is. Moves.

    Raises:
        DeviceError: it did not; every device has been stopped.
    """
    arm = devices.arm
    if not isinstance(arm, Homable) or arm.homed:
        return
    _LOG.info("%s: homing", arm.name)
    try:
        arm.home(timeout_s=_HOMING_S)
    except BaseException:
        devices.stop()
        raise
