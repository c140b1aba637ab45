"""What must come of every fault of every device. This page is the promise.

Times are those of a computer that does other things as well; the drivers' own
deadlines are in the configuration beside each device.
"""

from __future__ import annotations

from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    LimitError,
    LinkLost,
    MotionStopped,
    WireError,
)
from tools.faults.table_networked import GENICAM, OPENCV, UR
from tools.faults.words import Case, NoSense, Row, order

QUIET = (order("noise"),)
MUTE = (order("noise", silence=True),)
PLUG = (order("replug"),)
CUT = (order("unplug", reset=True),)
LATE_S = 1.5  # three times the longest answer that the drivers below wait for
STOPPED_UNSEEN = Case(
    "the line goes mute; the stop is sent all the same, and obeyed",
    "motion",
    (DeviceTimeout,),
    20,
    MUTE,
    QUIET,
    timeout_s=10,
    stands=True,
)


def _line(*, impostor: str, **others: Case | NoSense) -> Row:
    """What every serial line has in common; the others differ by device."""
    row: Row = {
        "refused": Case("the port is gone", "opening", (ConnectError,), 5, CUT, PLUG),
        "silent": Case(
            "the line goes mute",
            "rest",
            (DeviceTimeout,),
            8,
            MUTE,
            QUIET,
        ),
        "slow": Case(
            f"every answer comes {LATE_S:g} s late",
            "rest",
            (DeviceTimeout,),
            15,
            (order("noise", late_s=LATE_S),),
            QUIET,
        ),
        "garbage": Case(
            "three bits of ten bytes are turned over",
            "rest",
            (WireError, DeviceTimeout, DeviceFault),
            15,
            (order("noise", flip=0.3, direction="to_host"),),
            QUIET,
        ),
        "dropped at rest": Case(
            "the cable is pulled", "rest", (LinkLost,), 5, CUT, PLUG
        ),
        "dropped in motion": Case(
            "the cable is pulled", "motion", (LinkLost,), 5, CUT, PLUG
        ),
        "wrong identity": Case(
            f"the port leads to {impostor}",
            "opening",
            (ConnectError,),
            25,
            impostor=impostor,
        ),
        "limit": Case(
            "a target beyond the range", "rest", (LimitError,), 2, act="beyond"
        ),
        "operator stop": Case("`stop()`", "motion", (MotionStopped,), 8, stop=True),
        "silent in motion": STOPPED_UNSEEN,
    }
    return row | {name.replace("_", " "): case for name, case in others.items()}


def _cut_answer(
    how: str,
    *,
    lost_bytes: int,
    raises: tuple[type[DeviceError], ...] = (DeviceTimeout,),
    within_s: float,
    timeout_s: float = 60.0,
    may_go_on: bool = False,
) -> Case:
    """An answer loses its first bytes while it moves."""
    return Case(
        how,
        "motion",
        raises,
        within_s,
        (order("drop_next", count=lost_bytes),),
        timeout_s=timeout_s,
        may_go_on=may_go_on,
    )


def _supply_fails(
    *raises: type[DeviceError],
    within_s: float,
    code: str = "",
    consequence: str = "",
    patience_s: float = 0.0,
) -> Case:
    """The power goes and comes while it moves."""
    return Case(
        f"the supply fails for a moment{consequence}",
        "motion",
        raises,
        within_s,
        (order("power_cycle"),),
        code=code,
        patience_s=patience_s,
    )


TABLE: dict[str, Row] = {
    "ur": UR,
    "gantry, grblHAL": _line(
        impostor="scf4",
        half_frame=_cut_answer(
            "the answer that ends the move loses its first bytes",
            lost_bytes=3,
            within_s=15,
            timeout_s=2,
        ),
        restarted=_supply_fails(DeviceFault, within_s=5, code="GrblHAL"),
        alarm=Case(
            "a limit switch is hit",
            "motion",
            (DeviceFault,),
            5,
            (order("press", axis="X"),),
            (order("let_go", axis="X"),),
            code="ALARM:1",
            simulator={"hard_limits": True},
        ),
    ),
    "gantry, Marlin": _line(
        impostor="theia",
        half_frame=_cut_answer(
            "the answer that ends the move loses its first bytes",
            lost_bytes=2,
            within_s=25,
            timeout_s=2,
        ),
        restarted=_supply_fails(DeviceFault, within_s=5, code="start"),
        alarm=Case(
            "the board says that it has been killed",
            "motion",
            (DeviceFault,),
            5,
            (order("say", hex=b"Error:Printer halted. kill() called!\n".hex()),),
            (order("power_cycle"),),
            code="Printer halted",
        ),
    ),
    "scf4": _line(
        impostor="marlin",
        half_frame=_cut_answer(
            "a status loses its first bytes; it is asked for again",
            lost_bytes=4,
            raises=(),
            within_s=30,
        ),
        restarted=_supply_fails(DeviceFault, DeviceTimeout, within_s=8),
        alarm=Case(
            "a motor sticks while it looks for its light barrier",
            "rest",
            (DeviceTimeout,),
            10,
            (order("stall", axis="zoom"),),
            (order("release", axis="zoom"),),
            act="home",
            timeout_s=3,
        ),
    ),
    "theia-mcr": _line(
        impostor="grbl",
        half_frame=_cut_answer(
            "the answer that ends the move loses its first byte",
            lost_bytes=1,
            within_s=15,
        ),
        silent_in_motion=Case(
            "the line goes mute; the board could not be stopped",
            "motion",
            (DeviceTimeout,),
            20,
            MUTE,
            QUIET,
        ),
        restarted=_supply_fails(
            DeviceTimeout, within_s=15, consequence=": no answer ever comes"
        ),
        alarm=Case(
            "the board says that a motion ended badly",
            "motion",
            (DeviceFault,),
            5,
            (order("say", hex="74010d"),),
            code="74 01",
        ),
    ),
    "visca": _line(
        impostor="scf4",
        half_frame=_cut_answer(
            "an answer loses its first byte; an acknowledgment is missed, a completion "
            "is not, as the position is what counts",
            lost_bytes=1,
            within_s=8,
            may_go_on=True,
        ),
        restarted=_supply_fails(DeviceFault, DeviceTimeout, within_s=10, patience_s=10),
        alarm=Case(
            "the focus sticks",
            "rest",
            (DeviceFault, DeviceTimeout),
            15,
            (order("stall", axis="focus"),),
            (order("release", axis="focus"),),
        ),
    ),
    "genicam": GENICAM,
    "opencv": OPENCV,
}
