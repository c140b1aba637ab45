"""Clients of the real library in trouble: they may crash or hang.

Usage: ``python FILE SCENARIO HOST CONTROL_PORT``; prints one JSON document.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from dashboard_client import DashboardClient
from rtde_control import RTDEControlInterface
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
    power_up,
    raised,
    sampled,
    turned,
    until,
    waited,
)

if TYPE_CHECKING:
    from drivers.simulators.control import ControlClient

UPPER_RANGE = 0x08


def protective_stop(host: str, faults: ControlClient) -> Said:
    """In the middle of a move; then the way back."""
    said: Said = {}
    for program in ("pause", "stop"):
        said[program] = _stopped(host, faults, program)
    return said


def _stopped(host: str, faults: ControlClient, program: str) -> Said:
    receive, control = both(host)
    control.moveJ(HOME, 3.0, 10.0)
    before = control.getAsyncOperationProgressEx().operationId()
    control.moveJ(turned(2.0), 0.5, 2.0, True)
    until(lambda: control.getAsyncOperationProgressEx().operationId() != before)
    time.sleep(0.1)
    faults.do("unlock_delay", seconds=0.2)
    faults.do("protective_stop", program=program)
    until(receive.isProtectiveStopped)
    said: Said = {
        "modes": [receive.getRobotMode(), receive.getSafetyMode()],
        "bits": receive.getSafetyStatusBits(),
        "state": receive.getRuntimeState(),
        "move": control.moveJ(HOME, 1.0, 2.0),
        "steady": control.isSteady(),
        "raised": raised(control.getTCPOffset),
    }
    until(lambda: not any(receive.getActualQd()))
    stands = fresh(receive, faults).getActualQ()
    dashboard = DashboardClient(host)
    dashboard.connect()
    faults.do("protective_stop", program=program)
    said["early"] = raised(dashboard.unlockProtectiveStop)
    time.sleep(0.3)
    dashboard.unlockProtectiveStop()
    until(lambda: not receive.isProtectiveStopped())
    time.sleep(0.1)
    said["crept"] = off(receive.getActualQ(), stands)
    said["after"] = control.moveJ(HOME, 1.0, 2.0)
    said["uploaded"] = control.reuploadScript()
    until(control.isProgramRunning)
    said["again"] = control.moveJ(HOME, 3.0, 10.0)
    dashboard.disconnect()
    return said


def blocking_move_stopped(host: str, faults: ControlClient) -> Said:
    """A protective stop, then an emergency stop, while a blocking call waits."""
    said: Said = {}
    for kind in ("protective_stop", "emergency_stop"):
        receive, control = both(host)
        control.moveJ(HOME, 3.0, 10.0)
        faults.do("in", seconds=0.3, then={"do": kind})
        moved = control.moveJ(turned(3.0), 0.3, 2.0)
        until(lambda receive=receive: receive.getSafetyStatusBits() != 1)
        said[kind] = [
            moved,
            receive.getSafetyStatusBits(),
            receive.isEmergencyStopped(),
        ]
        control.disconnect()
        power_up(host, faults)
    return said


def emergency_stop(host: str, faults: ControlClient) -> Said:
    """Pressed in the middle of a move; power comes back step by step."""
    receive, control = both(host)
    control.moveJ(HOME, 3.0, 10.0)
    control.moveJ(turned(2.0), 0.5, 2.0, True)
    time.sleep(0.15)
    faults.do("emergency_stop")
    until(lambda: receive.getRobotMode() == 3)
    said: Said = {
        "safety": receive.getSafetyMode(),
        "bits": receive.getSafetyStatusBits(),
        "state": receive.getRuntimeState(),
        "move": control.moveJ(HOME, 1.0, 2.0),
        "rates": receive.getActualQd(),
    }
    said["power"] = power_up(host, faults)
    said["uploaded"] = control.reuploadScript()
    until(control.isProgramRunning)
    said["again"] = control.moveJ(HOME, 3.0, 10.0)
    return said


def safeguard_stop(host: str, faults: ControlClient) -> Said:
    """The move waits and goes on by itself."""
    receive, control = both(host)
    control.moveJ(HOME, 3.0, 10.0)
    control.moveJ(turned(0.5), 0.5, 2.0, True)
    time.sleep(0.2)
    faults.do("safeguard_stop")
    until(lambda: receive.getRuntimeState() == 4 and not any(receive.getActualQd()))
    said: Said = {
        "bits": receive.getSafetyStatusBits(),
        "between": receive.getActualQ()[0],
    }
    faults.do("release")
    until(lambda: off(receive.getActualQ(), turned(0.5)) < 1e-9)
    said["state"] = receive.getRuntimeState()
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
    _receive, control = both(host)
    said["afterwards"] = control.moveJ(HOME, 3.0, 10.0)
    said["second"] = raised(lambda: RTDEControlInterface(host, HZ))
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
    _receive, control = both(host)
    said["afterwards"] = control.moveJ(HOME, 3.0, 10.0)
    return said


def _gives_up(host: str, faults: ControlClient, verb: str, arguments: Said) -> str:
    faults.do(verb, **arguments)
    time.sleep(0.05)
    said = raised(lambda: RTDEControlInterface(host, HZ))
    faults.do("clear")
    faults.do("remote", on=True)
    faults.do("robot_mode", mode="RUNNING")
    time.sleep(0.1)
    return said


def foreign_program(host: str, faults: ControlClient) -> Said:
    """A program of the pendant plays: the constructor stops it, after seconds."""
    faults.do("foreign_program")
    receive, control = both(host)
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
        said[how] = [waited(lambda r=receive: not r.isConnected())]
        said[f"{how} back"] = receive.reconnect() and receive.isConnected()
        receive.disconnect()
    receive = RTDEReceiveInterface(host, HZ)
    faults.do("silence")
    time.sleep(0.2)
    stamps = set(sampled(receive.getTimestamp, 0.3))
    said["silent"] = len(stamps)
    faults.do("silence", on=False)
    faults.do("freeze")
    time.sleep(0.2)
    said["frozen"] = len(set(sampled(receive.getTimestamp, 0.3)))
    faults.do("freeze", on=False)
    time.sleep(0.1)
    said["thawed"] = len(set(sampled(receive.getTimestamp, 0.3))) > 10
    faults.do("slow", delay_s=0.3)
    time.sleep(0.5)
    late = float(str(faults.do("state")["time_s"])) - receive.getTimestamp()
    said["late_s"] = late
    faults.do("clear")
    faults.do("restart", down_s=0.3)
    until(lambda: not receive.isConnected())
    said["down"] = raised(receive.reconnect)
    time.sleep(0.6)
    said["up"] = receive.reconnect()
    said["power"] = receive.getRobotMode()
    receive.disconnect()
    power_up(host, faults, release=False)
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


def upper_range(host: str, faults: ControlClient) -> Said:
    """The upper registers: the script and the client disagree from 5.23 on."""
    control = RTDEControlInterface(host, HZ, UPPER_RANGE | 0x01)
    return {"moved": control.moveJ(HOME, 3.0, 10.0)}


def watchdog(host: str, faults: ControlClient) -> Said:
    """A blocking move outlives a watchdog of 10 Hz and kills the program."""
    _receive, control = both(host)
    control.moveJ(HOME, 3.0, 10.0)
    control.setWatchdog(10.0)
    said: Said = {"move": control.moveJ(turned(1.0), 0.5, 2.0)}
    said["endings"] = faults.do("state")["endings"]
    return said


if __name__ == "__main__":
    main(globals())
