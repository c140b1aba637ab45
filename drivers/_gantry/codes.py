"""Alarms and errors of the GRBL family, by number; unknown ones are faults, too."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.errors import DeviceFault, LimitError

if TYPE_CHECKING:
    from drivers._gantry.config import Firmware
    from mvp.errors import DeviceError

_ALARMS = {
    1: "a limit switch was hit; steps are lost",
    2: "a target beyond the soft limits",
    3: "reset while it moved; steps are lost",
    4: "probe failed",
    5: "probe failed",
    6: "homing was interrupted",
    7: "the door was opened during homing",
    8: "homing could not get off a switch",
    9: "homing did not find a switch",
}
# Above 9 the same number means different things.
_FURTHER: dict[str, dict[int, str]] = {
    "grbl": {10: "homing of a double axis failed"},
    "grblhal": {
        10: "emergency stop",
        11: "homing is required first",
        12: "a limit switch is pressed",
        14: "spindle fault",
        15: "homing of a double axis failed",
        16: "self-test failed",
        17: "motor fault",
        18: "homing failed",
        21: "settings could not be stored",
        22: "its buffer overflowed",
    },
    "fluidnc": {
        10: "homing of a double axis failed",
        11: "a control input is active at start",
        12: "a switch is ambiguous",
        13: "hard stop",
        14: "it is not homed",
        15: "initialisation failed",
        17: "a G-code error",
    },
}
_ERRORS = {
    1: "a letter was expected",
    2: "a number was bad",
    3: "an unknown $ command",
    5: "homing is switched off ($22), or that of one axis (its bit 1)",
    7: "its settings could not be read; it runs on defaults",
    8: "it is not idle",
    9: "it is locked, or jogs",
    10: "soft limits need homing",
    11: "the line was too long",
    15: "a jog beyond the travel",
    16: "a bad jog",
    20: "an unsupported code",
    21: "codes that exclude each other",
    22: "no feed rate",
    45: "a limit switch is pressed",
    46: "homing is required first",
    53: "no such setting",
    79: "not allowed until it is reset",
}
_LOSES_HOME = {1, 3, 6, 7, 8, 9}


def loses_home(alarm: int) -> bool:
    """Whether the position is unknown after an alarm; unknown alarms lose it, too."""
    return alarm in _LOSES_HOME or alarm > 9


def alarm_fault(number: int, firmware: Firmware, name: str) -> DeviceFault:
    """What an alarm means, and what to do."""
    known = _ALARMS.get(number) or _FURTHER[firmware].get(number)
    return DeviceFault(
        f"alarm {number}: {known or 'not in the table of this firmware'}",
        device=name,
        code=f"ALARM:{number}",
        hint="look what it touched; `mvp-cell recover CELL` walks the way back, "
        "then home it again",
    )


def line_error(number: int, line: str, name: str) -> DeviceError:
    """What the refusal of a line means."""
    known = _ERRORS.get(number, "not in the table")
    message = f"refused {line!r} with error {number}: {known}"
    if number in (8, 9, 10, 46):
        return LimitError(
            message, device=name, hint="home it, or `mvp-cell recover CELL`"
        )
    return DeviceFault(
        message,
        device=name,
        code=f"error:{number}",
        hint="is the line disturbed, or the firmware another one than configured?",
    )
