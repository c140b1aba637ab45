"""Universal Robots arms over RTDE, e-Series, CB3 and PolyScope X.

The client library runs in a process of its own (``drivers._ur``). Every request has a
deadline; a motion is handed over once, is watched from outside, and counts as done only
when the robot says so, stands still and stands where it should.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from drivers._ur.codes import robot_trouble, trouble
from drivers._ur.config import UrArmConfig
from drivers._ur.motion import Motions
from drivers._ur.recovery import recover
from drivers._ur.session import Session
from mvp.devices import (
    ArmState,
    DeviceContext,
    DeviceInfo,
    Link,
    Role,
    host_resource,
    require_real_time,
)
from mvp.errors import DeviceError, LimitError
from mvp.geometry import Pose
from mvp.kinematics import arm_model

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from drivers._ur.status import Status
    from mvp.devices import RecoveryStep
    from mvp.geometry import FloatArray

_LOG = logging.getLogger(__name__)
_SPARE_S = 5.0
_NOMINAL_MM = 30.0  # real arms differ from the nominal model by a few mm
_CALIBRATED_MM = 0.5


class UrArm:
    """One Universal Robots arm."""

    role: ClassVar[Role] = "arm"
    Config = UrArmConfig
    libraries: ClassVar[tuple[str, ...]] = ("ur-rtde",)

    def __init__(
        self, config: UrArmConfig, context: DeviceContext, name: str, session: Session
    ) -> None:
        clock = context.clock
        require_real_time(clock, name)
        self.name = name
        self._config = config
        self._folder = context.folder
        self._clock = clock
        self._model = config.arm
        self._session = session
        self._link = Link(
            name, clock, connect=self._connect, disconnect=session.disconnect
        )
        tcp = config.tcp_m_rad
        self._tcp_from_tool = Pose.from_rotvec(
            "tool", "tcp", tcp[3:], 1000 * np.array(tcp[:3])
        ).inverse()
        self._stops = 0
        self._motions = Motions(session, self._link, clock)

    @classmethod
    def from_config(
        cls, config: UrArmConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the device; no I/O.

        Raises:
            ConfigError: the cell's time is not real time.
        """
        return cls(config, context, name, Session(config, context.clock, name))

    def open(self) -> None:
        """Connect: identity, state, control program, tool and payload. Moves nothing.

        Raises:
            ConnectError, DeviceTimeout, LinkLost, WireError: no sound connection.
            DeviceFault: connected but not ready; ``code`` and ``hint`` say why.
        """
        if self._link.is_open and not self._session.alive:
            self._link.close()
        self._link.open()

    def close(self) -> None:
        """Disconnect; a motion is stopped and the program on the robot is ended."""
        self._link.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def info(self) -> DeviceInfo:
        """Identity and versions."""
        who = self._session.identity
        return DeviceInfo(
            self.name,
            "ur",
            who.model or self._config.model,
            who.serial or "unknown",
            who.firmware,
            simulated=False,
            extra={"host": self._config.host},
        )

    def resource(self) -> str:
        """The controller, by its address."""
        return host_resource("ur", self._config.host)

    def state(self) -> ArmState:
        """Where the controller says it is now.

        Raises:
            ConnectError: not open.
            LinkLost, DeviceTimeout: no current data.
        """
        self._link.require_open()
        return self._state_of(self._session.status())

    def check_joints(self, joints: Sequence[float]) -> None:
        """Raise ``LimitError`` when the target is outside the limits. Never moves."""
        self._checked(joints)

    def move_joints(
        self, joints: Sequence[float], *, speed_fraction: float = 1.0, timeout_s: float
    ) -> ArmState:
        """Move along a straight line in joint space; return where it stands.

        The deadline is the sooner of ``timeout_s`` and twice the planned time plus 5 s.

        Raises:
            LimitError: refused, nothing moved.
            DeviceTimeout: did not arrive in time, or fell silent; it has been stopped.
            DeviceFault: the robot reports a fault; it has been stopped.
            LinkLost: the link broke; the message says what was done.
            MotionStopped: ``stop`` was called.
        """
        self._link.require_open()
        stops = self._stops
        target = self._checked(joints)
        status = self._motions.ready()
        planned_s = self.duration_s(
            status.joints_rad, joints, speed_fraction=speed_fraction
        )
        speed = self._config.speed_rad_s * _fraction(speed_fraction)
        deadline_s = self._clock.now_s() + min(timeout_s, 2 * planned_s + _SPARE_S)
        _LOG.debug("%s: to %s at %.3f rad/s", self.name, target.tolist(), speed)
        reached = self._motions.carry_out(
            target, speed, deadline_s, stopped=lambda: self._stops != stops
        )
        return self._state_of(reached)

    def duration_s(
        self,
        start: Sequence[float],
        target: Sequence[float],
        *,
        speed_fraction: float = 1.0,
    ) -> float:
        """How long such a move takes, s: ramps and the speed slider included."""
        way = float(np.abs(np.subtract(target, start)).max())
        speed = self._config.speed_rad_s * _fraction(speed_fraction)
        ramp_s = speed / self._config.acceleration_rad_s2
        if way < speed * ramp_s:
            full = 2 * np.sqrt(way / self._config.acceleration_rad_s2)
        else:
            full = way / speed + ramp_s
        return float(full) / self._slider()

    def stop(self) -> None:
        """Brake now, from any thread.

        Raises:
            LinkLost: it is connected, and no way to stop it is left.
        """
        # Counted first: a motion that is only about to begin is refused then.
        self._stops += 1
        self._link.interrupt()
        if self._link.is_open:
            self._session.brake()

    def recovery(self) -> Iterator[RecoveryStep]:
        """The way back from where it is, step by step; see ``Recoverable``."""
        return recover(self._session, self._clock, close=self.close, open_=self._reopen)

    def _reopen(self) -> str:
        self.open()
        joints = ", ".join(f"{np.degrees(j):.1f}" for j in self.state().joints)
        return f"program runs, tool and payload read back, joints {joints} deg"

    def _connect(self) -> None:
        _LOG.warning("%s: this driver was not tried on hardware yet", self.name)
        self._session.connect()
        try:
            self._require_model()
        except BaseException:
            self._session.disconnect()
            raise

    def _require_model(self) -> None:
        """Another arm's kinematics would give another pose for the same joints."""
        model, far_mm, what = self._model, _NOMINAL_MM, f"a {self._model.name}"
        if self._config.dh_calibration:
            path = self._folder / self._config.dh_calibration
            model = arm_model(self._model.name, dh_calibration=path)
            far_mm, what = _CALIBRATED_MM, str(path)
        status = self._session.status()
        said = self._state_of(status).base_from_tool
        ours = model.forward(np.array(status.joints_rad)).matrix
        off_mm = float(np.linalg.norm(said[:3, 3] - ours[:3, 3]))
        if off_mm > far_mm:
            detail = f"its flange is {off_mm:.1f} mm from where {what} has it"
            raise trouble("wrong-robot", detail).fault(self.name)

    def _state_of(self, status: Status) -> ArmState:
        turn = np.array(status.tcp_m_rad[3:])
        point_mm = 1000 * np.array(status.tcp_m_rad[:3])
        held = robot_trouble(status)
        base_from_tcp = Pose.from_rotvec("base", "tcp", turn, point_mm)
        return ArmState(
            status.joints_rad,
            (base_from_tcp @ self._tcp_from_tool).matrix,
            status.standing,
            self._clock.now_s() - self._session.age_s(),
            fault=held.message if held else "",
        )

    def _checked(self, joints: Sequence[float]) -> FloatArray:
        """The target as an array, or LimitError."""
        target = np.asarray(joints, dtype=np.float64)
        model = self._model
        if target.shape != (model.dof,) or not np.isfinite(target).all():
            raise LimitError(
                f"a target needs {model.dof} finite joint values", device=self.name
            )
        out = (target < model.joint_low) | (target > model.joint_high)
        if out.any():
            k = int(np.argmax(out))
            low, high = np.degrees([model.joint_low[k], model.joint_high[k]])
            raise LimitError(
                f"{model.joint_names[k]}: {np.degrees(target[k]):.2f} deg is outside "
                f"{low:.0f} .. {high:.0f} deg",
                device=self.name,
                hint="plan again, or move the part; nothing has moved",
            )
        return target

    def _slider(self) -> float:
        """The speed slider, where it is known and not at zero."""
        try:
            slider = self._session.status().slider
        except DeviceError:
            return 1.0
        return slider if slider > 0 else 1.0


def _fraction(speed_fraction: float) -> float:
    if not 0 < speed_fraction <= 1:
        raise ValueError("speed_fraction is above 0 and at most 1")
    return speed_fraction
