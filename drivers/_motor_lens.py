"""The lens that a cell sees, over the motors that a controller drives.

What every motorised lens on a wire does alike is here once: being connected, one move
at a time, refusing before anything moves, the side of approach. How a controller is
told to move, and how it is known to have arrived, is the driver's.
"""

from __future__ import annotations

from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, ClassVar, Protocol, Self

from drivers._lens import (
    Deadline,
    Pace,
    despite_stops,
    not_homed,
    steps_of,
    warn_untried,
)
from mvp.devices import Link, link_resource, require_real_time
from mvp.errors import DeviceError, DeviceTimeout, LinkLost, MotionStopped

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from drivers._lens import LensAxes, Steps
    from mvp.devices import Axis, Clock, DeviceInfo, LensState, Role, Session, Side


class LensController(Protocol):
    """The motors of a lens as one kind of controller drives them.

    Attributes:
        product: whose it is, for the warning that it was not tried on hardware.
        axes: ranges and sides of approach.
    """

    product: ClassVar[str]
    axes: LensAxes

    @property
    def session(self) -> Session:
        """The conversation with it."""
        ...

    def connect(self) -> None:
        """Open the session and learn who answers. Moves nothing."""
        ...

    def info(self) -> DeviceInfo:
        """Identity and versions."""
        ...

    def state(self) -> LensState:
        """Where the motors are now."""
        ...

    def home(self, deadline: Deadline) -> None:
        """Find the reference of every axis; leaves nothing in motion that can stop."""
        ...

    def move(self, legs: Sequence[Steps], targets: Steps, deadline: Deadline) -> None:
        """Drive the legs one after the other; they end at the targets."""
        ...

    def stop(self) -> None:
        """Stop what can be stopped, from any thread."""
        ...

    def forget_home(self) -> None:
        """Where the motors are is not known any more."""
        ...


class MotorLens:
    """A ``Lens`` over a controller.

    Args:
        name: of the device.
        clock: monotonic time.
        controller: makes the controller, given the waiting that a stop cuts short.
    """

    role: ClassVar[Role] = "lens"

    def __init__(
        self, name: str, clock: Clock, controller: Callable[[Pace], LensController]
    ) -> None:
        require_real_time(clock, name)
        self.name = name
        self._clock = clock
        self._link = Link(
            name, clock, connect=self._connect, disconnect=self._disconnect
        )
        self._controller = controller(Pace(self._link, clock, name))

    def open(self) -> None:
        """Connect and identify. Moves nothing.

        Raises:
            ConnectError: no such port, in use, or no such controller there.
            ConfigError, CalibrationError: no usable ranges.
        """
        self._link.open()

    def close(self) -> None:
        """Stop what can be stopped and disconnect."""
        self._link.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def info(self) -> DeviceInfo:
        """Identity and versions.

        Raises:
            ConnectError: not open.
        """
        self._link.require_open()
        return self._controller.info()

    def resource(self) -> str:
        """The port that it is driven through."""
        return link_resource(self._controller.session.address, device=self.name)

    def approach(self) -> dict[Axis, Side]:
        """Side from which every target of an axis is reached."""
        ranges = self._controller.axes.ranges()
        return {axis: range_.approach for axis, range_ in ranges.items()}

    def limits(self) -> dict[Axis, tuple[int, int]]:
        """Lowest and highest step of each axis."""
        return self._controller.axes.limits()

    def state(self) -> LensState:
        """Where the motors are now.

        Raises:
            ConnectError: not open.
            LinkLost, DeviceTimeout, WireError: no sensible answer.
        """
        self._require_link()
        return despite_stops(self._controller.state)

    def home(self, *, timeout_s: float) -> LensState:
        """Find the reference of every axis. Moves.

        Raises:
            DeviceTimeout, DeviceFault, MotionStopped: see the protocol.
        """
        self._link.require_open()
        deadline = Deadline(self._clock, timeout_s)
        with self._moving():
            self._controller.home(deadline)
        return self.state()

    def check_steps(self, *, zoom: int, focus: int, iris: int) -> None:
        """Raise ``LimitError`` when outside the limits. Never moves."""
        self._controller.axes.check({"zoom": zoom, "focus": focus, "iris": iris})

    def move_steps(
        self, *, zoom: int, focus: int, iris: int, timeout_s: float
    ) -> LensState:
        """Move every axis, arriving from the side of the lens table.

        Raises:
            LimitError, DeviceTimeout, DeviceFault, MotionStopped: see the protocol.
        """
        targets: Steps = {"zoom": zoom, "focus": focus, "iris": iris}
        return self._moved(targets, timeout_s, straight=False)

    def move_steps_straight(
        self, *, zoom: int, focus: int, iris: int, timeout_s: float
    ) -> LensState:
        """Move every axis straight there, whatever side that is from.

        Raises:
            LimitError, DeviceTimeout, DeviceFault, MotionStopped: see the protocol.
        """
        targets: Steps = {"zoom": zoom, "focus": focus, "iris": iris}
        return self._moved(targets, timeout_s, straight=True)

    def stop(self) -> None:
        """Stop what can be stopped now, from any thread; no further motion is sent."""
        self._link.interrupt()
        if self._link.is_open and not self._controller.session.is_lost:
            self._controller.stop()

    def _moved(self, targets: Steps, timeout_s: float, *, straight: bool) -> LensState:
        """Drive to the targets, straight or with a run-up from the table's side."""
        self._require_link()
        axes = self._controller.axes
        axes.check(targets)
        deadline = Deadline(self._clock, timeout_s)
        with self._moving():
            before = self._controller.state()
            if not before.homed:
                raise not_homed(self.name)
            legs = axes.legs(steps_of(before), targets)
            axes.disengage()
            self._controller.move((targets,) if straight else legs, targets, deadline)
            if not straight:
                axes.engage()
        return self.state()

    def _require_link(self) -> None:
        """A controller that is asked nothing would not notice that it is gone."""
        self._link.require_open()
        if self._controller.session.is_lost:
            raise LinkLost(
                "the link is gone",
                device=self.name,
                hint="check cable and supply, close and open it, and home it again",
            )

    @contextmanager
    def _moving(self) -> Iterator[None]:
        """One move at a time; the traffic is written down when it fails.

        Raises:
            MotionStopped: a stop was asked for, and then no answer came.
        """
        with self._controller.session.dumping(), self._link.busy(_nothing_yet):
            try:
                yield
            except DeviceTimeout as error:
                if not self._link.interrupted:
                    raise
                raise MotionStopped(
                    f"stopped; {error.detail}", device=self.name, hint=error.hint
                ) from error

    def _connect(self) -> None:
        self._controller.axes.ranges()
        try:
            self._controller.connect()
        except BaseException:
            self._controller.session.close()
            raise
        self._controller.forget_home()
        warn_untried(self.name, self._controller.product)

    def _disconnect(self) -> None:
        # Closing must work on a dead link, too.
        with suppress(DeviceError):
            self.stop()
        self._controller.session.close()
        self._controller.forget_home()


def _nothing_yet() -> None:
    """The first byte of a motion is sent after the device is marked as busy."""
