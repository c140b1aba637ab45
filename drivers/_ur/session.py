"""A connection to one robot: who it is, whether it is ready, and every way to stop it."""

from __future__ import annotations

import contextlib
import logging
import threading
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

from drivers._ur.codes import PLAYING, STOPPED, robot_trouble, trouble
from drivers._ur.dashboard import Dashboard
from drivers._ur.last_word import leave_end_of_program
from drivers._ur.messages import STARTED_AGAIN
from drivers._ur.process import COMMAND, WorkerProcess
from drivers._ur.same import differ, same_model, same_pose
from drivers._ur.script_port import send_brake
from drivers._ur.status import Status
from drivers._ur.version import Version, ask_version
from mvp.errors import DeviceError, DeviceTimeout, LinkLost

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers._ur.config import UrArmConfig
    from drivers._ur.process import Pending
    from mvp.devices import Clock

_LOG = logging.getLogger(__name__)
QUERY_S = 1.0
_STOP_S = 0.3
_LEAVE_S = 3.0
_READ_BACK_S = 3.0
_ENDING_S = 0.5
_POLL_S = 0.01
_DASHBOARD_LESS = 10  # PolyScope X
_PAYLOAD_TOLERANCE = 1e-3  # kg and m


@dataclass(frozen=True)
class Identity:
    """Who answers; empty where this controller does not tell."""

    model: str
    serial: str
    version: Version

    @property
    def firmware(self) -> str:
        """As people write it."""
        return ".".join(map(str, self.version))


class Session:
    """One robot, connected or not; every wait has an end.

    Args:
        config: of the arm.
        clock: real time.
        name: of the device, for errors.
        command: what to start as worker.
    """

    def __init__(
        self,
        config: UrArmConfig,
        clock: Clock,
        name: str,
        *,
        command: Sequence[str] = COMMAND,
    ) -> None:
        self.config = config
        self.name = name
        self._clock = clock
        self._command = command
        self._worker: WorkerProcess | None = None
        self._never = threading.Event()
        self._ours_may_run = False
        self.identity = Identity("", "", (0, 0, 0, 0))

    @property
    def alive(self) -> bool:
        """Whether a worker is connected."""
        return self._worker is not None and self._worker.alive

    def connect(self) -> None:
        """Full handshake: identity, state, control program, tool. Nothing moves.

        Raises:
            ConnectError, DeviceTimeout, LinkLost, WireError: no sound connection.
            DeviceFault: connected, but not ready; with a code and what to do.
        """
        self._drop()
        version = self.find_version()
        self._require_drivable(version)
        self.identity = self._identify(version)
        self._worker = WorkerProcess(self.name, self._clock, command=self._command)
        try:
            self._worker.wait_started()
            self._handshake(version)
        except BaseException:
            self.disconnect()
            raise

    def find_version(self) -> Version:
        """Ask for the controller's version and remember it.

        Raises:
            ConnectError, DeviceTimeout, LinkLost, WireError: no answer that is one.
        """
        version = ask_version(self.config.host, name=self.name, clock=self._clock)
        self.identity = replace(self.identity, version=version)
        return version

    def disconnect(self) -> None:
        """Leave the robot standing, without our program; safe to repeat."""
        worker, self._worker = self._worker, None
        if worker is None:
            return
        left = worker.close(
            timeout_s=_LEAVE_S, deceleration_rad_s2=self.config.stop_rad_s2
        )
        if self._ours_may_run:
            self._ours_may_run = not (left or self.end_program())

    def status(self) -> Status:
        """The robot now.

        Raises:
            LinkLost: the worker is gone.
            DeviceTimeout: what it last said is too old; it is killed.
        """
        found, age_s = self._connected.status()
        if age_s > self.config.data_timeout_s:
            self._connected.kill(f"no new data for {age_s:.1f} s")
            raise DeviceTimeout(
                f"the controller has said nothing for {age_s:.1f} s",
                device=self.name,
                hint="check the network; `mvp-cell check CELL` connects anew",
            )
        return found

    def age_s(self) -> float:
        """Age of the newest data."""
        return self._connected.status()[1]

    def move(self, target_rad: Sequence[float], speed_rad_s: float) -> Pending:
        """Hand over one motion; returns at once."""
        return self._connected.post(
            "move",
            target_rad=list(target_rad),
            speed_rad_s=speed_rad_s,
            acceleration_rad_s2=self.config.acceleration_rad_s2,
        )

    def ended(self, pending: Pending) -> str:
        """How a motion ended: finished, stopped, refused, or retooled: it never began."""
        return str(self._connected.result(pending)["ended"])

    def brake(self) -> str:
        """Stop the motion by every way that is left; in words, which one worked.

        Raises:
            LinkLost: none did.
        """
        with contextlib.suppress(DeviceError):
            if self.alive:
                decel = self.config.stop_rad_s2
                self._connected.request(
                    "stop", timeout_s=_STOP_S, deceleration_rad_s2=decel
                )
                return "it was told to stop"
        if self.has_dashboard:
            if self.end_program():
                return "its program was stopped through the dashboard"
        elif self._send_brake():
            return (
                "a program that only brakes was sent in place of its own; it may go on "
                "if it did not take that up"
            )
        raise LinkLost(
            "no way to the robot is left; it may go on until its motion is done",
            device=self.name,
            hint="stop it on the pendant or with the emergency stop",
        )

    def abandon(self) -> bool:
        """Make sure that nobody can let an interrupted motion go on; whether it is sure."""
        with contextlib.suppress(DeviceError):
            self.brake()
        ended = self.end_program()
        if ended or self._worker is None:
            return ended
        over = self._is_over()
        left = self._worker.close(
            timeout_s=_LEAVE_S, deceleration_rad_s2=self.config.stop_rad_s2
        )
        return left or over or self._leave_word()

    def _leave_word(self) -> bool:
        """A program that waits finds its end first; whether it will cannot be seen."""
        done = leave_end_of_program(
            self.config.host,
            name=self.name,
            clock=self._clock,
            upper=self.config.upper_registers,
        )
        told = "is told to end as soon as it can" if done else "cannot be told to end"
        _LOG.warning("%s: the program on the robot %s", self.name, told)
        return False

    def end_program(self) -> bool:
        """End whatever program runs; False where that failed or cannot be seen."""
        if not self.has_dashboard:
            return self._send_brake() and self._seen_ended()
        try:
            return self.dashboard().end_program()
        except DeviceError as error:
            _LOG.warning("%s: %s", self.name, error.detail)
            return False

    def replace_program(self) -> str:
        """End whatever runs without a dashboard; in words, what was done.

        Raises:
            ConnectError: the controller takes no program.
        """
        send_brake(self.config.host, self.config.stop_rad_s2, name=self.name)
        return "a program that only brakes was sent"

    def _send_brake(self) -> bool:
        """PolyScope X: a program that only brakes takes the place of another."""
        try:
            self.replace_program()
        except DeviceError as error:
            _LOG.warning("%s: %s", self.name, error.detail)
            return False
        return True

    def _is_over(self) -> bool:
        """Whether the robot says that no program runs or waits."""
        try:
            return self.status().runtime_state == STOPPED
        except DeviceError:
            return False

    def _seen_ended(self) -> bool:
        """Whether our program was seen to end; the one in its place runs for a moment."""
        deadline = self._clock.now_s() + QUERY_S
        while self._clock.now_s() < deadline:
            try:
                if self.status().runtime_state == STOPPED:
                    return True
            except DeviceError as error:
                return STARTED_AGAIN in error.message
            self._clock.wait(self._never, _POLL_S)
        return False

    def dashboard(self) -> Dashboard:
        """A connection of its own to the dashboard."""
        return Dashboard(self.config.host, name=self.name, clock=self._clock)

    @property
    def has_dashboard(self) -> bool:
        """PolyScope X has none."""
        return self.identity.version[0] < _DASHBOARD_LESS

    @property
    def _connected(self) -> WorkerProcess:
        if self._worker is None:
            raise LinkLost(
                "not connected to the robot", device=self.name, hint="call open() first"
            )
        return self._worker

    def _drop(self) -> None:
        """Put away what a lost connection has left, its program on the robot too."""
        self.disconnect()
        if self._ours_may_run:
            self._ours_may_run = not self.end_program()

    def _require_drivable(self, version: Version) -> None:
        if (10, 0) <= version[:2] < (10, 10):
            raise trouble("version", f"{version[0]}.{version[1]}").fault(self.name)
        if self.config.upper_registers and version[:2] >= (5, 23):
            raise trouble("upper-registers").fault(self.name)

    def _identify(self, version: Version) -> Identity:
        """Ask who it is, and whether programs from outside may drive it."""
        if version[0] >= _DASHBOARD_LESS:
            if self.config.serial:
                detail = "this controller does not tell its serial number"
                raise trouble("wrong-robot", detail).fault(self.name)
            return Identity(self.config.model, "unknown", version)
        with self.dashboard() as dashboard:
            model = dashboard.value("get robot model")
            serial = "unknown"
            if version[:2] >= (5, 6):
                serial = dashboard.value("get serial number")
            self._require_same(model, serial)
            if version[:2] >= (5, 6):
                remote = dashboard.value("is in remote control")
                if "true" not in remote.lower():
                    raise trouble("local-mode").fault(self.name)
        return Identity(model, serial, version)

    def _require_same(self, model: str, serial: str) -> None:
        expected = self.config.serial
        if expected and serial != expected:
            detail = f"serial {serial}, not {expected}"
            raise trouble("wrong-robot", detail).fault(self.name)
        if model and not same_model(model, self.config.model):
            detail = f"{model}, not {self.config.model}"
            raise trouble("wrong-robot", detail).fault(self.name)

    def _handshake(self, version: Version) -> None:
        whole_s = self.config.handshake_timeout_s
        deadline = self._clock.now_s() + whole_s
        where = {"host": self.config.host, "frequency_hz": self._frequency(version)}
        payload = (3, 11) <= version[:2] < (5, 0) or version[:3] >= (5, 5, 1)
        said = self._connected.request(
            "listen",
            timeout_s=whole_s,
            payload=payload,
            silent_s=self.config.data_timeout_s,
            **where,
        )
        status = Status.from_wire(cast("dict[str, object]", said["status"]))
        if found := robot_trouble(status):
            raise found.fault(self.name)
        self._require_no_program()
        self._ours_may_run = True
        left_s = max(QUERY_S, deadline - self._clock.now_s())
        self._connected.request(
            "control", timeout_s=left_s, flags=self._flags(), **where
        )
        self._wait_playing(deadline)
        self._set_tool(payload=payload)

    def _require_no_program(self) -> None:
        deadline = self._clock.now_s() + _ENDING_S
        while self.status().runtime_state != STOPPED:
            if self._clock.now_s() > deadline:
                raise trouble("foreign-program", self._program()).fault(self.name)
            self._clock.wait(self._never, _POLL_S)

    def _frequency(self, version: Version) -> float:
        """CB3 controllers work at 125 Hz."""
        return min(self.config.frequency_hz, 125.0 if version[0] < 5 else 500.0)

    def _flags(self) -> list[str]:
        flags = []
        if self.config.upper_registers:
            flags.append("FLAG_UPPER_RANGE_REGISTERS")
        if self.config.no_ext_ft:
            flags.append("FLAG_NO_EXT_FT")
        return flags

    def _program(self) -> str:
        """What the dashboard calls the program that runs."""
        if not self.has_dashboard:
            return ""
        with contextlib.suppress(DeviceError), self.dashboard() as dashboard:
            return dashboard.ask("programState")
        return ""

    def _wait_playing(self, deadline: float) -> None:
        """The two connections are not quite in step."""
        while self.status().runtime_state != PLAYING:
            if self._clock.now_s() > deadline:
                raise trouble("script-rejected").fault(self.name)
            self._clock.wait(self._never, _POLL_S)

    def _set_tool(self, *, payload: bool) -> None:
        """Set tool point and payload, and believe only what is read back."""
        config = self.config
        said = self._connected.request(
            "tool",
            timeout_s=2 * QUERY_S,
            tcp_m_rad=config.tcp_m_rad,
            payload_kg=config.payload_kg,
            payload_cog_m=config.payload_cog_m,
        )
        found = cast("list[float]", said["tcp_m_rad"])
        if not same_pose(found, config.tcp_m_rad):
            raise trouble("tool-differs", f"tool point {found}").fault(self.name)
        deadline = self._clock.now_s() + _READ_BACK_S
        while payload and self.payload_differs(self.status()):
            if self._clock.now_s() > deadline:
                raise trouble("tool-differs", "payload").fault(self.name)
            self._clock.wait(self._never, _POLL_S)

    def payload_differs(self, status: Status) -> bool:
        """Whether the controller works with another payload; False where unknown."""
        if status.payload_kg is None or status.payload_cog_m is None:
            return False
        found = [status.payload_kg, *status.payload_cog_m]
        asked = [self.config.payload_kg, *self.config.payload_cog_m]
        return differ(found, asked, _PAYLOAD_TOLERANCE)
