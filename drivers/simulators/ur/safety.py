"""Power and safety of the controller.

::

    POWER_OFF --power on--> POWER_ON --> IDLE --brake release--> RUNNING
        ^------ power off, emergency stop (once it stands), fault ------'

    NORMAL --> PROTECTIVE_STOP --unlock, after 5 s--> NORMAL
    NORMAL --> SAFEGUARD_STOP --released--> NORMAL, and the program goes on
    NORMAL --> ROBOT_ or SYSTEM_EMERGENCY_STOP --released--> NORMAL, power off
    NORMAL --> FAULT --restart safety--> NORMAL, power off
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from drivers.simulators.ur.robot import Robot

_POWER_ON_S = 0.3
_BRAKES_S = 0.3


class RobotMode(IntEnum):
    """``robot_mode``."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


class SafetyMode(IntEnum):
    """``safety_mode``."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9


_STATUS_BITS = {
    SafetyMode.NORMAL: (0,),
    SafetyMode.REDUCED: (1,),
    SafetyMode.PROTECTIVE_STOP: (2, 10),
    SafetyMode.RECOVERY: (3,),
    SafetyMode.SAFEGUARD_STOP: (4, 10),
    SafetyMode.SYSTEM_EMERGENCY_STOP: (5, 7, 10),
    SafetyMode.ROBOT_EMERGENCY_STOP: (6, 7, 10),
    SafetyMode.VIOLATION: (8, 10),
    SafetyMode.FAULT: (9, 10),
}
_EMERGENCY = (SafetyMode.SYSTEM_EMERGENCY_STOP, SafetyMode.ROBOT_EMERGENCY_STOP)
MOVING_ALLOWED = (SafetyMode.NORMAL, SafetyMode.REDUCED)
OnStop = Literal["pause", "stop"]


class Safety:
    """The safety and power state of one robot.

    Args:
        robot: what it stops.
        on_protective_stop: whether the program is paused or stopped by one.
        unlock_delay_s: how long a protective stop cannot be unlocked.
    """

    def __init__(
        self, robot: Robot, *, on_protective_stop: OnStop, unlock_delay_s: float
    ) -> None:
        self.mode = SafetyMode.NORMAL
        self.power = RobotMode.RUNNING
        self.on_protective_stop = on_protective_stop
        self.unlock_delay_s = unlock_delay_s
        self._robot = robot
        self._stopped_at_s = 0.0
        self._falling = False
        self._next: list[tuple[float, RobotMode]] = []

    @property
    def status_bits(self) -> int:
        """``safety_status_bits``."""
        return sum(1 << bit for bit in _STATUS_BITS[self.mode])

    @property
    def may_run(self) -> bool:
        """Whether a program may run."""
        return self.power == RobotMode.RUNNING and self.mode in MOVING_ALLOWED

    def tick(self) -> None:
        """Power-up in its time; power off after an emergency stop once it stands."""
        if self._next and self._robot.now_s >= self._next[0][0]:
            self.power = self._next.pop(0)[1]
        if self._falling and self._robot.arm.standing:
            self._falling = False
            self._robot.arm.drop()
            self._robot.arm.held = self.mode not in MOVING_ALLOWED
            self.set_power(RobotMode.POWER_OFF)

    def protective_stop(self, on_stop: OnStop | None = None) -> None:
        """Something was touched."""
        self._trip(SafetyMode.PROTECTIVE_STOP, on_stop or self.on_protective_stop)

    def safeguard_stop(self) -> None:
        """A light curtain opened: the program waits."""
        self._trip(SafetyMode.SAFEGUARD_STOP, "pause")

    def emergency_stop(self, *, system: bool = False) -> None:
        """A button was pressed: the program ends, the power goes."""
        self._trip(_EMERGENCY[0 if system else 1], "stop")

    def fault(self) -> None:
        """The safety system failed itself."""
        self._trip(SafetyMode.FAULT, "stop")

    def release(self) -> None:
        """Let go of the button, or close the light curtain.

        Raises:
            ValueError: there is nothing to let go of.
        """
        if self.mode == SafetyMode.SAFEGUARD_STOP:
            self.mode = SafetyMode.NORMAL
            self._robot.resume()
        elif self.mode in _EMERGENCY:
            self.mode = SafetyMode.NORMAL
            self._robot.arm.held = self._falling
        else:
            raise ValueError(f"nothing to release in {self.mode.name}")

    def unlock(self) -> bool:
        """Unlock a protective stop; False when it is too early."""
        if self.mode != SafetyMode.PROTECTIVE_STOP:
            return True
        if self._robot.now_s - self._stopped_at_s < self.unlock_delay_s:
            return False
        self.mode = SafetyMode.NORMAL
        if not self._robot.paused:
            self._robot.arm.drop()
            self._robot.arm.held = False
        return True

    def restart(self) -> None:
        """Restart the safety system; the power is off afterwards."""
        self.mode = SafetyMode.NORMAL
        self._robot.end_program("safety restarted")
        self._robot.arm.drop()
        self._robot.arm.held = False
        self.set_power(RobotMode.POWER_OFF)

    def power_on(self) -> None:
        """Ask for power; nothing happens while an emergency stop is pressed."""
        if self.power == RobotMode.POWER_OFF and self.mode in MOVING_ALLOWED:
            now = self._robot.now_s
            self._next = [
                (now + _POWER_ON_S, RobotMode.POWER_ON),
                (now + 2 * _POWER_ON_S, RobotMode.IDLE),
            ]

    def power_off(self) -> None:
        """Switch the arm off; a program ends."""
        self._robot.end_program("powered off")
        self._robot.arm.drop()
        self.set_power(RobotMode.POWER_OFF)

    def brake_release(self) -> None:
        """Power on where needed, and release the brakes."""
        self.power_on()
        if self.mode in MOVING_ALLOWED and self.power != RobotMode.RUNNING:
            ready = self._next[-1][0] if self._next else self._robot.now_s
            self._next.append((ready + _BRAKES_S, RobotMode.RUNNING))

    def set_power(self, mode: RobotMode) -> None:
        """Force a robot mode."""
        self._next.clear()
        self.power = mode

    def _trip(self, mode: SafetyMode, on_stop: OnStop) -> None:
        """Ramp the arm down; the program waits or ends."""
        self.mode = mode
        self._stopped_at_s = self._robot.now_s
        self._falling = (
            mode in (*_EMERGENCY, SafetyMode.FAULT) and self.power > RobotMode.POWER_OFF
        )
        if on_stop == "pause":
            self._robot.pause()
        else:
            self._robot.end_program(f"stopped by {mode.name}")
        self._robot.arm.held = True
