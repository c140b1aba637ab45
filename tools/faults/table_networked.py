"""What must come of every fault of a robot and of cameras, all of them on networks."""

from __future__ import annotations

from mvp.errors import (
    ConnectError,
    DeviceFault,
    DeviceTimeout,
    LimitError,
    LinkLost,
    MotionStopped,
)
from tools.faults.words import Case, NoSense, Row, order

LOST = (LinkLost, DeviceTimeout)
SERIAL_UR = "20225500123"
CLEAR = (order("clear"),)
AGAIN = (order("restart"),)
THIS_CAMERA = (order("restart", serial="SIM-GIGE-1"),)

UR: Row = {
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
    "limit": Case("a joint beyond its range", "rest", (LimitError,), 2, act="beyond"),
    "alarm": Case(
        "protective stop",
        "motion",
        (DeviceFault,),
        5,
        (order("protective_stop"),),
        code="protective-stop",
    ),
    "operator stop": Case("`stop()`", "motion", (MotionStopped,), 5, stop=True),
    "silent in motion": Case(
        "the controller sends nothing more; its arm is seen to stand",
        "motion",
        LOST,
        15,
        (order("silence"),),
        CLEAR,
        stands=True,
    ),
}

GENICAM: Row = {
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
    "silent in motion": Case(
        "it answers nothing more while it exposes",
        "motion",
        (LinkLost, DeviceTimeout),
        25,
        (order("silence"),),
        AGAIN,
        timeout_s=5,
    ),
}

OPENCV: Row = {
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
    "restarted": Case("it is switched off and on", "motion", (LinkLost,), 15, AGAIN),
    "wrong identity": NoSense(
        "a stream says nothing of who sends it; its address is all there is"
    ),
    "limit": Case(
        "an exposure beyond its range", "rest", (LimitError,), 5, act="beyond"
    ),
    "alarm": NoSense("a stream reports nothing but pictures"),
    "operator stop": Case("`stop()`", "motion", (MotionStopped,), 5, stop=True),
    "silent in motion": Case(
        "connected, but no more pictures while one is waited for",
        "motion",
        (LinkLost, DeviceTimeout),
        15,
        (order("stall", on=True),),
        (order("stall", on=False),),
        timeout_s=5,
    ),
}
