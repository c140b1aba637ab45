"""The client library's objects, each used the one way that is known to work.

Runs in the worker only. Constructors of the library hold the interpreter lock while
they wait for the network; an alarm of the operating system ends the process when they
never come back, and the driver notices.
"""

from __future__ import annotations

import signal
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol, cast

from drivers._ur.status import Implausible, Status

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

# Only names that the library's own table knows: it does not skip the bytes of others.
_VARIABLES = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "target_qd",
    "actual_TCP_pose",
    "robot_mode",
    "safety_mode",
    "safety_status_bits",
    "runtime_state",
    "robot_status_bits",
    "target_speed_fraction",
]
_PAYLOAD = ["payload", "payload_cog"]
_CONSTRUCTOR_S = 12
_START_S = 0.2
_POLL_S = 0.002
_SAME_FRAME_TRIES = 50


class _Receive(Protocol):
    def isConnected(self) -> bool: ...  # noqa: N802
    def disconnect(self) -> None: ...
    def getTimestamp(self) -> float: ...  # noqa: N802
    def getActualQ(self) -> list[float]: ...  # noqa: N802
    def getActualQd(self) -> list[float]: ...  # noqa: N802
    def getTargetQd(self) -> list[float]: ...  # noqa: N802
    def getActualTCPPose(self) -> list[float]: ...  # noqa: N802
    def getRobotMode(self) -> int: ...  # noqa: N802
    def getSafetyMode(self) -> int: ...  # noqa: N802
    def getSafetyStatusBits(self) -> int: ...  # noqa: N802
    def getRuntimeState(self) -> int: ...  # noqa: N802
    def getTargetSpeedFraction(self) -> float: ...  # noqa: N802
    def getPayload(self) -> float: ...  # noqa: N802
    def getPayloadCog(self) -> list[float]: ...  # noqa: N802


class _Operation(Protocol):
    def operationId(self) -> int: ...  # noqa: N802
    def isAsyncOperationRunning(self) -> bool: ...  # noqa: N802


class _Control(Protocol):
    def isConnected(self) -> bool: ...  # noqa: N802
    def isProgramRunning(self) -> bool: ...  # noqa: N802
    def moveJ(self, q: list[float], v: float, a: float, asyn: bool) -> bool: ...  # noqa: N802
    def stopJ(self, a: float) -> None: ...  # noqa: N802
    def stopScript(self) -> None: ...  # noqa: N802
    def setTcp(self, pose: list[float]) -> bool: ...  # noqa: N802
    def setPayload(self, mass: float, cog: list[float]) -> bool: ...  # noqa: N802
    def getTCPOffset(self) -> list[float]: ...  # noqa: N802
    def getAsyncOperationProgressEx(self) -> _Operation: ...  # noqa: N802


@contextmanager
def _ended_by_the_system(seconds: int) -> Iterator[None]:
    """Let the operating system end this process when the body never comes back."""
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)


class Listener:
    """The receiving side; for one thread."""

    def __init__(self, host: str, frequency_hz: float, *, payload: bool) -> None:
        """Connect.

        Raises:
            RuntimeError: nobody answers, or no data follow.
        """
        import rtde_receive

        self._payload = payload
        names = _VARIABLES + (_PAYLOAD if payload else [])
        with _ended_by_the_system(_CONSTRUCTOR_S):
            made = rtde_receive.RTDEReceiveInterface(host, frequency_hz, names)
        self._receive = cast("_Receive", made)
        if not self.connected:
            raise RuntimeError("the controller sends no data")

    @property
    def connected(self) -> bool:
        """What the library believes; up to 2.5 s late."""
        return self._receive.isConnected()

    def timestamp_s(self) -> float:
        """Of the newest frame."""
        return self._receive.getTimestamp()

    def status(self) -> Status:
        """The newest frame, whole.

        Raises:
            Implausible: nothing that a robot sends, or never twice the same frame.
        """
        for _ in range(_SAME_FRAME_TRIES):
            before = self.timestamp_s()
            found = self._read(before)
            if self.timestamp_s() == before:
                return found()
        raise Implausible("frames change while they are read")

    def _read(self, stamp_s: float) -> Callable[[], Status]:
        """The fields now; they are judged only when they belong to one frame."""
        r = self._receive
        payload = (r.getPayload(), tuple(r.getPayloadCog())) if self._payload else ()
        values = (
            stamp_s,
            tuple(r.getActualQ()),
            tuple(r.getActualQd()),
            tuple(r.getTargetQd()),
            tuple(r.getActualTCPPose()),
            r.getRobotMode(),
            r.getSafetyMode(),
            r.getSafetyStatusBits(),
            r.getRuntimeState(),
            r.getTargetSpeedFraction(),
        )
        return lambda: Status(*values, *payload)


class Mover:
    """The commanding side; for one thread, but ``connected`` may be read by another."""

    def __init__(self, host: str, frequency_hz: float, flags: Sequence[str]) -> None:
        """Connect and start the control program on the robot; nothing moves.

        Raises:
            RuntimeError: refused, with the library's words.
        """
        import rtde_control

        kind = rtde_control.RTDEControlInterface
        bits = int(kind.FLAG_UPLOAD_SCRIPT)
        for name in flags:
            bits |= int(getattr(kind, name))
        with _ended_by_the_system(_CONSTRUCTOR_S):
            self._control = cast("_Control", kind(host, frequency_hz, bits))
        if not self._control.isProgramRunning():
            raise RuntimeError("Failed to start control script: no program is running")

    @property
    def connected(self) -> bool:
        """What the library believes; it flickers while it reconnects by itself."""
        return self._control.isConnected()

    def set_tool(
        self, tcp_m_rad: list[float], mass_kg: float, cog_m: list[float]
    ) -> list[float]:
        """Set tool point and payload; the tool point as read back."""
        self._control.setTcp(tcp_m_rad)
        self._control.setPayload(mass_kg, cog_m)
        return self.tool()

    def tool(self) -> list[float]:
        """The tool point that the controller works with now; takes two of its cycles.

        Raises:
            RuntimeError: the program on the robot does not answer.
        """
        return list(self._control.getTCPOffset())

    def begin(self, target_rad: list[float], speed: float, acceleration: float) -> bool:
        """Hand over one motion, once; True when the robot has taken it up.

        Args:
            target_rad: (6,) joints.
            speed: rad/s of the leading axis.
            acceleration: rad/s^2 of the leading axis.
        """
        before = self._operation().operationId()
        if not self._control.moveJ(target_rad, speed, acceleration, True):
            return False
        # The running flag may lag behind the answer; the id tells a start for sure.
        end = time.monotonic() + _START_S
        while self._operation().operationId() == before and time.monotonic() < end:
            time.sleep(_POLL_S)
        return True

    def moving(self) -> bool:
        """Whether the motion handed over is still being carried out."""
        running = self._operation().isAsyncOperationRunning()
        return running and self._control.isProgramRunning()

    def brake(self, deceleration: float) -> None:
        """Stop along the joints, rad/s^2; comes back when it stands."""
        self._control.stopJ(deceleration)

    def end_program(self) -> None:
        """End the control program."""
        self._control.stopScript()

    def _operation(self) -> _Operation:
        return self._control.getAsyncOperationProgressEx()
