"""What every driver promises, as test classes to inherit from.

::

    class TestMyArm(ArmConformance):
        def device(self):
            return MyArm.from_config(MyArm.Config(), DeviceContext(), name="arm")

        def targets(self):
            return [0, -1.5, 1.5, -1.5, -1.5, 0], [0.3, -1.4, 1.5, -1.5, -1.5, 0]

Run them with pytest against a simulator first, and against hardware with the safety
functions tested and a person beside it. Each test builds, opens and closes a device.
"""

from __future__ import annotations

import math
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from mvp.devices import AXES, Arm, Axis, Camera, Lens
from mvp.errors import ConnectError, DeviceTimeout, LimitError, MotionStopped
from mvp.geometry import Pose
from mvp.testing.require import meanwhile, refuses, require

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from mvp.devices import ArmState, Device, LensState, Role

_TIMEOUT_S = 120.0


class DeviceConformance:
    """What all devices have in common."""

    role: ClassVar[Role]

    def device(self) -> Device:
        """A new device, not yet opened. To be given by the driver's author."""
        raise TypeError("a conformance suite needs device()")

    def test_it_says_which_role_it_plays(self) -> None:
        """Role and name."""
        device = self.device()
        require(device.role == self.role, f"role is {device.role}, not {self.role}")
        require(device.name, "the device has no name")

    def test_opening_and_closing_can_be_repeated(self) -> None:
        """``open`` and ``close`` are idempotent, in any order."""
        device = self.device()
        device.close()
        device.open()
        device.open()
        device.close()
        device.close()
        device.open()
        device.close()

    def test_it_can_be_used_with_a_with_statement(self) -> None:
        """``with`` opens and hands out the device itself."""
        device = self.device()
        with device as inside:
            require(inside is device, "with gave another object")
            require(device.info().driver, "no driver in info()")

    def test_info_names_the_device(self) -> None:
        """Identity is complete enough for a record."""
        with self.device() as device:
            info = device.info()
        require(info.name == device.name, "info().name is another name")
        require(info.model and info.serial, "info() needs model and serial")

    def test_stop_is_harmless_at_any_time(self) -> None:
        """Stopping what stands, twice, is no error."""
        with self.device() as device:
            device.stop()
            device.stop()


class ArmConformance(DeviceConformance):
    """Promises of ``mvp.devices.Arm``."""

    role: ClassVar[Role] = "arm"
    tolerance: float = 1e-3

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
            arm.move_joints(self.targets()[0], timeout_s=_TIMEOUT_S)
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
        """It stands at the target, and state() says the same."""
        target = self.targets()[1]
        with self.at_first_target() as arm:
            reached = arm.move_joints(target, timeout_s=_TIMEOUT_S)
            require(reached.standing, "returned while it still moves")
            self._same_place(reached, target)
            self._same_place(arm.state(), target)

    def test_a_move_to_where_it_stands_is_fine(self) -> None:
        """No motion, no error."""
        with self.at_first_target() as arm:
            reached = arm.move_joints(self.targets()[0], timeout_s=_TIMEOUT_S)
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
                lambda: arm.move_joints(self.beyond(), timeout_s=_TIMEOUT_S),
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
                    second, speed_fraction=0.05, timeout_s=_TIMEOUT_S
                ),
                lambda: not arm.state().standing,
                arm.stop,
            )
            require(isinstance(result, MotionStopped), f"not MotionStopped: {result!r}")
            state = arm.state()
            require(state.standing, "still moving after MotionStopped")
            missed = np.abs(np.array(state.joints) - second).max()
            require(missed > self.tolerance, "it went on to the target")
            self._same_place(arm.move_joints(first, timeout_s=_TIMEOUT_S), first)

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
            lens.home(timeout_s=_TIMEOUT_S)
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
        """From both sides, exactly, and standing."""
        with self.homed() as lens:
            for share in (0.3, 0.7, 0.5):
                target = self.inside(lens, share)
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


class CameraConformance(DeviceConformance):
    """Promises of ``mvp.devices.Camera``."""

    role: ClassVar[Role] = "camera"

    def device(self) -> Camera:
        """A new camera, not yet opened."""
        raise TypeError("a conformance suite needs device()")

    def now_s(self) -> float:
        """The clock of the camera's time stamps."""
        raise TypeError("the camera's suite needs now_s()")

    @contextmanager
    def ready(self) -> Iterator[Camera]:
        """An open camera with an exposure set."""
        with self.device() as camera:
            low, high = camera.exposure_range_s()
            camera.configure(exposure_s=min(max(0.005, low), high))
            yield camera

    def test_it_is_a_camera(self) -> None:
        """Has every method of the protocol."""
        require(isinstance(self.device(), Camera), "methods of Camera are missing")

    def test_a_closed_camera_takes_no_picture(self) -> None:
        """ConnectError."""
        camera = self.device()
        refuses(ConnectError, lambda: camera.capture(not_before_s=0.0, timeout_s=1.0))

    def test_a_frame_is_never_older_than_asked(self) -> None:
        """Exposure began at or after ``not_before_s``; several times in a row."""
        with self.ready() as camera:
            for _ in range(3):
                not_before = self.now_s()
                frame = camera.capture(not_before_s=not_before, timeout_s=_TIMEOUT_S)
                require(
                    frame.exposure_start_s >= not_before,
                    f"{not_before - frame.exposure_start_s} s too old",
                )
                require(
                    frame.received_s >= frame.exposure_start_s + frame.exposure_s,
                    "received before its exposure had ended",
                )

    def test_frames_are_grey_pictures_of_one_size(self) -> None:
        """uint8 or uint16, two-dimensional, with a full scale that fits."""
        with self.ready() as camera:
            frames = [
                camera.capture(not_before_s=self.now_s(), timeout_s=_TIMEOUT_S)
                for _ in range(2)
            ]
        for frame in frames:
            require(frame.pixels.ndim == 2, "not a grey picture")
            require(frame.pixels.dtype in (np.uint8, np.uint16), "wrong type")
            require(int(frame.pixels.max()) <= frame.full_scale, "above full scale")
        require(frames[0].pixels.shape == frames[1].pixels.shape, "size changed")
        require(frames[1].frame_id > frames[0].frame_id, "frame counter stands")

    def test_the_exposure_is_the_one_that_was_set(self) -> None:
        """The frame says so."""
        with self.ready() as camera:
            low, high = camera.exposure_range_s()
            asked = min(max(0.008, low), high)
            camera.configure(exposure_s=asked)
            frame = camera.capture(not_before_s=self.now_s(), timeout_s=_TIMEOUT_S)
            require(abs(frame.exposure_s - asked) <= 0.01 * asked, "another exposure")

    def test_an_exposure_beyond_the_range_is_refused(self) -> None:
        """Both ends."""
        with self.ready() as camera:
            low, high = camera.exposure_range_s()
            for bad in (low / 2, high * 2):
                refuses(LimitError, partial(camera.configure, exposure_s=bad))

    def test_a_deadline_is_kept(self) -> None:
        """A frame of the far future does not come in time."""
        with self.ready() as camera:
            later = self.now_s() + 1e4
            refuses(
                DeviceTimeout,
                lambda: camera.capture(not_before_s=later, timeout_s=0.2),
            )

    def test_stop_from_another_thread_ends_the_waiting(self) -> None:
        """MotionStopped at once; the next capture works."""
        with self.ready() as camera:
            later = self.now_s() + 1e4
            started = self.now_s()
            result = meanwhile(
                lambda: camera.capture(not_before_s=later, timeout_s=1e5),
                lambda: self.now_s() > started + 0.5,
                camera.stop,
            )
            require(isinstance(result, MotionStopped), f"not MotionStopped: {result!r}")
            camera.capture(not_before_s=self.now_s(), timeout_s=_TIMEOUT_S)


def _check(lens: Lens, target: dict[Axis, int]) -> None:
    lens.check_steps(zoom=target["zoom"], focus=target["focus"], iris=target["iris"])


def _move(
    lens: Lens, target: dict[Axis, int], *, timeout_s: float = _TIMEOUT_S
) -> LensState:
    return lens.move_steps(
        zoom=target["zoom"],
        focus=target["focus"],
        iris=target["iris"],
        timeout_s=timeout_s,
    )
