"""What a client of the real library does, as a process that may crash or hang.

Usage: ``python ur_client.py SCENARIO HOST CONTROL_PORT``; prints one JSON document.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import TYPE_CHECKING

import numpy as np
from dashboard_client import DashboardClient
from rtde_control import RTDEControlInterface
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface

from drivers.simulators.control import ControlClient

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

Said = dict[str, object]
HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
THERE = [0.2, -1.4, 1.5, -1.57, -1.57, 0.1]
HZ = 125.0
UPPER_RANGE, NO_EXT_FT = 0x08, 0x40
CUSTOM_SCRIPT = 0x20


def receiving(host: str, faults: ControlClient) -> Said:
    """Timestamps at two rates."""
    said: Said = {}
    for hz in (125.0, 500.0):
        receive = RTDEReceiveInterface(host, hz)
        stamps = sorted(set(_sampled(receive.getTimestamp, 0.6)))
        said[f"{hz:.0f}"] = np.diff(stamps).tolist()
        said["joints"] = _fresh(receive, faults).getActualQ()
        said["pose"] = _fresh(receive, faults).getActualTCPPose()
        said["modes"] = [
            receive.getRobotMode(),
            receive.getSafetyMode(),
            receive.getRuntimeState(),
            receive.getSafetyStatusBits(),
            receive.getRobotStatus(),
        ]
        receive.disconnect()
    return said


def blocking_moves(host: str, faults: ControlClient) -> Said:
    """moveJ, moveL, moveJ_IK and moveL_FK, one after the other."""
    receive, control = _both(host)
    said: Said = {"home": control.moveJ(HOME, 3.0, 10.0)}
    said["moved"] = control.moveJ(THERE, 3.0, 10.0)
    said["joints"] = _fresh(receive, faults).getActualQ()
    pose = _fresh(receive, faults).getActualTCPPose()
    said["pose"] = list(pose)
    pose[2] += 0.05
    said["line"] = control.moveL(pose, 1.0, 5.0)
    said["line_error"] = _off(_fresh(receive, faults).getActualTCPPose(), pose)
    said["ik"] = control.moveJ_IK(said["pose"], 3.0, 10.0)
    said["ik_error"] = _off(_fresh(receive, faults).getActualTCPPose(), said["pose"])
    said["fk"] = control.moveL_FK(HOME, 1.0, 5.0)
    said["fk_joints"] = _fresh(receive, faults).getActualQ()
    return said


def asynchronous_moves(host: str, faults: ControlClient) -> Said:
    """Start, watch and stop moves beside the loop."""
    receive, control = _both(host)
    control.moveJ(HOME, 3.0, 10.0)
    before = control.getAsyncOperationProgressEx().operationId()
    said: Said = {"started": control.moveJ(_turned(1.0), 1.0, 2.0, True)}
    _until(lambda: control.getAsyncOperationProgressEx().operationId() != before)
    first = control.getAsyncOperationProgressEx()
    said["running"] = [first.isAsyncOperationRunning(), first.progress()]
    said["operations"] = [before, first.operationId()]
    said["query"] = control.isSteady()
    _until(lambda: not control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    said["finished"] = control.getAsyncOperationProgress()
    said["arrived"] = _fresh(receive, faults).getActualQ()
    control.moveJ(HOME, 1.0, 2.0, True)
    _until(lambda: max(map(abs, receive.getActualQd())) > 0.3)
    control.stopJ(4.0)
    said["between"] = _fresh(receive, faults).getActualQ()
    said["replaced"] = [
        control.moveJ(_turned(1.0), 1.0, 2.0, True),
        control.moveJ(HOME, 3.0, 10.0),
    ]
    said["home"] = _fresh(receive, faults).getActualQ()
    return said


def paths(host: str, faults: ControlClient) -> Said:
    """A path of three points with a blend, beside the loop and blocking."""
    receive, control = _both(host)
    control.moveJ(HOME, 3.0, 10.0)
    way = [
        [*_turned(0.2), 1.0, 3.0, 0.0],
        [*_turned(0.5), 1.0, 3.0, 0.05],
        [*_turned(0.3), 1.0, 3.0, 0.0],
    ]
    said: Said = {"started": control.moveJ(way, True)}
    seen: list[int] = []
    for progress in _sampled(control.getAsyncOperationProgress, 20.0):
        if not seen or seen[-1] != progress:
            seen.append(progress)
        if progress < 0 and len(seen) > 2:
            break
    said["seen"] = seen
    said["joints"] = _fresh(receive, faults).getActualQ()
    said["again"] = control.moveJ(way)
    said["scripts"] = faults.do("state")["scripts"]
    return said


def questions(host: str, faults: ControlClient) -> Said:
    """TCP, payload, kinematics, limits; and what the library gets wrong."""
    receive, control = _both(host)
    control.moveJ(THERE, 3.0, 10.0)
    said: Said = {"set": control.setTcp([0.0, 0.01, 0.1, 0.0, 0.2, 0.0])}
    said["tcp"] = control.getTCPOffset()
    _until(lambda: abs(receive.getActualTCPPose()[0] + 0.51415) > 0.01)
    said["pose"] = _fresh(receive, faults).getActualTCPPose()
    said["forward"] = control.getForwardKinematics()
    said["forward_of"] = control.getForwardKinematics(THERE, said["tcp"])
    said["inverse"] = control.getInverseKinematics(said["pose"], HOME)
    said["inverse_here"] = control.getInverseKinematics(said["pose"])
    control.setTcp([0.0] * 6)
    control.moveJ(THERE, 3.0, 10.0)
    said["wrong_forward"] = control.getForwardKinematics(THERE)
    said["steady"] = control.isSteady()
    said["payload"] = control.setPayload(1.5, [0.0, 0.0, 0.05])
    _until(lambda: receive.getPayload() == 1.5)
    said["payload_read"] = [receive.getPayload(), *receive.getPayloadCog()]
    said["solvable"] = [
        control.getInverseKinematicsHasSolution(said["pose"]),
        control.getInverseKinematicsHasSolution([3.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ]
    said["limits"] = [
        control.isJointsWithinSafetyLimits(HOME),
        control.isJointsWithinSafetyLimits([7.0, *HOME[1:]]),
    ]
    said["trans"] = control.poseTrans([1, 2, 3, 0, 0, 1.5], [1, 0, 0, 0, 0, 0])
    said["impossible"] = control.getInverseKinematics([3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    said["alive"] = control.isProgramRunning()
    return said


def streaming(host: str, faults: ControlClient) -> Said:
    """servoJ, speedJ and speedL."""
    receive, control = _both(host)
    control.moveJ(HOME, 3.0, 10.0)
    for _ in range(40):
        control.servoJ(_turned(0.05), 0.5, 0.5, 0.008, 0.1, 300)
        time.sleep(0.01)
    said: Said = {"servo": _fresh(receive, faults).getActualQ()[0]}
    control.servoStop(10.0)
    control.speedJ([0.2, 0.0, 0.0, 0.0, 0.0, 0.0], 5.0, 0.0)
    time.sleep(0.3)
    said["joint_rate"] = _fresh(receive, faults).getActualQd()
    control.speedStop(10.0)
    control.speedL([0.0, 0.0, 0.05, 0.0, 0.0, 0.0], 5.0, 0.0)
    time.sleep(0.3)
    said["tool_rate"] = _fresh(receive, faults).getActualTCPSpeed()
    control.speedStop(10.0)
    said["steady"] = control.isSteady()
    return said


def inputs_and_outputs(host: str, faults: ControlClient) -> Said:
    """Digital and analog outputs, the slider, registers."""
    receive = RTDEReceiveInterface(host, HZ)
    out = RTDEIOInterface(host)
    out.setStandardDigitalOut(3, True)
    out.setConfigurableDigitalOut(1, True)
    out.setToolDigitalOut(0, True)
    out.setAnalogOutputVoltage(0, 0.5)
    out.setSpeedSlider(0.4)
    faults.do("digital_input", bit=5, on=True)
    _until(lambda: receive.getActualDigitalInputBits() == 1 << 5)
    _until(lambda: receive.getTargetSpeedFraction() == 0.4)
    said: Said = {
        "outputs": receive.getActualDigitalOutputBits(),
        "analog": receive.getStandardAnalogOutput0(),
        "fraction": receive.getTargetSpeedFraction(),
    }
    out.setSpeedSlider(1.0)
    _until(lambda: receive.getTargetSpeedFraction() == 1.0)
    out.disconnect()
    receive.disconnect()
    return said


def protective_stop(host: str, faults: ControlClient) -> Said:
    """In the middle of a move; then the way back."""
    said: Said = {}
    for program in ("pause", "stop"):
        said[program] = _stopped(host, faults, program)
    return said


def _stopped(host: str, faults: ControlClient, program: str) -> Said:
    receive, control = _both(host)
    control.moveJ(HOME, 3.0, 10.0)
    before = control.getAsyncOperationProgressEx().operationId()
    control.moveJ(_turned(2.0), 0.5, 2.0, True)
    _until(lambda: control.getAsyncOperationProgressEx().operationId() != before)
    time.sleep(0.1)
    faults.do("unlock_delay", seconds=0.2)
    faults.do("protective_stop", program=program)
    _until(receive.isProtectiveStopped)
    said: Said = {
        "modes": [receive.getRobotMode(), receive.getSafetyMode()],
        "bits": receive.getSafetyStatusBits(),
        "state": receive.getRuntimeState(),
        "move": control.moveJ(HOME, 1.0, 2.0),
        "steady": control.isSteady(),
        "raised": _raised(control.getTCPOffset),
    }
    _until(lambda: not any(receive.getActualQd()))
    stands = _fresh(receive, faults).getActualQ()
    dashboard = DashboardClient(host)
    dashboard.connect()
    faults.do("protective_stop", program=program)
    said["early"] = _raised(dashboard.unlockProtectiveStop)
    time.sleep(0.3)
    dashboard.unlockProtectiveStop()
    _until(lambda: not receive.isProtectiveStopped())
    time.sleep(0.1)
    said["crept"] = _off(receive.getActualQ(), stands)
    said["after"] = control.moveJ(HOME, 1.0, 2.0)
    said["uploaded"] = control.reuploadScript()
    _until(control.isProgramRunning)
    said["again"] = control.moveJ(HOME, 3.0, 10.0)
    dashboard.disconnect()
    return said


def blocking_move_stopped(host: str, faults: ControlClient) -> Said:
    """A protective stop, then an emergency stop, while a blocking call waits."""
    said: Said = {}
    for kind in ("protective_stop", "emergency_stop"):
        receive, control = _both(host)
        control.moveJ(HOME, 3.0, 10.0)
        faults.do("in", seconds=0.3, then={"do": kind})
        moved = control.moveJ(_turned(3.0), 0.3, 2.0)
        _until(lambda receive=receive: receive.getSafetyStatusBits() != 1)
        said[kind] = [
            moved,
            receive.getSafetyStatusBits(),
            receive.isEmergencyStopped(),
        ]
        control.disconnect()
        _power_up(host, faults)
    return said


def emergency_stop(host: str, faults: ControlClient) -> Said:
    """Pressed in the middle of a move; power comes back step by step."""
    receive, control = _both(host)
    control.moveJ(HOME, 3.0, 10.0)
    control.moveJ(_turned(2.0), 0.5, 2.0, True)
    time.sleep(0.15)
    faults.do("emergency_stop")
    _until(lambda: receive.getRobotMode() == 3)
    said: Said = {
        "safety": receive.getSafetyMode(),
        "bits": receive.getSafetyStatusBits(),
        "state": receive.getRuntimeState(),
        "move": control.moveJ(HOME, 1.0, 2.0),
        "rates": receive.getActualQd(),
    }
    said["power"] = _power_up(host, faults)
    said["uploaded"] = control.reuploadScript()
    _until(control.isProgramRunning)
    said["again"] = control.moveJ(HOME, 3.0, 10.0)
    return said


def safeguard_stop(host: str, faults: ControlClient) -> Said:
    """The move waits and goes on by itself."""
    receive, control = _both(host)
    control.moveJ(HOME, 3.0, 10.0)
    control.moveJ(_turned(0.5), 0.5, 2.0, True)
    time.sleep(0.2)
    faults.do("safeguard_stop")
    _until(lambda: receive.getRuntimeState() == 4 and not any(receive.getActualQd()))
    said: Said = {
        "bits": receive.getSafetyStatusBits(),
        "between": receive.getActualQ()[0],
    }
    faults.do("release")
    _until(lambda: _off(receive.getActualQ(), _turned(0.5)) < 1e-9)
    said["state"] = receive.getRuntimeState()
    return said


def watchdog(host: str, faults: ControlClient) -> Said:
    """A blocking move outlives a watchdog of 10 Hz and kills the program."""
    _receive, control = _both(host)
    control.moveJ(HOME, 3.0, 10.0)
    control.setWatchdog(10.0)
    said: Said = {"move": control.moveJ(_turned(1.0), 0.5, 2.0)}
    said["endings"] = faults.do("state")["endings"]
    return said


def custom_script(host: str, faults: ControlClient) -> Said:
    """A program of the client's own, then the control script again."""
    receive, control = _both(host)
    body = f"\tmovej({_turned(0.1)}, a=10.0, v=3.0)\n"
    said: Said = {"ran": control.sendCustomScriptFunction("own", body)}
    said["joints"] = _fresh(receive, faults).getActualQ()
    said["after"] = control.moveJ(HOME, 3.0, 10.0)
    return said


def dashboard(host: str, faults: ControlClient) -> Said:
    """Every command of the table."""
    client = DashboardClient(host)
    client.connect()
    said: Said = {
        "mode": client.robotmode(),
        "safety": client.safetymode(),
        "status": client.safetystatus(),
        "running": client.running(),
        "none": client.getLoadedProgram(),
        "bad": _raised(lambda: client.loadURP("x.txt")),
        "unplayable": _raised(client.play),
    }
    client.loadURP("job.urp")
    client.play()
    said |= {"loaded": client.getLoadedProgram(), "playing": client.programState()}
    client.pause()
    said["paused"] = client.programState()
    client.play()
    client.stop()
    said |= {
        "stopped": client.programState(),
        "version": client.polyscopeVersion(),
        "serial": client.getSerialNumber(),
        "model": client.getRobotModel(),
        "remote": client.isInRemoteControl(),
    }
    client.popup("hello")
    client.closePopup()
    client.closeSafetyPopup()
    client.addToLog("hello")
    client.powerOff()
    said["off"] = client.robotmode()
    client.powerOn()
    _until(lambda: "IDLE" in client.robotmode())
    client.brakeRelease()
    _until(lambda: "RUNNING" in client.robotmode())
    client.restartSafety()
    said["restarted"] = client.robotmode()
    client.brakeRelease()
    _until(lambda: "RUNNING" in client.robotmode())
    client.quit()
    return said


def refused(host: str, faults: ControlClient) -> Said:
    """Reasons why the control constructor gives up at once."""
    said: Said = {}
    for name, verb, arguments in (
        ("remote off", "remote", {"on": False}),
        ("in use", "in_use", {"names": ["input_int_register_3"]}),
        ("rtde refused", "refuse", {"ports": [30004]}),
        ("script port refused", "refuse", {"ports": [30003]}),
        ("dashboard refused", "refuse", {"ports": [29999]}),
    ):
        said[name] = _gives_up(host, faults, verb, arguments)
    _receive, control = _both(host)
    said["afterwards"] = control.moveJ(HOME, 3.0, 10.0)
    said["second"] = _raised(lambda: RTDEControlInterface(host, HZ))
    said["first_lives"] = control.moveJ(THERE, 3.0, 10.0)
    return said


def refused_late(host: str, faults: ControlClient) -> Said:
    """Reasons why it gives up after seconds."""
    said: Said = {}
    for name, verb, arguments in (
        ("script rejected", "reject_scripts", {}),
        ("power off", "robot_mode", {"mode": "POWER_OFF"}),
        ("dashboard mute", "mute", {"dashboard": True}),
    ):
        said[name] = _gives_up(host, faults, verb, arguments)
    _receive, control = _both(host)
    said["afterwards"] = control.moveJ(HOME, 3.0, 10.0)
    return said


def _gives_up(host: str, faults: ControlClient, verb: str, arguments: Said) -> str:
    faults.do(verb, **arguments)
    time.sleep(0.05)
    said = _raised(lambda: RTDEControlInterface(host, HZ))
    faults.do("clear")
    faults.do("remote", on=True)
    faults.do("robot_mode", mode="RUNNING")
    time.sleep(0.1)
    return said


def foreign_program(host: str, faults: ControlClient) -> Said:
    """A program of the pendant plays: the constructor stops it, after seconds."""
    faults.do("foreign_program")
    receive, control = _both(host)
    said: Said = {"moved": control.moveJ(HOME, 3.0, 10.0)}
    faults.do("foreign_program")
    time.sleep(0.1)
    said["state"] = receive.getRuntimeState()
    said["program"] = faults.do("state")["program"]
    faults.do("program_stop")
    return said


def lost_receive(host: str, faults: ControlClient) -> Said:
    """FIN, RST, silence, a frozen clock, slowness, a restart: the receiving side."""
    said: Said = {}
    for how in ("fin", "rst"):
        receive = RTDEReceiveInterface(host, HZ)
        faults.do("drop", how=how)
        said[how] = [_waited(lambda r=receive: not r.isConnected())]
        said[f"{how} back"] = receive.reconnect() and receive.isConnected()
        receive.disconnect()
    receive = RTDEReceiveInterface(host, HZ)
    faults.do("silence")
    time.sleep(0.2)
    stamps = set(_sampled(receive.getTimestamp, 0.3))
    said["silent"] = len(stamps)
    faults.do("silence", on=False)
    faults.do("freeze")
    time.sleep(0.2)
    said["frozen"] = len(set(_sampled(receive.getTimestamp, 0.3)))
    faults.do("freeze", on=False)
    time.sleep(0.1)
    said["thawed"] = len(set(_sampled(receive.getTimestamp, 0.3))) > 10
    faults.do("slow", delay_s=0.3)
    time.sleep(0.5)
    late = float(str(faults.do("state")["time_s"])) - receive.getTimestamp()
    said["late_s"] = late
    faults.do("clear")
    faults.do("restart", down_s=0.3)
    _until(lambda: not receive.isConnected())
    said["down"] = _raised(receive.reconnect)
    time.sleep(0.6)
    said["up"] = receive.reconnect()
    said["power"] = receive.getRobotMode()
    receive.disconnect()
    _power_up(host, faults, release=False)
    return said


def mute_receive(host: str, faults: ControlClient) -> Said:
    """Never returns: the library waits for an answer without end."""
    faults.do("mute", types="O")
    RTDEReceiveInterface(host, HZ)
    return {}


def malformed(host: str, faults: ControlClient) -> Said:
    """A package that claims no length: the library aborts its process."""
    receive = RTDEReceiveInterface(host, HZ)
    faults.do("inject", hex="000055")
    time.sleep(2)
    return {"connected": receive.isConnected()}


def lost_control(host: str, faults: ControlClient) -> Said:
    """The library reconnects without end and dies of it."""
    control = RTDEControlInterface(host, HZ)
    control.moveJ(HOME, 3.0, 10.0)
    faults.do("drop", what="rtde")
    time.sleep(6)
    return {}


def version_smoke(host: str, faults: ControlClient) -> Said:
    """A move and a question, whatever the controller."""
    receive, control = _both(host)
    said: Said = {
        "moved": control.moveJ(THERE, 3.0, 10.0),
        "joints": _fresh(receive, faults).getActualQ(),
        "tcp": control.getTCPOffset(),
    }
    return said


def upper_range(host: str, faults: ControlClient) -> Said:
    """The upper registers: the script and the client disagree from 5.23 on."""
    control = RTDEControlInterface(host, HZ, UPPER_RANGE | 0x01)
    return {"moved": control.moveJ(HOME, 3.0, 10.0)}


def _both(host: str) -> tuple[RTDEReceiveInterface, RTDEControlInterface]:
    return RTDEReceiveInterface(host, HZ), RTDEControlInterface(host, HZ)


def _fresh(
    receive: RTDEReceiveInterface, faults: ControlClient
) -> RTDEReceiveInterface:
    """The receiver, once it has seen what is true now: two links, two delays."""
    now = float(str(faults.do("state")["time_s"]))
    _until(lambda: receive.getTimestamp() >= now)
    return receive


def _power_up(host: str, faults: ControlClient, *, release: bool = True) -> list[str]:
    """From a stop back to a running robot; the modes on the way."""
    client = DashboardClient(host)
    client.connect()
    if "PROTECTIVE" in client.safetystatus():
        faults.do("unlock_delay", seconds=0.0)
        client.unlockProtectiveStop()
        client.disconnect()
        return []
    if release:
        faults.do("release")
    seen = [client.robotmode()]
    client.closeSafetyPopup()
    client.powerOn()
    _until(lambda: "IDLE" in client.robotmode())
    seen.append(client.robotmode())
    client.brakeRelease()
    _until(lambda: "RUNNING" in client.robotmode())
    client.disconnect()
    return seen


def _turned(base_rad: float) -> list[float]:
    return [base_rad, *HOME[1:]]


def _off(here: object, there: object) -> float:
    return float(np.abs(np.array(here) - np.array(there)).max())


def _raised(call: Callable[[], object]) -> str:
    try:
        return f"returned {call()}"
    except RuntimeError as error:
        return str(error)


def _sampled(read: Callable[[], object], seconds: float) -> Iterator[object]:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        yield read()
        time.sleep(0.0005)


def _waited(condition: Callable[[], bool]) -> float:
    began = time.monotonic()
    _until(condition)
    return time.monotonic() - began


def _until(condition: Callable[[], bool], seconds: float = 15.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            raise TimeoutError("it never came to be")
        time.sleep(0.002)


def main() -> None:
    """Play one scenario."""
    name, host, port = sys.argv[1:]
    with ControlClient(int(port)) as faults:
        sys.stdout.write(json.dumps(globals()[name](host, faults)) + "\n")
    sys.stdout.flush()
    # The library's own farewell takes half a second per object.
    os._exit(0)


if __name__ == "__main__":
    main()
