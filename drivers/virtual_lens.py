"""A simulated motorised lens: three axes with speed, backlash, homing and limits."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, ClassVar, Self

from pydantic import Field

from drivers.virtual_link import identity, require_reachable
from drivers.virtual_world import VirtualWorld, world_of
from mvp.devices import AXES, Axis, DeviceContext, DeviceInfo, LensState, Link, Role
from mvp.errors import DeviceFault, DeviceTimeout, LimitError, MotionStopped
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from mvp.calibrated import AxisTable
    from mvp.devices import Side

_LOG = logging.getLogger(__name__)
_OVERSHOOT = 1.5  # of the backlash, so that the last leg has taken it up for certain
_OVERSHOOT_STEPS = 4


class VirtualLensConfig(FileModel):
    """Keys of ``[lens]`` for the virtual lens; speeds in steps per second."""

    zoom_steps_s: float = Field(default=1200.0, gt=0)
    focus_steps_s: float = Field(default=2000.0, gt=0)
    iris_steps_s: float = Field(default=300.0, gt=0)
    serial: str = "V-LENS-1"


class VirtualLens:
    """The lens of a virtual world.

    Every target is approached from the side from which the lens table was measured,
    with an overshoot beyond the backlash where the motor comes from the other side.
    """

    role: ClassVar[Role] = "lens"
    Config = VirtualLensConfig

    def __init__(
        self, config: VirtualLensConfig, world: VirtualWorld, name: str
    ) -> None:
        self.name = name
        self._config = config
        self._world = world
        self._clock = world.clock
        self._link = Link(
            name, world.clock, connect=self._connect, disconnect=self.stop
        )
        self._homed = False
        # Whether the last motion ended from the side of the table on every axis.
        self._engaged = False
        table = world.belief.lens_table
        self._tables: dict[Axis, AxisTable] = {
            "zoom": table.zoom_f_mm,
            "focus": table.focus_extension_mm,
            "iris": table.iris_a_mm,
        }
        self._rates: dict[Axis, float] = {
            "zoom": config.zoom_steps_s,
            "focus": config.focus_steps_s,
            "iris": config.iris_steps_s,
        }

    @classmethod
    def from_config(
        cls, config: VirtualLensConfig, context: DeviceContext, *, name: str
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
        """Disconnect; motors in motion are stopped."""
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
            driver="virtual-lens",
            model="virtual zoom",
            serial=self._config.serial,
        )

    def limits(self) -> dict[Axis, tuple[int, int]]:
        """First and last step of the lens table."""
        return {a: (min(t.steps), max(t.steps)) for a, t in self._tables.items()}

    def approach(self) -> dict[Axis, Side]:
        """Side from which every target of an axis is reached."""
        return {axis: table.approach for axis, table in self._tables.items()}

    def temperature_c(self) -> float | None:
        """How warm the lens is; None when its world does not say."""
        return self._world.temperature_c

    def state(self) -> LensState:
        """Where the motors are now.

        Raises:
            ConnectError: not open.
        """
        self._link.require_open()
        now = self._clock.now_s()
        motors = self._world.lens_motors(now)
        return LensState(
            zoom=round(motors["zoom"]),
            focus=round(motors["focus"]),
            iris=round(motors["iris"]),
            homed=self._is_homed(),
            standing=self._world.lens_standing(now),
        )

    def home(self, *, timeout_s: float) -> LensState:
        """Find the reference of every axis: run to the lowest step. Moves.

        Raises:
            DeviceTimeout, DeviceFault, MotionStopped: see the protocol.
        """
        self._link.require_open()
        lowest: dict[Axis, tuple[float, ...]] = {
            axis: (float(low),) for axis, (low, _) in self.limits().items()
        }
        self._homed = self._engaged = False
        self._drive(lowest, timeout_s)
        self._homed = True
        return self.state()

    def check_steps(self, *, zoom: int, focus: int, iris: int) -> None:
        """Raise ``LimitError`` when outside the limits. Never moves."""
        asked: dict[Axis, int] = {"zoom": zoom, "focus": focus, "iris": iris}
        for axis, (low, high) in self.limits().items():
            step = asked[axis]
            if not low <= step <= high:
                raise LimitError(
                    f"{axis} step {step} is outside {low} .. {high}",
                    device=self.name,
                    hint="plan within the lens table; nothing has moved",
                )

    def move_steps(
        self, *, zoom: int, focus: int, iris: int, timeout_s: float
    ) -> LensState:
        """Move every axis, arriving from the side of the lens table.

        Raises:
            LimitError, DeviceTimeout, DeviceFault, MotionStopped: see the protocol.
        """
        targets: dict[Axis, int] = {"zoom": zoom, "focus": focus, "iris": iris}
        self._require_ready(targets)
        points = {axis: self._approach(axis, targets[axis]) for axis in AXES}
        self._engaged = False
        self._drive(points, timeout_s)
        state = self._reached(targets)
        self._engaged = True
        return state

    def move_steps_straight(
        self, *, zoom: int, focus: int, iris: int, timeout_s: float
    ) -> LensState:
        """Move every axis straight there, whatever side that is from.

        Raises:
            LimitError, DeviceTimeout, DeviceFault, MotionStopped: see the protocol.
        """
        targets: dict[Axis, int] = {"zoom": zoom, "focus": focus, "iris": iris}
        self._require_ready(targets)
        self._engaged = False
        self._drive({axis: (float(targets[axis]),) for axis in AXES}, timeout_s)
        return self._reached(targets)

    def stop(self) -> None:
        """Stop the motors now, from any thread."""
        self._world.stop_lens(self._clock.now_s())
        self._link.interrupt()

    def _connect(self) -> None:
        require_reachable(
            self._world.faults.lens, self.name, look_at="check cable and supply"
        )

    def _require_ready(self, targets: dict[Axis, int]) -> None:
        """Open, homed, and the targets within the limits."""
        self._link.require_open()
        self.check_steps(**targets)
        if not self._is_homed():
            raise LimitError(
                "not homed; nothing has moved",
                device=self.name,
                hint="call home(), or `mvp-cell home CELL`",
            )

    def _is_homed(self) -> bool:
        return self._homed and not self._world.faults.lens.loses_home

    def _approach(self, axis: Axis, target: int) -> tuple[float, ...]:
        """The points to drive through so that the last leg comes from the right side."""
        table = self._tables[axis]
        sign = 1 if table.approach == "from_below" else -1
        now = self._world.lens_motors(self._clock.now_s())[axis]
        run_up = _OVERSHOOT * table.backlash_steps + _OVERSHOOT_STEPS
        if (target - now) * sign >= run_up:
            return (float(target),)
        if now == target and self._engaged:
            return (float(target),)
        return (target - sign * run_up, float(target))

    def _drive(self, points: dict[Axis, tuple[float, ...]], timeout_s: float) -> None:
        """Drive all axes and wait."""
        began = self._clock.now_s()
        deadline = began + timeout_s
        _LOG.debug("%s: driven through %s", self.name, points)
        with self._link.busy(
            lambda: self._world.begin_lens(points, self._rates, self._clock.now_s())
        ) as end:
            self._wait_until(end, deadline)
        _LOG.debug("%s: stood after %.3f s", self.name, self._clock.now_s() - began)

    def _wait_until(self, end: float, deadline: float) -> None:
        self._link.wait_until(min(end, deadline))
        if self._link.interrupted:
            raise MotionStopped("stopped while it moved", device=self.name)
        if end > deadline:
            self._world.stop_lens(self._clock.now_s())
            raise DeviceTimeout(
                "did not arrive in time; it has been stopped",
                device=self.name,
                hint="does an axis stick?",
            )

    def _reached(self, targets: dict[Axis, int]) -> LensState:
        """The state at the targets, or the fault that kept an axis from there."""
        state = self.state()
        for axis in AXES:
            if state.steps()[axis] != targets[axis]:
                raise DeviceFault(
                    f"{axis} stands at {state.steps()[axis]} instead of "
                    f"{targets[axis]}",
                    device=self.name,
                    code="stall",
                    hint="home the lens; if it happens again the axis sticks",
                )
        return state
