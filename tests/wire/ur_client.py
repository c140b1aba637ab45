"""Healthy clients of the real library, as processes of their own.

Usage: ``python FILE SCENARIO HOST CONTROL_PORT``; prints one JSON document.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
from dashboard_client import DashboardClient
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface
from ur_client_kit import (
    HOME,
    HZ,
    THERE,
    Said,
    both,
    fresh,
    main,
    off,
    raised,
    sampled,
    turned,
    until,
)

if TYPE_CHECKING:
    from drivers.simulators.control import ControlClient


def receiving(host: str, faults: ControlClient) -> Said:
    """Timestamps at two rates."""
    said: Said = {}
    for hz in (125.0, 500.0):
        receive = RTDEReceiveInterface(host, hz)
        stamps = sorted(set(sampled(receive.getTimestamp, 0.6)))
        said[f"{hz:.0f}"] = np.diff(stamps).tolist()
        said["joints"] = fresh(receive, faults).getActualQ()
        said["pose"] = fresh(receive, faults).getActualTCPPose()
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
    receive, control = both(host)
    said: Said = {"home": control.moveJ(HOME, 3.0, 10.0)}
    said["moved"] = control.moveJ(THERE, 3.0, 10.0)
    said["joints"] = fresh(receive, faults).getActualQ()
    pose = fresh(receive, faults).getActualTCPPose()
    said["pose"] = list(pose)
    pose[2] += 0.05
    said["line"] = control.moveL(pose, 1.0, 5.0)
    said["line_error"] = off(fresh(receive, faults).getActualTCPPose(), pose)
    said["ik"] = control.moveJ_IK(said["pose"], 3.0, 10.0)
    said["ik_error"] = off(fresh(receive, faults).getActualTCPPose(), said["pose"])
    said["fk"] = control.moveL_FK(HOME, 1.0, 5.0)
    said["fk_joints"] = fresh(receive, faults).getActualQ()
    return said


def asynchronous_moves(host: str, faults: ControlClient) -> Said:
    """Start, watch and stop moves beside the loop."""
    receive, control = both(host)
    control.moveJ(HOME, 3.0, 10.0)
    before = control.getAsyncOperationProgressEx().operationId()
    said: Said = {"started": control.moveJ(turned(1.0), 1.0, 2.0, True)}
    until(lambda: control.getAsyncOperationProgressEx().operationId() != before)
    first = control.getAsyncOperationProgressEx()
    said["running"] = [first.isAsyncOperationRunning(), first.progress()]
    said["operations"] = [before, first.operationId()]
    said["query"] = control.isSteady()
    until(lambda: not control.getAsyncOperationProgressEx().isAsyncOperationRunning())
    said["finished"] = control.getAsyncOperationProgress()
    said["arrived"] = fresh(receive, faults).getActualQ()
    control.moveJ(HOME, 1.0, 2.0, True)
    until(lambda: max(map(abs, receive.getActualQd())) > 0.3)
    control.stopJ(4.0)
    said["between"] = fresh(receive, faults).getActualQ()
    said["replaced"] = [
        control.moveJ(turned(1.0), 1.0, 2.0, True),
        control.moveJ(HOME, 3.0, 10.0),
    ]
    said["home"] = fresh(receive, faults).getActualQ()
    return said


def paths(host: str, faults: ControlClient) -> Said:
    """A path of three points with a blend, beside the loop and blocking."""
    receive, control = both(host)
    control.moveJ(HOME, 3.0, 10.0)
    way = [
        [*turned(0.2), 1.0, 3.0, 0.0],
        [*turned(0.5), 1.0, 3.0, 0.05],
        [*turned(0.3), 1.0, 3.0, 0.0],
    ]
    said: Said = {"started": control.moveJ(way, True)}
    seen: list[int] = []
    for progress in sampled(control.getAsyncOperationProgress, 20.0):
        if not seen or seen[-1] != progress:
            seen.append(progress)
        if progress < 0 and len(seen) > 2:
            break
    said["seen"] = seen
    said["joints"] = fresh(receive, faults).getActualQ()
    said["again"] = control.moveJ(way)
    said["scripts"] = faults.do("state")["scripts"]
    return said


def questions(host: str, faults: ControlClient) -> Said:
    """TCP, payload, kinematics, limits; and what the library gets wrong."""
    receive, control = both(host)
    control.moveJ(THERE, 3.0, 10.0)
    said: Said = {"set": control.setTcp([0.0, 0.01, 0.1, 0.0, 0.2, 0.0])}
    said["tcp"] = control.getTCPOffset()
    until(lambda: abs(receive.getActualTCPPose()[0] + 0.51415) > 0.01)
    said["pose"] = fresh(receive, faults).getActualTCPPose()
    said["forward"] = control.getForwardKinematics()
    said["forward_of"] = control.getForwardKinematics(THERE, said["tcp"])
    said["inverse"] = control.getInverseKinematics(said["pose"], HOME)
    said["inverse_here"] = control.getInverseKinematics(said["pose"])
    control.setTcp([0.0] * 6)
    control.moveJ(THERE, 3.0, 10.0)
    said["wrong_forward"] = control.getForwardKinematics(THERE)
    said["steady"] = control.isSteady()
    said["payload"] = control.setPayload(1.5, [0.0, 0.0, 0.05])
    until(lambda: receive.getPayload() == 1.5)
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
    receive, control = both(host)
    control.moveJ(HOME, 3.0, 10.0)
    for _ in range(40):
        control.servoJ(turned(0.05), 0.5, 0.5, 0.008, 0.1, 300)
        time.sleep(0.01)
    said: Said = {"servo": fresh(receive, faults).getActualQ()[0]}
    control.servoStop(10.0)
    control.speedJ([0.2, 0.0, 0.0, 0.0, 0.0, 0.0], 5.0, 0.0)
    time.sleep(0.3)
    said["joint_rate"] = fresh(receive, faults).getActualQd()
    control.speedStop(10.0)
    control.speedL([0.0, 0.0, 0.05, 0.0, 0.0, 0.0], 5.0, 0.0)
    time.sleep(0.3)
    said["tool_rate"] = fresh(receive, faults).getActualTCPSpeed()
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
    until(lambda: receive.getActualDigitalInputBits() == 1 << 5)
    until(lambda: receive.getTargetSpeedFraction() == 0.4)
    said: Said = {
        "outputs": receive.getActualDigitalOutputBits(),
        "analog": receive.getStandardAnalogOutput0(),
        "fraction": receive.getTargetSpeedFraction(),
    }
    out.setSpeedSlider(1.0)
    until(lambda: receive.getTargetSpeedFraction() == 1.0)
    out.disconnect()
    receive.disconnect()
    return said


def custom_script(host: str, faults: ControlClient) -> Said:
    """A program of the client's own, then the control script again."""
    receive, control = both(host)
    body = f"\tmovej({turned(0.1)}, a=10.0, v=3.0)\n"
    said: Said = {"ran": control.sendCustomScriptFunction("own", body)}
    said["joints"] = fresh(receive, faults).getActualQ()
    # The client comes back as soon as its script was sent, not when it runs.
    until(control.isProgramRunning)
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
        "bad": raised(lambda: client.loadURP("x.txt")),
        "unplayable": raised(client.play),
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
    until(lambda: "IDLE" in client.robotmode())
    client.brakeRelease()
    until(lambda: "RUNNING" in client.robotmode())
    client.restartSafety()
    said["restarted"] = client.robotmode()
    client.brakeRelease()
    until(lambda: "RUNNING" in client.robotmode())
    client.quit()
    return said


def version_smoke(host: str, faults: ControlClient) -> Said:
    """A move and a question, whatever the controller."""
    receive, control = both(host)
    said: Said = {
        "moved": control.moveJ(THERE, 3.0, 10.0),
        "joints": fresh(receive, faults).getActualQ(),
        "tcp": control.getTCPOffset(),
    }
    return said


if __name__ == "__main__":
    main(globals())
