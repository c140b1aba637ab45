"""Promises of every arm."""

from __future__ import annotations

import math
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from mvp.devices import Arm
from mvp.errors import ConnectError, DeviceTimeout, LimitError, MotionStopped
from mvp.geometry import Pose
from mvp.testing.conformance import TIMEOUT_S, DeviceConformance
from mvp.testing.require import meanwhile, refuses, require, watched

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from mvp.devices import ArmState, Role


class ArmConformance(DeviceConformance):
    """Promises of ``mvp.devices.Arm``.

    Attributes:
        tolerance: how far from a target it may stand, mm or rad.
        slow_fraction: of full speed; the way between the targets then takes a second
            at least, so that it can be stopped in the middle of it.
    """

    role: ClassVar[Role] = "arm"
    tolerance: float = 1e-3
    slow_fraction: float = 0.05

    def device(self) -> Arm:
        """A new arm, not yet opened."""
        raise TypeError("a conformance suite needs device()")

    def targets(self) -> tuple[Sequence[float], Sequence[float]]:
        """Two configurations that are safe to go to and between."""
        raise TypeError("the arm's suite needs targets()")

    def beyond(self) -> Sequence[float]:
        """A configuration outside the limits; the first target with a huge axis."""
        return [1e4, *self.targets()[0][1:]]

    @contextmanager
    def at_first_target(self) -> Iterator[Arm]:
        """An open arm that stands at the first target."""
        with self.device() as arm:
            arm.move_joints(self.targets()[0], timeout_s=TIMEOUT_S)
            yield arm

    def test_it_is_an_arm(self) -> None:
        """Has every method of the protocol."""
        require(isinstance(self.device(), Arm), "methods of Arm are missing")

    def test_connecting_moves_nothing(self) -> None:
        """Two connections see the same place."""
        arm = self.device()
        with arm:
            before = arm.state()
        with arm:
            after = arm.state()
        require(after.standing, "it moves after connecting")
        self._same_place(before, after.joints)

    def test_its_state_is_refused_while_it_is_closed(self) -> None:
        """No stale values."""
        refuses(ConnectError, self.device().state)

    def test_the_flange_pose_is_rigid(self) -> None:
        """``base_from_tool`` is a homogeneous transform in mm."""
        with self.device() as arm:
            Pose.from_matrix("base", "tool", arm.state().base_from_tool)

    def test_a_move_returns_what_was_reached(self) -> None:
        """It stands at the target, and state() says the same, whoever asked meanwhile."""
        target = self.targets()[1]
        with self.at_first_target() as arm:
            with watched(arm.state):
                reached = arm.move_joints(target, timeout_s=TIMEOUT_S)
            require(reached.standing, "returned while it still moves")
            self._same_place(reached, target)
            self._same_place(arm.state(), target)

    def test_a_move_to_where_it_stands_is_fine(self) -> None:
        """No motion, no error."""
        with self.at_first_target() as arm:
            reached = arm.move_joints(self.targets()[0], timeout_s=TIMEOUT_S)
            self._same_place(reached, self.targets()[0])

    def test_checking_a_target_moves_nothing(self) -> None:
        """Neither a good nor a bad one."""
        with self.at_first_target() as arm:
            arm.check_joints(self.targets()[1])
            refuses(LimitError, lambda: arm.check_joints(self.beyond()))
            self._same_place(arm.state(), self.targets()[0])

    def test_a_target_beyond_the_limits_is_refused_before_anything_moves(self) -> None:
        """LimitError, and it stands where it stood."""
        with self.at_first_target() as arm:
            refuses(
                LimitError,
                lambda: arm.move_joints(self.beyond(), timeout_s=TIMEOUT_S),
            )
            self._same_place(arm.state(), self.targets()[0])

    def test_a_target_that_is_no_number_is_refused(self) -> None:
        """Nan and inf never reach the controller."""
        with self.device() as arm:
            for bad in (math.nan, math.inf):
                target = [bad, *self.targets()[0][1:]]
                refuses(LimitError, partial(arm.check_joints, target))

    def test_a_target_with_too_few_axes_is_refused(self) -> None:
        """One value per axis."""
        with self.device() as arm:
            refuses(LimitError, lambda: arm.check_joints(self.targets()[0][:-1]))

    def test_stop_from_another_thread_ends_a_motion(self) -> None:
        """MotionStopped, and it stands before the target."""
        first, second = self.targets()
        with self.at_first_target() as arm:
            result = meanwhile(
                lambda: arm.move_joints(
                    second, speed_fraction=self.slow_fraction, timeout_s=TIMEOUT_S
                ),
                lambda: not arm.state().standing,
                arm.stop,
            )
            require(isinstance(result, MotionStopped), f"not MotionStopped: {result!r}")
            state = arm.state()
            require(state.standing, "still moving after MotionStopped")
            missed = np.abs(np.array(state.joints) - second).max()
            require(missed > self.tolerance, "it went on to the target")
            self._same_place(arm.move_joints(first, timeout_s=TIMEOUT_S), first)

    def test_a_deadline_is_kept(self) -> None:
        """DeviceTimeout, and it has been stopped."""
        with self.at_first_target() as arm:
            refuses(
                DeviceTimeout,
                lambda: arm.move_joints(
                    self.targets()[1], speed_fraction=0.01, timeout_s=0.05
                ),
            )
            require(arm.state().standing, "still moving after a time-out")

    def test_a_slower_move_takes_longer(self) -> None:
        """``duration_s`` follows the speed."""
        first, second = self.targets()
        with self.device() as arm:
            fast = arm.duration_s(first, second)
            slow = arm.duration_s(first, second, speed_fraction=0.1)
        require(0 < fast < slow, f"{fast} s at full speed, {slow} s at a tenth")

    def _same_place(self, state: ArmState, joints: Sequence[float]) -> None:
        off = np.abs(np.array(state.joints) - np.asarray(joints)).max()
        require(off <= self.tolerance, f"{off} away from {list(joints)}")
