"""What the controller's numbers and sentences mean, and what a person can do about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvp.errors import ConnectError, DeviceError, DeviceFault

if TYPE_CHECKING:
    from drivers._ur.status import Status

ROBOT_MODES = {
    -1: "NO_CONTROLLER",
    0: "DISCONNECTED",
    1: "CONFIRM_SAFETY",
    2: "BOOTING",
    3: "POWER_OFF",
    4: "POWER_ON",
    5: "IDLE",
    6: "BACKDRIVE",
    7: "RUNNING",
    8: "UPDATING_FIRMWARE",
}
SAFETY_MODES = {
    1: "NORMAL",
    2: "REDUCED",
    3: "PROTECTIVE_STOP",
    4: "RECOVERY",
    5: "SAFEGUARD_STOP",
    6: "SYSTEM_EMERGENCY_STOP",
    7: "ROBOT_EMERGENCY_STOP",
    8: "VIOLATION",
    9: "FAULT",
    10: "VALIDATE_JOINT_ID",
    11: "UNDEFINED_SAFETY_MODE",
    12: "AUTOMATIC_MODE_SAFEGUARD_STOP",
    13: "SYSTEM_THREE_POSITION_ENABLING_STOP",
}
RUNNING = 7
PLAYING = 2
STOPPED = 1
_SAFE = (1, 2)
_RECOVER = "then `mvp-cell recover CELL` leads the way back"


@dataclass(frozen=True)
class Trouble:
    """Why the robot does not do what is asked.

    Attributes:
        code: short and stable, for programs.
        message: what is the matter.
        hint: what a person can do.
    """

    code: str
    message: str
    hint: str

    def fault(self, device: str) -> DeviceFault:
        """As the error to raise."""
        return DeviceFault(self.message, device=device, code=self.code, hint=self.hint)


def _table(*rows: tuple[str, str, str]) -> dict[str, Trouble]:
    return {row[0]: Trouble(*row) for row in rows}


TROUBLES = _table(
    (
        "protective-stop",
        "protective stop: the robot met something, or was about to",
        f"look what it touched and free it; {_RECOVER}",
    ),
    (
        "safeguard-stop",
        "safeguard stop: a guard is open",
        f"close the guard and reset it; {_RECOVER}",
    ),
    (
        "emergency-stop",
        "emergency stop",
        f"remove the cause and release the button; {_RECOVER}",
    ),
    (
        "enabling-device",
        "stopped by the three-position enabling device",
        f"switch to automatic mode or hold the enabling device; {_RECOVER}",
    ),
    (
        "safety-violation",
        "safety violation: a limit of the safety configuration was passed",
        f"look at the pendant's log; {_RECOVER}",
    ),
    (
        "safety-fault",
        "fault of the safety system",
        f"look at the pendant's log; restart the controller if it stays; {_RECOVER}",
    ),
    (
        "recovery-mode",
        "recovery mode: the arm stands outside its safety limits",
        f"move it back inside by hand, with the pendant; {_RECOVER}",
    ),
    (
        "not-powered",
        "the arm is not powered",
        "`mvp-cell recover CELL` powers it on, step by step",
    ),
    (
        "brakes-on",
        "the arm is powered, but its brakes are on",
        "`mvp-cell recover CELL` releases them, step by step",
    ),
    (
        "booting",
        "the controller is still starting",
        "wait until the pendant shows the robot, then try again",
    ),
    (
        "wrong-mode",
        "the robot is in a mode in which no program can move it",
        f"leave that mode on the pendant; {_RECOVER}",
    ),
    (
        "local-mode",
        "the robot is in local mode: programs from outside are refused",
        "switch the pendant to Remote Control (or enable it in its settings)",
    ),
    (
        "foreign-program",
        "another program is loaded and running or paused on the robot",
        "let it end or stop it on the pendant, or with `mvp-cell recover CELL`",
    ),
    (
        "program-stopped",
        "the control program on the robot has ended",
        "`mvp-cell recover CELL` loads it again; was it stopped on the pendant?",
    ),
    (
        "registers-in-use",
        "the RTDE input registers are in use by somebody else",
        "disable EtherNet/IP, PROFINET and MODBUS on the robot (they reserve the "
        "registers even with nothing connected), end other RTDE clients, or set "
        "no_ext_ft or upper_registers in [arm]",
    ),
    (
        "speed-slider-zero",
        "the speed slider stands at zero: no motion would ever end",
        "raise the speed slider on the pendant",
    ),
    (
        "script-rejected",
        "the robot did not start the control program",
        "is it in remote control, running and free of messages on the pendant? "
        "`mvp-cell recover CELL` checks one after the other",
    ),
    (
        "version",
        "this controller software cannot be driven",
        "update PolyScope X to 10.10 or newer",
    ),
    (
        "upper-registers",
        "upper_registers does not work with this controller software",
        "remove upper_registers from [arm]; from 5.23 on the control program needs "
        "both ranges",
    ),
    (
        "wrong-robot",
        "another robot answers than the one in the cell file",
        "check host, model and serial in [arm]",
    ),
    (
        "tool-differs",
        "the controller did not take tool or payload as configured",
        "is the payload within the robot's range? Check tcp_mm, payload_kg and "
        "payload_cog_mm in [arm]",
    ),
    (
        "tool-changed",
        "somebody changed the tool on the robot since it was connected; nothing was moved",
        "change it back on the pendant, or begin again: connecting sets tool and payload "
        "as [arm] says",
    ),
    (
        "refused",
        "the robot did not accept the motion; nothing was moved",
        "look at the pendant's log",
    ),
    (
        "not-arrived",
        "the motion ended away from its target",
        "was the program stopped, or does the arm push against something?",
    ),
    (
        "not-standing",
        "the arm was told to stop and still moves",
        "stop it on the pendant or with the emergency stop",
    ),
    (
        "still-there",
        "the step did not have its effect in time",
        "look at the pendant; it says what it waits for",
    ),
)

_BY_SAFETY = {
    3: "protective-stop",
    4: "recovery-mode",
    5: "safeguard-stop",
    6: "emergency-stop",
    7: "emergency-stop",
    8: "safety-violation",
    9: "safety-fault",
    12: "safeguard-stop",
    13: "enabling-device",
}
_BY_SAFETY_BIT = (
    (0x0E0, "emergency-stop"),
    (0x004, "protective-stop"),
    (0x010, "safeguard-stop"),
    (0x100, "safety-violation"),
    (0x200, "safety-fault"),
    (0x008, "recovery-mode"),
    (0x800, "enabling-device"),
)
_BY_ROBOT = {
    -1: "booting",
    0: "booting",
    1: "wrong-mode",
    2: "booting",
    3: "not-powered",
    4: "brakes-on",
    5: "brakes-on",
    6: "wrong-mode",
    8: "booting",
}
_BY_SENTENCE = (
    ("already in use", "registers-in-use"),
    ("remote control", "local-mode"),
    ("failed to start control script", "script-rejected"),
)


def trouble(code: str, detail: str = "") -> Trouble:
    """The row of the table, with what was seen in brackets."""
    row = TROUBLES[code]
    said = f"{row.message} ({detail})" if detail else row.message
    return Trouble(code, said, row.hint)


def unended(found: Trouble) -> Trouble:
    """The same, where the interrupted program could not be ended from here."""
    return Trouble(
        found.code,
        f"{found.message}; its program could not be ended from here and may go on with "
        "the motion as soon as it can",
        f"stop the program on the pendant before anything else; {found.hint}",
    )


def safety_trouble(mode: int, bits: int = 0) -> Trouble | None:
    """What the safety system holds against motion; None when nothing."""
    for mask, code in _BY_SAFETY_BIT:
        if bits & mask:
            return trouble(code)
    if mode in _SAFE:
        return None
    if mode in _BY_SAFETY:
        return trouble(_BY_SAFETY[mode])
    name = SAFETY_MODES.get(mode, "unknown")
    return trouble("safety-fault", f"safety mode {mode} {name}")


def mode_trouble(mode: int) -> Trouble | None:
    """What the robot mode holds against motion; None when it is RUNNING."""
    if mode == RUNNING:
        return None
    name = ROBOT_MODES.get(mode, "unknown")
    return trouble(_BY_ROBOT.get(mode, "wrong-mode"), f"robot mode {mode} {name}")


def robot_trouble(status: Status) -> Trouble | None:
    """Why this robot could not run any program now."""
    found = safety_trouble(status.safety_mode, status.safety_bits)
    return found or mode_trouble(status.robot_mode)


def motion_trouble(status: Status) -> Trouble | None:
    """Why our program could not move this robot now."""
    found = robot_trouble(status)
    if found is None and status.runtime_state != PLAYING:
        return trouble("program-stopped")
    return found


def code_of(word: str, table: dict[int, str]) -> int | None:
    """The number of a mode that the dashboard names; None when unknown."""
    return next((number for number, name in table.items() if name == word), None)


def connect_failure(message: str, device: str) -> DeviceError:
    """The error for what the client library said while it connected."""
    words = message.lower()
    for part, code in _BY_SENTENCE:
        if part in words:
            return trouble(code).fault(device)
    return ConnectError(
        f"no connection to the robot: {message}",
        device=device,
        hint="is the controller on, is host in [arm] right, and are ports 30003, 30004 "
        "and 29999 free to reach (services enabled in the security settings)?",
    )
