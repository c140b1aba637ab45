"""Promises of every motorised lens."""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from mvp.devices import AXES, Axis, DrivesStraight, Lens
from mvp.errors import ConnectError, DeviceTimeout, LimitError, MotionStopped
from mvp.testing.conformance import TIMEOUT_S, DeviceConformance
from mvp.testing.require import meanwhile, refuses, require, watched

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.devices import LensState, Role


class LensConformance(DeviceConformance):
    """Promises of ``mvp.devices.Lens``."""

    role: ClassVar[Role] = "lens"
    forgets_home: bool = True

    def device(self) -> Lens:
        """A new lens, not yet opened."""
        raise TypeError("a conformance suite needs device()")

    @contextmanager
    def homed(self) -> Iterator[Lens]:
        """An open lens that knows where its motors are."""
        with self.device() as lens:
            lens.home(timeout_s=TIMEOUT_S)
            yield lens

    def inside(self, lens: Lens, share: float) -> dict[Axis, int]:
        """Steps at a share of every range."""
        limits = lens.limits()
        return {
            a: round(low + share * (high - low)) for a, (low, high) in limits.items()
        }

    def test_it_is_a_lens(self) -> None:
        """Has every method of the protocol."""
        require(isinstance(self.device(), Lens), "methods of Lens are missing")

    def test_every_axis_has_a_range(self) -> None:
        """Lowest below highest."""
        with self.device() as lens:
            limits = lens.limits()
        for axis in AXES:
            require(limits[axis][0] < limits[axis][1], f"{axis} has no range")

    def test_connecting_moves_nothing(self) -> None:
        """Two connections see the same steps."""
        lens = self.device()
        with lens:
            before = lens.state()
        with lens:
            after = lens.state()
        require(before.steps() == after.steps() and after.standing, "it moved")

    def test_its_state_is_refused_while_it_is_closed(self) -> None:
        """No stale values."""
        refuses(ConnectError, self.device().state)

    def test_it_refuses_to_move_before_it_is_homed(self) -> None:
        """LimitError, and nothing moved."""
        if not self.forgets_home:
            return
        with self.device() as lens:
            before = lens.state()
            require(not before.homed, "says it is homed after switching on")
            target = self.inside(lens, 0.4)
            refuses(LimitError, lambda: _move(lens, target))
            require(lens.state().steps() == before.steps(), "it moved unhomed")

    def test_homing_is_known_afterwards(self) -> None:
        """And it stands."""
        with self.homed() as lens:
            state = lens.state()
            require(state.homed and state.standing, f"after homing: {state}")

    def test_a_move_returns_what_was_reached(self) -> None:
        """From both sides, exactly, and standing, whoever asked meanwhile."""
        with self.homed() as lens:
            for share in (0.3, 0.7, 0.5):
                target = self.inside(lens, share)
                with watched(lens.state):
                    reached = _move(lens, target)
                require(reached.steps() == target, f"{reached} instead of {target}")
                require(reached.standing, "returned while it still moves")
                require(lens.state().steps() == target, "state() differs")

    def test_the_ends_of_the_range_can_be_reached(self) -> None:
        """Limits are limits, not limits minus an overshoot."""
        with self.homed() as lens:
            for share in (1.0, 0.0):
                target = self.inside(lens, share)
                require(_move(lens, target).steps() == target, f"{target} not reached")

    def test_steps_beyond_the_range_are_refused_before_anything_moves(self) -> None:
        """Every axis, both ends."""
        with self.homed() as lens:
            before = lens.state()
            for axis, (low, high) in lens.limits().items():
                for bad in (low - 1, high + 1):
                    target = {**self.inside(lens, 0.5), axis: bad}
                    refuses(LimitError, partial(_check, lens, target))
                    refuses(LimitError, partial(_move, lens, target))
            require(lens.state().steps() == before.steps(), "a refused move moved")

    def test_stop_from_another_thread_ends_a_motion(self) -> None:
        """MotionStopped, and it stands."""
        with self.homed() as lens:
            target = self.inside(lens, 1.0)
            result = meanwhile(
                lambda: _move(lens, target),
                lambda: not lens.state().standing,
                lens.stop,
            )
            require(isinstance(result, MotionStopped), f"not MotionStopped: {result!r}")
            require(lens.state().standing, "still moving after MotionStopped")

    def test_a_deadline_is_kept(self) -> None:
        """DeviceTimeout, and it has been stopped."""
        with self.homed() as lens:
            target = self.inside(lens, 1.0)
            refuses(DeviceTimeout, lambda: _move(lens, target, timeout_s=1e-3))
            require(lens.state().standing, "still moving after a time-out")

    def test_driven_straight_it_arrives_from_both_sides(self) -> None:
        """Exactly, and standing; and the next move arrives as ever."""
        with self.homed() as lens:
            if not isinstance(lens, DrivesStraight):
                return
            for share in (0.3, 0.7, 0.5):
                target = self.inside(lens, share)
                reached = _move(lens, target, straight=True)
                require(reached.steps() == target, f"{reached} instead of {target}")
                require(reached.standing, "returned while it still moves")
                require(lens.state().steps() == target, "state() differs")
            require(_move(lens, target).steps() == target, "it is not there any more")

    def test_driven_straight_it_keeps_its_limits(self) -> None:
        """LimitError before it is homed and beyond the range, and nothing moved."""
        with self.device() as lens:
            if not isinstance(lens, DrivesStraight):
                return
            before = lens.state()
            if self.forgets_home:
                target = self.inside(lens, 0.4)
                refuses(LimitError, lambda: _move(lens, target, straight=True))
            for axis, (low, high) in lens.limits().items():
                for bad in (low - 1, high + 1):
                    target = {**self.inside(lens, 0.5), axis: bad}
                    refuses(LimitError, partial(_move, lens, target, straight=True))
            require(lens.state().steps() == before.steps(), "a refused move moved")

    def test_driven_straight_its_deadline_is_kept(self) -> None:
        """DeviceTimeout, and it has been stopped."""
        with self.homed() as lens:
            if not isinstance(lens, DrivesStraight):
                return
            target = self.inside(lens, 1.0)
            refuses(
                DeviceTimeout,
                lambda: _move(lens, target, timeout_s=1e-3, straight=True),
            )
            require(lens.state().standing, "still moving after a time-out")


def _check(lens: Lens, target: dict[Axis, int]) -> None:
    lens.check_steps(zoom=target["zoom"], focus=target["focus"], iris=target["iris"])


def _move(
    lens: Lens,
    target: dict[Axis, int],
    *,
    timeout_s: float = TIMEOUT_S,
    straight: bool = False,
) -> LensState:
    drive = lens.move_steps
    if straight and isinstance(lens, DrivesStraight):
        drive = lens.move_steps_straight
    return drive(
        zoom=target["zoom"],
        focus=target["focus"],
        iris=target["iris"],
        timeout_s=timeout_s,
    )
