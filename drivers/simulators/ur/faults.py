"""Verbs of the private fault channel."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Mapping
from typing import cast

from drivers.simulators.control import Verb, answer
from drivers.simulators.line_server import LOOPBACK
from drivers.simulators.ur.safety import RobotMode
from drivers.simulators.ur.server import RTDE_PORT, Controller
from drivers.simulators.ur.sessions import RtdeSession

Asked = Mapping[str, object]


def verbs(controller: Controller) -> dict[str, Verb]:
    """Everything that can be done to a controller from outside its wires.

    ========================  ====================================================
    protective_stop           ``program``: pause or stop (default: as configured)
    safeguard_stop            the program waits
    emergency_stop            ``system``: of the system, not of the robot
    safety_fault              until ``restart safety``
    release                   of an emergency or safeguard stop
    unlock_delay              ``seconds``
    robot_mode                ``mode``: a name or number
    remote                    ``on``
    foreign_program           ``name``; ``keep_registers``: what the control program
                              said last stays in its output registers
    program_stop              the running program ends
    reject_scripts            ``on``: uploads are ignored
    slider                    ``fraction``
    in_use                    ``names``: inputs that a field bus has taken; [] frees
    digital_input             ``bit``, ``on``
    identity                  ``serial``, ``model``
    retool                    ``tcp``: six numbers, m and rad; ``payload_kg``: as somebody
                              at the pendant would change them
    drop                      ``how``: fin or rst; ``what``: all, rtde, or ports
    silence                   ``on``: nothing is sent any more, connections stay
    mute                      ``types``: RTDE types that are not sent, as "VOISU";
                              ``dashboard``: no answers there
    slow                      ``delay_s``: everything is sent so much later
    freeze                    ``on``: the timestamp stands still
    inject                    ``hex``: these bytes go to every RTDE client
    refuse, listen            ``ports``: close or open them (default all)
    restart                   ``down_s``: gone, and back with the power off
    in                        ``seconds``, ``then``: another verb's line, later
    clear                     every disturbance of the wires ends
    state                     what it knows of itself
    ========================  ====================================================
    """
    table = {
        **_safety(controller),
        **_robot(controller),
        **_tool(controller),
        **_wires(controller),
    }

    def later(asked: Asked) -> None:
        then = dict(cast("Asked", asked["then"]))
        verb = table[str(then.pop("do"))]
        loop = asyncio.get_running_loop()
        loop.call_later(_float(asked, "seconds"), verb, then)

    return {**table, "in": later}


async def serve(controller: Controller, port: int) -> asyncio.Server:
    """Answer on 127.0.0.1, in the loop that the controller runs in."""
    table = verbs(controller)

    async def session(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        # A client that hangs up, or the end of the loop, is no event here.
        with contextlib.suppress(ConnectionError, ValueError, asyncio.CancelledError):
            while line := await reader.readline():
                writer.write(answer(line, table))
        writer.close()

    return await asyncio.start_server(session, LOOPBACK, port)


def _safety(controller: Controller) -> dict[str, Verb]:
    robot = controller.robot
    safety = robot.safety

    def protective_stop(asked: Asked) -> None:
        program = asked.get("program")
        if program not in (None, "pause", "stop"):
            raise ValueError("program is pause or stop")
        safety.protective_stop(program)

    def unlock_delay(asked: Asked) -> None:
        safety.unlock_delay_s = _float(asked, "seconds")

    def robot_mode(asked: Asked) -> None:
        mode = asked["mode"]
        power = (
            RobotMode[mode] if isinstance(mode, str) else RobotMode(cast("int", mode))
        )
        if power != RobotMode.RUNNING:
            robot.end_program(f"robot mode {power.name}")
            robot.arm.drop()
        safety.set_power(power)

    return {
        "protective_stop": protective_stop,
        "safeguard_stop": lambda _: safety.safeguard_stop(),
        "emergency_stop": lambda asked: safety.emergency_stop(
            system=bool(asked.get("system", False))
        ),
        "safety_fault": lambda _: safety.fault(),
        "release": lambda _: safety.release(),
        "unlock_delay": unlock_delay,
        "robot_mode": robot_mode,
    }


def _robot(controller: Controller) -> dict[str, Verb]:
    robot = controller.robot

    def remote(asked: Asked) -> None:
        robot.remote = _on(asked)

    def foreign_program(asked: Asked) -> None:
        if not robot.play_foreign(str(asked.get("name", "pendant.urp"))):
            raise ValueError("no program can run now")
        if not asked.get("keep_registers", False):
            robot.registers.out_int[:] = [0] * len(robot.registers.out_int)

    def reject_scripts(asked: Asked) -> None:
        robot.rejects_scripts = _on(asked)

    def slider(asked: Asked) -> None:
        robot.registers.slider = min(max(_float(asked, "fraction"), 0.0), 1.0)

    def in_use(asked: Asked) -> None:
        robot.owners.reserved = {
            str(name) for name in cast("list[str]", asked["names"])
        }

    def digital_input(asked: Asked) -> None:
        bit = 1 << int(_float(asked, "bit"))
        kept = robot.registers.digital_inputs & ~bit
        robot.registers.digital_inputs = kept | (bit if _on(asked) else 0)

    def identity(asked: Asked) -> None:
        robot.serial = str(asked.get("serial", robot.serial))
        robot.model = str(asked.get("model", robot.model))

    return {
        "remote": remote,
        "foreign_program": foreign_program,
        "program_stop": lambda _: robot.end_program("stopped on the pendant"),
        "reject_scripts": reject_scripts,
        "slider": slider,
        "in_use": in_use,
        "digital_input": digital_input,
        "identity": identity,
        "state": lambda _: state(controller),
    }


def _tool(controller: Controller) -> dict[str, Verb]:
    robot = controller.robot

    def retool(asked: Asked) -> None:
        tcp = tuple(float(value) for value in cast("list[float]", asked.get("tcp", [])))
        if tcp and (len(tcp) != 6 or not all(map(math.isfinite, tcp))):
            raise ValueError("tcp is six finite numbers")
        robot.tcp = tcp or robot.tcp
        robot.payload_kg = _float(asked, "payload_kg", robot.payload_kg)

    return {"retool": retool}


def _wires(controller: Controller) -> dict[str, Verb]:
    disturbance, robot = controller.disturbance, controller.robot

    def drop(asked: Asked) -> dict[str, object]:
        what = asked.get("what", "all")
        chosen = {"all": (), "rtde": (RTDE_PORT,)}
        ports = chosen[what] if isinstance(what, str) else _ports({"ports": what})
        reset = asked.get("how", "fin") == "rst"
        return {"dropped": controller.drop(ports, reset=reset)}

    def silence(asked: Asked) -> None:
        disturbance.silent = _on(asked)

    def mute(asked: Asked) -> None:
        disturbance.muted = frozenset(map(ord, str(asked.get("types", ""))))
        disturbance.dashboard_muted = bool(asked.get("dashboard", False))

    def slow(asked: Asked) -> None:
        disturbance.delay_s = max(0.0, _float(asked, "delay_s"))

    def freeze(asked: Asked) -> None:
        robot.frozen_s = robot.timestamp_s if _on(asked) else None

    def inject(asked: Asked) -> None:
        data = bytes.fromhex(str(asked["hex"]))
        for session in controller.sessions:
            if isinstance(session, RtdeSession):
                session.line.send(data)

    def clear(_: Asked) -> None:
        disturbance.silent = disturbance.dashboard_muted = False
        disturbance.muted, disturbance.delay_s = frozenset(), 0.0
        robot.frozen_s, robot.rejects_scripts = None, False
        robot.owners.reserved = set()
        controller.listen_soon()

    return {
        "drop": drop,
        "silence": silence,
        "mute": mute,
        "slow": slow,
        "freeze": freeze,
        "inject": inject,
        "clear": clear,
        "refuse": lambda asked: controller.refuse(*_ports(asked)),
        "listen": lambda asked: controller.listen_soon(*_ports(asked)),
        "restart": lambda asked: _restart(controller, _float(asked, "down_s", 1.0)),
    }


def state(controller: Controller) -> dict[str, object]:
    """What the robot is, does, and was told."""
    robot = controller.robot
    return {
        "host": controller.host,
        "profile": robot.profile.key,
        "joints": robot.arm.joints.tolist(),
        "rates": robot.arm.rate.tolist(),
        "standing": robot.arm.standing,
        "idle": robot.arm.idle,
        "moves_begun": robot.arm.begun,
        "robot_mode": robot.safety.power.name,
        "safety_mode": robot.safety.mode.name,
        "runtime_state": robot.state.name,
        "program": robot.program.name if robot.program else None,
        "scripts": robot.scripts,
        "endings": list(robot.endings),
        "commands": list(robot.commands),
        "slider": robot.registers.slider,
        "tcp": list(robot.tcp),
        "payload_kg": robot.payload_kg,
        "payload_centre_m": list(robot.payload_centre_m),
        "digital_outputs": robot.registers.digital_outputs,
        "remote": robot.remote,
        "time_s": robot.now_s,
        "connections": sorted(session.line.port for session in controller.sessions),
    }


def _restart(controller: Controller, down_s: float) -> None:
    """Switch the controller off and on: programs, settings and connections are gone."""
    robot = controller.robot
    controller.refuse()
    controller.drop(reset=True)
    robot.end_program("restarted")
    robot.safety.restart()
    robot.registers.in_int[:] = [0] * len(robot.registers.in_int)
    robot.registers.out_int[:] = [0] * len(robot.registers.out_int)
    robot.tcp = (0.0,) * 6
    asyncio.get_running_loop().call_later(down_s, controller.listen_soon)


def _on(asked: Asked) -> bool:
    return bool(asked.get("on", True))


def _float(asked: Asked, key: str, default: float | None = None) -> float:
    value = asked[key] if default is None else asked.get(key, default)
    number = float(cast("float", value))
    if not math.isfinite(number):
        raise ValueError(f"{key} is not finite")
    return number


def _ports(asked: Asked) -> tuple[int, ...]:
    return tuple(int(port) for port in cast("list[int]", asked.get("ports", [])))
