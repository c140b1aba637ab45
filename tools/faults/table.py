"""What must come of every fault of every device. This page is the promise.

Times are those of a computer that does other things as well; the drivers' own
deadlines are in the configuration beside each device.
"""

from __future__ import annotations

from mvp.errors import (
    ConnectError,
    DeviceFault,
    DeviceTimeout,
    LimitError,
    LinkLost,
    MotionStopped,
    WireError,
)
from tools.faults.words import Case, NoSense, order

Row = dict[str, Case | NoSense]

QUIET = (order("noise"),)
PLUG = (order("replug"),)
CUT = (order("unplug", reset=True),)
LATE_S = 1.5  # three times the longest answer that the drivers below wait for
LOST = (LinkLost, DeviceTimeout)


def _line(*, impostor: str, **others: Case | NoSense) -> Row:
    """What every serial line has in common; the others differ by device."""
    row: Row = {
        "refused": Case("the port is gone", "opening", (ConnectError,), 5, CUT, PLUG),
        "silent": Case(
            "the line goes mute",
            "rest",
            (DeviceTimeout,),
            8,
            (order("noise", silence=True),),
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
    }
    return row | {name.replace("_", " "): case for name, case in others.items()}


SERIAL_UR = "20225500123"
CLEAR = (order("clear"),)
AGAIN = (order("restart"),)
THIS_CAMERA = (order("restart", serial="SIM-GIGE-1"),)

TABLE: dict[str, Row] = {
    "ur": {
        "refused": Case(
            "every port is closed",
            "opening",
            (ConnectError,),
            10,
            (order("refuse"),),
            (order("listen"),),
            patience_s=10,
        ),
        "silent": Case(
            "the controller sends nothing more",
            "rest",
            LOST,
            10,
            (order("silence"),),
            CLEAR,
        ),
        "slow": Case(
            "everything comes 4 s late",
            "motion",
            LOST,
            15,
            (order("slow", delay_s=4.0),),
            CLEAR,
        ),
        "garbage": Case(
            "a package of length 0 in the stream, which takes the library down",
            "motion",
            LOST,
            10,
            (order("inject", hex="0000"),),
            CLEAR,
        ),
        "half frame": Case(
            "a package that promises 65,535 bytes",
            "motion",
            LOST,
            15,
            (order("inject", hex="ffff55" + "00" * 40),),
            CLEAR,
        ),
        "dropped at rest": Case(
            "connections are closed", "rest", LOST, 10, (order("drop", how="fin"),)
        ),
        "dropped in motion": Case(
            "connections are reset", "motion", LOST, 10, (order("drop", how="rst"),)
        ),
        "restarted": Case(
            "the controller is switched off and on",
            "motion",
            LOST,
            10,
            (order("restart", down_s=1.0),),
            patience_s=60,
        ),
        "wrong identity": Case(
            "another serial number",
            "opening",
            (DeviceFault,),
            20,
            (order("identity", serial="99"),),
            (order("identity", serial=SERIAL_UR),),
            code="wrong-robot",
        ),
        "limit": Case(
            "a joint beyond its range", "rest", (LimitError,), 2, act="beyond"
        ),
        "alarm": Case(
            "protective stop",
            "motion",
            (DeviceFault,),
            5,
            (order("protective_stop"),),
            code="protective-stop",
        ),
        "operator stop": Case("`stop()`", "motion", (MotionStopped,), 5, stop=True),
    },
    "gantry, grblHAL": _line(
        impostor="scf4",
        half_frame=Case(
            "the answer that ends the move loses its first bytes",
            "motion",
            (DeviceTimeout,),
            15,
            (order("drop_next", count=3),),
            timeout_s=2,
        ),
        restarted=Case(
            "the supply fails for a moment",
            "motion",
            (DeviceFault,),
            5,
            (order("power_cycle"),),
            code="GrblHAL",
        ),
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
        half_frame=Case(
            "the answer that ends the move loses its first bytes",
            "motion",
            (DeviceTimeout,),
            25,
            (order("drop_next", count=2),),
            timeout_s=2,
        ),
        restarted=Case(
            "the supply fails for a moment",
            "motion",
            (DeviceFault,),
            5,
            (order("power_cycle"),),
            code="start",
        ),
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
        half_frame=Case(
            "a status loses its first bytes; it is asked for again",
            "motion",
            (),
            30,
            (order("drop_next", count=4),),
        ),
        restarted=Case(
            "the supply fails for a moment",
            "motion",
            (DeviceFault, DeviceTimeout),
            8,
            (order("power_cycle"),),
        ),
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
        half_frame=Case(
            "the answer that ends the move loses its first byte",
            "motion",
            (DeviceTimeout,),
            15,
            (order("drop_next", count=1),),
        ),
        restarted=Case(
            "the supply fails for a moment: no answer ever comes",
            "motion",
            (DeviceTimeout,),
            15,
            (order("power_cycle"),),
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
        half_frame=Case(
            "an answer loses its first byte; an acknowledgment is missed, a completion "
            "is not, as the position is what counts",
            "motion",
            (DeviceTimeout,),
            8,
            (order("drop_next", count=1),),
            may_go_on=True,
        ),
        restarted=Case(
            "the supply fails for a moment",
            "motion",
            (DeviceFault, DeviceTimeout),
            10,
            (order("power_cycle"),),
            patience_s=10,
        ),
        alarm=Case(
            "the focus sticks",
            "rest",
            (DeviceFault, DeviceTimeout),
            15,
            (order("stall", axis="focus"),),
            (order("release", axis="focus"),),
        ),
    ),
    "genicam": {
        "refused": Case(
            "nobody answers", "opening", (ConnectError,), 20, (order("kill"),), AGAIN
        ),
        "silent": Case(
            "it answers nothing more",
            "rest",
            (LinkLost, DeviceTimeout),
            25,
            (order("silence"),),
            AGAIN,
        ),
        "slow": Case(
            "a frame takes 4 s longer than it may",
            "rest",
            (DeviceTimeout, DeviceFault, LinkLost),
            25,
            (order("slow", seconds=4.0),),
            (order("slow", seconds=0.0),),
            patience_s=20,
            timeout_s=5,
        ),
        "garbage": Case(
            "200 random datagrams to its control port",
            "rest",
            (),
            20,
            (order("datagrams"),),
        ),
        "half frame": Case(
            "six of ten packets of a picture are lost",
            "rest",
            (DeviceFault, DeviceTimeout),
            25,
            (order("lose", per_thousand=600),),
            (order("lose", per_thousand=0),),
            timeout_s=15,
        ),
        "dropped at rest": Case(
            "it is switched off", "rest", (LinkLost,), 20, (order("kill"),), AGAIN
        ),
        "dropped in motion": Case(
            "it is switched off", "motion", (LinkLost,), 20, (order("kill"),), AGAIN
        ),
        "restarted": Case(
            "it is switched off and on",
            "motion",
            (LinkLost, DeviceTimeout, DeviceFault),
            20,
            THIS_CAMERA,
        ),
        "wrong identity": Case(
            "another serial number",
            "opening",
            (ConnectError,),
            20,
            (order("restart", serial="OTHER"),),
            THIS_CAMERA,
        ),
        "limit": Case(
            "an exposure beyond its range", "rest", (LimitError,), 5, act="beyond"
        ),
        "alarm": NoSense(
            "the standard has no alarms; a camera that fails loses packets or its link"
        ),
        "operator stop": Case("`stop()`", "motion", (MotionStopped,), 5, stop=True),
    },
    "opencv": {
        "refused": Case(
            "nobody listens", "opening", (ConnectError,), 20, (order("kill"),), AGAIN
        ),
        "silent": Case(
            "connected, but no more pictures",
            "rest",
            (LinkLost, DeviceTimeout),
            15,
            (order("stall", on=True),),
            (order("stall", on=False),),
            timeout_s=5,
        ),
        "slow": Case(
            "300 bytes a second",
            "rest",
            (LinkLost, DeviceTimeout),
            15,
            (order("slow", bytes_per_s=300.0),),
            (order("slow", bytes_per_s=0.0),),
            timeout_s=4,
        ),
        "garbage": Case(
            "a part of the stream is no picture",
            "rest",
            (LinkLost,),
            15,
            (order("garbage", count=3),),
        ),
        "half frame": Case(
            "the stream breaks off within a picture",
            "rest",
            (LinkLost,),
            15,
            (order("half", count=1),),
        ),
        "dropped at rest": Case(
            "it is switched off",
            "rest",
            (LinkLost, ConnectError),
            15,
            (order("kill"),),
            AGAIN,
        ),
        "dropped in motion": Case(
            "it is switched off", "motion", (LinkLost,), 15, (order("kill"),), AGAIN
        ),
        "restarted": Case(
            "it is switched off and on", "motion", (LinkLost,), 15, AGAIN
        ),
        "wrong identity": NoSense(
            "a stream says nothing of who sends it; its address is all there is"
        ),
        "limit": Case(
            "an exposure beyond its range", "rest", (LimitError,), 5, act="beyond"
        ),
        "alarm": NoSense("a stream reports nothing but pictures"),
        "operator stop": Case("`stop()`", "motion", (MotionStopped,), 5, stop=True),
    },
}
