"""Arms that know where they are only after they have found their references."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np

from mvp.devices import DeclaresAxes, Homable, Homing
from mvp.errors import LimitError
from mvp.kinematics import segment_clearance

if TYPE_CHECKING:
    from mvp.cell.engine import CellDevices
    from mvp.devices import Arm, Device
    from mvp.devices.protocols import ClearWay
    from mvp.kinematics import CellBodies

_LOG = logging.getLogger(__name__)
HOMING_S = 300.0  # the slowest gantries; a driver may know better
_ANYHOW = "The arm drives to its references: nothing may be in its way."


def is_homed(device: Device) -> bool:
    """Whether it is known where a device is; most know it without being homed."""
    return not isinstance(device, Homable) or device.homed


def homing_of(arm: Arm) -> Homing | None:
    """What homing would do now, for the question to a person; None when none is due.

    Raises:
        DeviceError: the arm cannot be asked.
    """
    if is_homed(arm):
        return None
    return arm.homing() if isinstance(arm, DeclaresAxes) else Homing(_ANYHOW)


def home_arm(
    devices: CellDevices, bodies: CellBodies | None = None, clearance_mm: float = 0.0
) -> None:
    """Let the arm find its references, unless it knows where it is. Moves.

    Args:
        devices: opened.
        bodies: what the part of homing that we command ourselves is checked against;
            None: nothing is known, and that part is left out.
        clearance_mm: distance asked between any two bodies.

    Raises:
        DeviceError: it did not; every device has been stopped.
    """
    arm = devices.arm
    if not isinstance(arm, Homable) or arm.homed:
        return
    _LOG.info("%s: homing", arm.name)
    try:
        if isinstance(arm, DeclaresAxes):
            clear = None if bodies is None else clear_way(bodies, clearance_mm)
            arm.home(timeout_s=HOMING_S, clear=clear)
        else:
            arm.home(timeout_s=HOMING_S)
    except BaseException:
        devices.stop()
        raise


def clear_way(bodies: CellBodies, clearance_mm: float) -> ClearWay:
    """Judges one straight motion in joint space, from where the arm is known to be."""

    def clear(start: tuple[float, ...], end: tuple[float, ...]) -> None:
        found = segment_clearance(
            bodies, np.array(start), np.array(end), required_mm=clearance_mm
        )
        if found.certified_mm < clearance_mm:
            raise LimitError(
                f"on the way to its marks {found.nearest.body} would come within "
                f"{found.certified_mm:.1f} mm of {found.nearest.other}; "
                f"{clearance_mm:g} mm are asked, and it was not driven there",
                device="arm",
                hint="make room, or switch the controller off, turn the axes without a "
                "switch to their marks by hand and switch it on again",
            )

    return clear
