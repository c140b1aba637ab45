"""The controller on its sockets: real time, ports, and the report to the world."""

from __future__ import annotations

import asyncio
import logging
import queue
import threading
import time
from typing import TYPE_CHECKING

from drivers.simulators.ur.sessions import (
    DashboardSession,
    Disturbance,
    Line,
    RtdeSession,
    ScriptSession,
    Session,
)
from drivers.simulators.ur.telemetry import Telemetry

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.simulators.ur.robot import Robot
    from drivers.simulators.world_port import WorldPort

_LOG = logging.getLogger(__name__)
DASHBOARD_PORT = 29999
RTDE_PORT = 30004
SCRIPT_PORTS = (30001, 30002, 30003)
_CATCH_UP_S = 0.5
_REPORT_S = 0.008


class WorldReporter:
    """Tells the world where the arm is, from a thread of its own.

    While the arm moves at least every 8 ms, and once where it starts and stands.
    """

    def __init__(self, world: WorldPort) -> None:
        self._world = world
        self._queue: queue.SimpleQueue[tuple[float, list[float]] | None] = (
            queue.SimpleQueue()
        )
        self._thread = threading.Thread(target=self._run, name="world-reports")
        self._last_s = -1.0
        self._stood = False
        self._before: tuple[float, list[float]] | None = None
        self._thread.start()

    def see(self, t_s: float, joints: list[float], *, standing: bool) -> None:
        """The state after a cycle, at a monotonic time."""
        if standing and self._stood:
            self._before = (t_s, joints)
            return
        if self._stood and self._before is not None:
            self._queue.put(self._before)
        if standing or self._stood or t_s - self._last_s >= _REPORT_S:
            self._queue.put((t_s, joints))
            self._last_s = t_s
        self._stood = standing

    def close(self) -> None:
        """End the thread."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (report := self._queue.get()) is not None:
            try:
                self._world.report_arm(*report)
            except OSError:
                _LOG.warning("the world does not listen any more")
                return


class Controller:
    """A robot on the genuine ports of one address.

    Args:
        robot: what is behind them.
        host: address to bind, exactly.
        world: who is told where the arm is.
    """

    def __init__(self, robot: Robot, host: str, world: WorldPort | None = None) -> None:
        self.robot = robot
        self.host = host
        self.disturbance = Disturbance()
        self.sessions: set[Session] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._telemetry = Telemetry(robot)
        self._servers: dict[int, asyncio.Server] = {}
        self._reporter = WorldReporter(world) if world else None

    @property
    def ports(self) -> tuple[int, ...]:
        """The ports of this generation."""
        dashboard = (DASHBOARD_PORT,) if self.robot.profile.has_dashboard else ()
        return (*dashboard, *SCRIPT_PORTS, RTDE_PORT)

    async def listen(self, *ports: int) -> None:
        """Open ports, all of them when none is named.

        Raises:
            OSError: one of them is taken.
        """
        loop = asyncio.get_running_loop()
        try:
            for port in ports or self.ports:
                if port not in self._servers:
                    self._servers[port] = await loop.create_server(
                        self._factory(port), self.host, port, backlog=50
                    )
        except OSError:
            self.refuse()
            raise

    def listen_soon(self, *ports: int) -> None:
        """Open ports as soon as the loop comes round; a taken port is only logged."""
        task = asyncio.get_running_loop().create_task(self.listen(*ports))
        self._tasks.add(task)
        task.add_done_callback(self._listened)

    def refuse(self, *ports: int) -> None:
        """Close listening ports, all of them when none is named."""
        for port in ports or tuple(self._servers):
            server = self._servers.pop(port, None)
            if server is not None:
                server.close()

    def drop(self, ports: tuple[int, ...] = (), *, reset: bool = False) -> int:
        """Break connections; how many there were."""
        lines = [s.line for s in self.sessions if not ports or s.line.port in ports]
        for line in lines:
            line.drop(reset=reset)
        return len(lines)

    def _listened(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and task.exception() is not None:
            _LOG.error("cannot listen again: %s", task.exception())

    async def run(self) -> None:
        """Keep the control cycle, in step with the wall; ends when cancelled."""
        start, first = time.monotonic(), self.robot.cycle
        cycle_s = self.robot.cycle_s
        while True:
            due = start + (self.robot.cycle + 1 - first) * cycle_s
            now = time.monotonic()
            if now - due > _CATCH_UP_S:
                start += now - due
            elif now < due:
                await asyncio.sleep(due - now)
            else:
                await asyncio.sleep(0)
            self._cycle(start + (self.robot.cycle + 1 - first) * cycle_s)

    def close(self) -> None:
        """Close ports and connections."""
        self.refuse()
        self.drop()
        if self._reporter is not None:
            self._reporter.close()

    def _cycle(self, t_s: float) -> None:
        robot = self.robot
        robot.tick()
        if self._reporter is not None:
            arm = robot.arm
            self._reporter.see(t_s, arm.joints.tolist(), standing=arm.standing)
        for session in tuple(self.sessions):
            session.each_cycle()

    def _factory(self, port: int) -> Callable[[], Session]:
        robot, sessions = self.robot, self.sessions

        def session() -> Session:
            line = Line(port, self.disturbance)
            if port == RTDE_PORT:
                return RtdeSession(robot, line, sessions, self._telemetry)
            if port == DASHBOARD_PORT:
                return DashboardSession(robot, line, sessions)
            return ScriptSession(robot, line, sessions)

        return session


async def listen_somewhere(controller: Controller, hosts: list[str]) -> None:
    """Listen on the first address whose ports are all free.

    Raises:
        OSError: there is none.
    """
    last = OSError("no address to listen on")
    for host in hosts:
        controller.host = host
        try:
            await controller.listen()
        except OSError as error:
            last = error
        else:
            return
    raise last
