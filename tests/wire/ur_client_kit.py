"""What the scenarios of the real client library share; plays one of them."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from typing import cast

import numpy as np
from dashboard_client import DashboardClient
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

from drivers.simulators.control import ControlClient

Said = dict[str, object]
HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
THERE = [0.2, -1.4, 1.5, -1.57, -1.57, 0.1]
HZ = 125.0
Scenario = Callable[[str, ControlClient], Said]


def both(host: str) -> tuple[RTDEReceiveInterface, RTDEControlInterface]:
    return RTDEReceiveInterface(host, HZ), RTDEControlInterface(host, HZ)


def fresh(receive: RTDEReceiveInterface, faults: ControlClient) -> RTDEReceiveInterface:
    """The receiver, once it has seen what is true now: two links, two delays."""
    now = float(str(faults.do("state")["time_s"]))
    until(lambda: receive.getTimestamp() >= now)
    return receive


def power_up(host: str, faults: ControlClient, *, release: bool = True) -> list[str]:
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
    until(lambda: "IDLE" in client.robotmode())
    seen.append(client.robotmode())
    client.brakeRelease()
    until(lambda: "RUNNING" in client.robotmode())
    client.disconnect()
    return seen


def turned(base_rad: float) -> list[float]:
    return [base_rad, *HOME[1:]]


def off(here: object, there: object) -> float:
    return float(np.abs(np.array(here) - np.array(there)).max())


def raised(call: Callable[[], object]) -> str:
    try:
        return f"returned {call()}"
    except RuntimeError as error:
        return str(error)


def sampled(read: Callable[[], object], seconds: float) -> Iterator[object]:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        yield read()
        time.sleep(0.0005)


def until(condition: Callable[[], bool], seconds: float = 15.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            raise TimeoutError("it never came to be")
        time.sleep(0.002)


def waited(condition: Callable[[], bool]) -> float:
    began = time.monotonic()
    until(condition)
    return time.monotonic() - began


def main(scenarios: Mapping[str, object]) -> None:
    """Play one scenario, as ``SCENARIO HOST CONTROL_PORT`` say; print its JSON."""
    name, host, port = sys.argv[1:]
    with ControlClient(int(port)) as faults:
        said = cast("Scenario", scenarios[name])(host, faults)
        sys.stdout.write(json.dumps(said) + "\n")
    sys.stdout.flush()
    # The library's own farewell takes half a second per object.
    os._exit(0)
