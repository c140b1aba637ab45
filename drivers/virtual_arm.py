"""A simulated arm: limited in speed and acceleration, stoppable from any thread."""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING, ClassVar, NoReturn, Self

import numpy as np
from pydantic import Field

from drivers.virtual_link import identity, require_reachable
from drivers.virtual_motion import StraightMove
from drivers.virtual_world import VirtualWorld, world_of
from mvp.devices import ArmState, DeviceContext, DeviceInfo, Link, Role
from mvp.errors import DeviceFault, DeviceTimeout, LimitError, MotionStopped
from mvp.fileedge import FileModel
from mvp.kinematics import arm_model

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray

_LOG = logging.getLogger(__name__)
_ARRIVED = 1e-6  # rad or mm: the simulated encoders do not round


class VirtualArmConfig(FileModel):
    """Keys of ``[arm]`` for the virtual arm."""

    speed_fraction: float = Field(default=1.0, gt=0, le=1)
    serial: str = "V-ARM-1"


class VirtualArm:
    """The arm of a virtual world."""

    role: ClassVar[Role] = "arm"
    Config = VirtualArmConfig

    def __init__(
        self, config: VirtualArmConfig, world: VirtualWorld, name: str
    ) -> None:
        self.name = name
        self._config = config
        self._world = world
        self._clock = world.clock
        self._model = arm_model(world.belief.arm_model)
        self._link = Link(
            name, world.clock, connect=self._connect, disconnect=self.stop
        )
        self._tripped = False

    @classmethod
    def from_config(
        cls, config: VirtualArmConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the device; no I/O.

        Raises:
            ConfigError: the cell has no virtual world.
        """
        return cls(config, world_of(context, name), name)

    def open(self) -> None:
        """Connect. Moves nothing.

        Raises:
            ConnectError: it has been made unreachable.
        """
        self._link.open()

    def close(self) -> None:
        """Disconnect; a motion in progress is stopped."""
        self._link.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def info(self) -> DeviceInfo:
        """Identity and versions."""
        return identity(
            self.name,
            driver="virtual-arm",
            model=self._model.name,
            serial=self._config.serial,
        )

    def state(self) -> ArmState:
        """Where it is now.

        Raises:
            ConnectError: not open.
        """
        self._link.require_open()
        now = self._clock.now_s()
        joints = self._world.arm_joints(now)
        return ArmState(
            tuple(joints.tolist()),
            self._model.forward(joints).matrix,
            self._world.arm_standing(now),
            now,
        )

    def check_joints(self, joints: Sequence[float]) -> None:
        """Raise ``LimitError`` when the target is outside the limits. Never moves."""
        self._checked(joints)

    def move_joints(
        self, joints: Sequence[float], *, speed_fraction: float = 1.0, timeout_s: float
    ) -> ArmState:
        """Move along a straight line in joint space; return where it stands.

        Raises:
            LimitError, DeviceTimeout, DeviceFault, MotionStopped: see the protocol.
        """
        self._link.require_open()
        self._refuse_when_tripped()
        target = self._checked(joints)
        fraction = self._fraction(speed_fraction)
        began = self._clock.now_s()
        deadline = began + timeout_s
        asked = target.tolist()
        _LOG.debug("%s: sent to %s, %.2f of full speed", self.name, asked, fraction)
        with self._link.busy(
            lambda: self._world.begin_arm(
                target, speed_fraction=fraction, t_s=self._clock.now_s()
            )
        ) as end:
            self._wait_until(end, deadline)
            state = self._arrived(target, deadline)
        _LOG.debug("%s: arrived after %.3f s", self.name, state.t_monotonic_s - began)
        return state

    def duration_s(
        self,
        start: Sequence[float],
        target: Sequence[float],
        *,
        speed_fraction: float = 1.0,
    ) -> float:
        """How long such a move takes, s: ramps included."""
        move = StraightMove.limited(
            np.asarray(start, np.float64),
            np.asarray(target, np.float64),
            speed=self._model.joint_speed * self._fraction(speed_fraction),
            acceleration=self._model.joint_acceleration,
        )
        return move.duration_s

    def stop(self) -> None:
        """Brake now, from any thread."""
        self._world.stop_arm(self._clock.now_s())
        self._link.interrupt()

    def _connect(self) -> None:
        require_reachable(
            self._world.faults.arm, self.name, look_at="is the controller switched on?"
        )

    def _fraction(self, speed_fraction: float) -> float:
        if not 0 < speed_fraction <= 1:
            raise ValueError("speed_fraction is above 0 and at most 1")
        return speed_fraction * self._config.speed_fraction

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
            raise LimitError(
                f"axis {model.joint_names[k]}: {target[k]:.4f} {model.joint_units[k]} is "
                f"outside {model.joint_low[k]:.4f} .. {model.joint_high[k]:.4f}",
                device=self.name,
                hint="plan again, or move the part; nothing has moved",
            )
        return target

    def _wait_until(self, end: float, deadline: float) -> None:
        """Wait for the end of the motion.

        Raises:
            MotionStopped: ``stop`` was called; it stands by then.
            DeviceTimeout: the deadline comes first; it has been told to stop.
        """
        if not self._link.wait_until(min(end, deadline)):
            self._stand_still()
            raise MotionStopped("stopped while it moved", device=self.name)
        if end > deadline:
            self._late()

    def _late(self) -> NoReturn:
        self._world.stop_arm(self._clock.now_s())
        self._stand_still()
        raise DeviceTimeout(
            "did not arrive in time; it has been stopped",
            device=self.name,
            hint="is the speed set very low, or does something block it?",
        )

    def _stand_still(self) -> None:
        """Wait out the braking ramp."""
        never = threading.Event()
        while (left := self._world.arm_end_s() - self._clock.now_s()) > 0:
            self._clock.wait(never, left)

    def _arrived(self, target: FloatArray, deadline: float) -> ArmState:
        """The state at the target, or the fault that kept it from there."""
        if self._link.interrupted:
            raise MotionStopped("stopped while it moved", device=self.name)
        state = self.state()
        if np.abs(np.array(state.joints) - target).max() <= _ARRIVED:
            return state
        if self._world.faults.arm.protective_stop_after_s is not None:
            self._tripped = True
            self._refuse_when_tripped()
        # It stalled: nothing more will happen before the deadline.
        if not self._link.wait_until(deadline):
            raise MotionStopped("stopped while it moved", device=self.name)
        self._late()

    def _refuse_when_tripped(self) -> None:
        """A protective stop lasts until somebody has cleared its cause."""
        self._tripped &= self._world.faults.arm.protective_stop_after_s is not None
        if self._tripped:
            raise DeviceFault(
                "protective stop",
                device=self.name,
                code="C153A0",
                hint="look what it touched, release it on the pendant, then recover",
            )
