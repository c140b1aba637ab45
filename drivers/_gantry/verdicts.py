"""What a report means for a motion: may it begin, and has it arrived."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers._gantry.wire import Activity
from mvp.errors import ConnectError, DeviceFault, DeviceTimeout, LimitError

if TYPE_CHECKING:
    from drivers._gantry.wire import Identity, Report


def refuse_held(report: Report, name: str) -> None:
    """Somebody holds it: a button, a door, or another program.

    Raises:
        DeviceFault: it is held.
    """
    if report.activity is Activity.HELD:
        raise DeviceFault(
            f"is held ({report.state})",
            device=name,
            code=report.state,
            hint="`mvp-cell recover CELL` walks the way back",
        )


def require_ready(report: Report, name: str, *, homed: bool) -> None:
    """Motion only from a place that is known, and from standing.

    Raises:
        LimitError: not homed.
        DeviceFault: it moves already, or is locked.
    """
    if not homed:
        raise LimitError(
            "not homed; nothing has moved",
            device=name,
            hint="`mvp-cell home CELL`, with nothing in the way of the axes",
        )
    if report.activity is not Activity.STANDS:
        raise DeviceFault(
            f"cannot move now: {report.state}",
            device=name,
            code=report.state,
            hint="does something else drive it?",
        )


def require_arrived(report: Report, off: str, name: str) -> None:
    """It stands, and where it was sent.

    Args:
        report: after the motion.
        off: which axes stand elsewhere; empty when none does.
        name: of the device.

    Raises:
        DeviceFault: elsewhere: a byte was lost, or the firmware clamped it.
    """
    if report.activity is not Activity.STANDS or off:
        raise DeviceFault(
            f"stands elsewhere ({report.state}): off by {off or 'nothing'}",
            device=name,
            code="position",
            hint="is the line disturbed, or the target beyond the machine's own "
            "end-stops?",
        )


def require_same(identity: Identity, wanted: str, name: str) -> None:
    """Another machine of the same make has other calibrations.

    Raises:
        ConnectError: it says that it is another one.
    """
    if wanted and identity.serial and wanted != identity.serial:
        raise ConnectError(
            f"this is the machine {identity.serial}, not {wanted}",
            device=name,
            hint="connect the other port, or correct serial in [arm]",
        )


def late(name: str, *, rests: bool) -> DeviceTimeout:
    """The error of a motion that took too long, and whether it was seen to stop."""
    did = "it has been stopped" if rests else "it was not seen to stop"
    return DeviceTimeout(
        f"did not arrive in time; {did}",
        device=name,
        hint="is its speed configured too high, or does something block it?"
        if rests
        else "use the emergency stop if it still moves",
    )
