"""What the cell asks of an arm, a lens and a camera. Small, synchronous, blocking.

Promises kept by every driver and proved by ``mvp.testing``:

- constructors do no I/O; ``open`` and ``close`` are idempotent; ``with`` works;
- connecting never moves anything;
- a motion has a deadline, returns what was *reached*, and has a ``check_*`` twin that
  raises ``LimitError`` and cannot move;
- ``stop`` may be called from any thread, at any time, more than once, and makes a
  motion in progress raise ``MotionStopped``;
- the state may be asked for from any thread, also during a motion, which goes on all the
  same; a device that cannot tell it then raises ``DeviceError`` or says where it was;
- a time-out is an error, nothing is clamped, nothing is retried.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import (
    TYPE_CHECKING,
    ClassVar,
    Literal,
    Protocol,
    Self,
    TypeAlias,
    runtime_checkable,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray

    ClearWay: TypeAlias = Callable[[tuple[float, ...], tuple[float, ...]], None]

Role: TypeAlias = Literal["arm", "lens", "camera"]
Axis: TypeAlias = Literal["zoom", "focus", "iris"]
Side: TypeAlias = Literal["from_below", "from_above"]
AXES: tuple[Axis, ...] = ("zoom", "focus", "iris")


@dataclass(frozen=True)
class DeviceInfo:
    """Who answered: for the record and for ``check``."""

    name: str
    driver: str
    model: str
    serial: str
    firmware: str
    simulated: bool
    extra: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ArmState:
    """Joints (n,) in rad or mm per axis, flange pose, and whether it stands still.

    ``fault`` says what the controller holds against motion; empty when nothing.
    """

    joints: tuple[float, ...]
    base_from_tool: NDArray[np.float64]
    standing: bool
    t_monotonic_s: float
    fault: str = ""


@dataclass(frozen=True)
class LensState:
    """Motor steps per axis and whether every axis is homed and standing."""

    zoom: int
    focus: int
    iris: int
    homed: bool
    standing: bool
    position_is_estimated: bool = False

    def steps(self) -> dict[str, int]:
        """The three positions by axis name."""
        return {"zoom": self.zoom, "focus": self.focus, "iris": self.iris}


@dataclass(frozen=True)
class Frame:
    """One picture and everything known about its time.

    Attributes:
        pixels: (rows, columns) uint8 or uint16, linear in light.
        full_scale: grey value of a saturated pixel.
        exposure_start_s: earliest moment light may have been collected, monotonic.
        exposure_s: exposure time.
        received_s: when the host had it, monotonic.
        frame_id: the camera's own counter.
        dropped: frames known to be lost since the last one.
        device_time_ns: the camera's own clock, whose zero nobody knows; None: it has none.
    """

    pixels: NDArray[np.uint8] | NDArray[np.uint16]
    full_scale: int
    exposure_start_s: float
    exposure_s: float
    received_s: float
    frame_id: int
    gain: float = 1.0
    dropped: int = 0
    device_time_ns: int | None = None


@runtime_checkable
class Device(Protocol):
    """What all devices have in common."""

    role: ClassVar[Role]
    name: str

    def open(self) -> None:
        """Connect. Moves nothing.

        Raises:
            ConnectError: nobody answers.
        """
        ...

    def close(self) -> None:
        """Disconnect; safe to repeat."""
        ...

    def info(self) -> DeviceInfo:
        """Identity and versions."""
        ...

    def stop(self) -> None:
        """Stop now, from any thread; a convenience, never the safety function."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *exc: object) -> None: ...


@runtime_checkable
class Arm(Device, Protocol):
    """A robot arm or gantry that carries the camera."""

    def state(self) -> ArmState:
        """Where it is now."""
        ...

    def check_joints(self, joints: Sequence[float]) -> None:
        """Raise ``LimitError`` when the target is outside the limits. Never moves."""
        ...

    def move_joints(
        self, joints: Sequence[float], *, speed_fraction: float = 1.0, timeout_s: float
    ) -> ArmState:
        """Move along a straight line in joint space; return where it stands.

        Raises:
            LimitError: refused, nothing moved.
            DeviceTimeout: did not arrive in time (``stop`` has been called).
            DeviceFault: the controller reports a fault.
            MotionStopped: ``stop`` was called.
        """
        ...

    def duration_s(
        self,
        start: Sequence[float],
        target: Sequence[float],
        *,
        speed_fraction: float = 1.0,
    ) -> float:
        """How long such a move should take, for deadlines and progress."""
        ...


@runtime_checkable
class Homable(Protocol):
    """A device that knows where it is only after it has found its references.

    An ``Arm`` that is one refuses every motion until it is homed.
    """

    @property
    def homed(self) -> bool:
        """Whether it is known where it is; lost whenever that may not be so."""
        ...

    def home(self, *, timeout_s: float) -> object:
        """Find every reference; returns where it stands. Moves.

        Raises:
            DeviceTimeout, DeviceFault, MotionStopped: as for a move; not homed then.
        """
        ...


@dataclass(frozen=True)
class Homing:
    """What homing would do from where an arm is now.

    Attributes:
        words: what moves where, and what a person must have seen to.
        away: axes that nothing measures and that are counted away from their marks:
            homing drives them back.
        believed: every axis that nothing measures, with where it is taken to be; a
            person answers for it.
    """

    words: str
    away: tuple[str, ...] = ()
    believed: tuple[str, ...] = ()


@runtime_checkable
class DeclaresAxes(Protocol):
    """A ``Homable`` arm with axes that nothing measures: a person says where they are."""

    def homing(self) -> Homing:
        """What ``home`` would do now. Moves nothing.

        Raises:
            DeviceError: it cannot be asked.
        """
        ...

    def home(self, *, timeout_s: float, clear: ClearWay | None = None) -> object:
        """As ``Homable.home``; then drives those axes back to their marks.

        Args:
            timeout_s: of each motion.
            clear: called with the joints before and after that last motion; raises
                where something is in the way. None: nobody can say, and an arm that is
                away from its marks is not driven there.
        """
        ...


@runtime_checkable
class Exclusive(Protocol):
    """A device that one process of this machine may drive at a time."""

    def resource(self) -> str:
        """What it drives, by one name whatever the cell file calls it.

        Such as ``ur:192.168.1.10`` or ``serial:/dev/ttyUSB0``; empty for no such thing.
        """
        ...


@runtime_checkable
class Lens(Device, Protocol):
    """A motorised lens. Speaks motor steps only; f, d, a exist above the lens table."""

    def limits(self) -> dict[Axis, tuple[int, int]]:
        """Lowest and highest step of each axis."""
        ...

    def state(self) -> LensState:
        """Where the motors are now."""
        ...

    def home(self, *, timeout_s: float) -> LensState:
        """Find the reference of every axis. Moves."""
        ...

    def check_steps(self, *, zoom: int, focus: int, iris: int) -> None:
        """Raise ``LimitError`` when outside the limits. Never moves."""
        ...

    def move_steps(
        self, *, zoom: int, focus: int, iris: int, timeout_s: float
    ) -> LensState:
        """Move every axis, arriving from the side the lens table was measured from.

        Raises:
            LimitError: out of range or not homed; nothing moved.
            DeviceTimeout, DeviceFault, MotionStopped: as for the arm.
        """
        ...


@runtime_checkable
class Approaching(Protocol):
    """A lens that says from which side it arrives; not every one does."""

    def approach(self) -> dict[Axis, Side]:
        """Side from which every target of an axis is reached."""
        ...


@runtime_checkable
class DrivesStraight(Protocol):
    """A lens that can be driven without a run-up, so that its backlash can be measured."""

    def move_steps_straight(
        self, *, zoom: int, focus: int, iris: int, timeout_s: float
    ) -> LensState:
        """Move every axis straight there, from whatever side the motors are on.

        The glass may then stand elsewhere than after ``move_steps``; the next
        ``move_steps`` takes the play up again.

        Raises:
            LimitError, DeviceTimeout, DeviceFault, MotionStopped: see ``move_steps``.
        """
        ...


@runtime_checkable
class Thermometer(Protocol):
    """A device that knows how warm it is; not every one does."""

    def temperature_c(self) -> float | None:
        """Temperature now, deg C; None when it cannot tell."""
        ...


@runtime_checkable
class Camera(Device, Protocol):
    """A camera that never hands out a picture from before the arm stood still."""

    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure."""
        ...

    def configure(self, *, exposure_s: float, gain: float = 1.0) -> None:
        """Set and read back; automatic exposure off.

        Raises:
            LimitError: outside the camera's range.
            DeviceFault: the value read back differs.
        """
        ...

    def capture(self, *, not_before_s: float, timeout_s: float) -> Frame:
        """One frame whose exposure began at or after ``not_before_s`` (monotonic).

        Raises:
            DeviceTimeout: no such frame in time.
            DeviceFault: frames arrive with holes.
        """
        ...


@dataclass(frozen=True)
class RecoveryStep:
    """One step on the way back from a fault.

    Attributes:
        text: what is the matter, and what will be done about it.
        acknowledge: a person has to have seen to it; never done unasked.
        act: does it and says what was reached; raises ``DeviceError`` when it was not.
    """

    text: str
    acknowledge: bool
    act: Callable[[], str]


@runtime_checkable
class Recoverable(Protocol):
    """A device that knows its way back from a fault; not every one does."""

    def recovery(self) -> Iterator[RecoveryStep]:
        """The steps from where it is to being ready, none when it is ready.

        It need not be open. The next step is worked out when it is asked for, after the
        last one was done; whoever does not do a step asks for no further one.

        Raises:
            DeviceError: it cannot be asked what is the matter.
        """
        ...
