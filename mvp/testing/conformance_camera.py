"""Promises of every camera."""

from __future__ import annotations

import itertools
import logging
import time
from contextlib import contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, ClassVar
from unittest import SkipTest

import numpy as np

from mvp.devices import Camera
from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    LimitError,
    MotionStopped,
)
from mvp.testing.conformance import TIMEOUT_S, DeviceConformance
from mvp.testing.require import meanwhile, refuses, require, wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.devices import Frame, Role

_READ_AHEAD = 8  # frames
_TRIES = 5


class CameraConformance(DeviceConformance):
    """Promises of ``mvp.devices.Camera``.

    Attributes:
        asleep_s: longer than it takes to fill any queue of frames.
        lost_within_s: the longest that a capture may take to notice it.
    """

    role: ClassVar[Role] = "camera"
    asleep_s: ClassVar[float] = 1.5
    lost_within_s: ClassVar[float] = 20.0

    def device(self) -> Camera:
        """A new camera, not yet opened."""
        raise TypeError("a conformance suite needs device()")

    def now_s(self) -> float:
        """The clock of the camera's time stamps."""
        raise TypeError("the camera's suite needs now_s()")

    def lose(self) -> None:
        """Part the camera from the program: kill its far end, pull the plug.

        Raises:
            SkipTest: why nothing can part them; what is said where this is not given.
        """
        raise SkipTest("nobody has said how this camera is lost")

    def bring_back(self) -> None:
        """Undo ``lose``."""

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
                frame = camera.capture(not_before_s=not_before, timeout_s=TIMEOUT_S)
                require(
                    frame.exposure_start_s >= not_before,
                    f"{not_before - frame.exposure_start_s} s too old",
                )
                require(
                    frame.received_s >= frame.exposure_start_s + frame.exposure_s,
                    "received before its exposure had ended",
                )

    def test_a_queue_that_filled_up_brings_no_old_frame(self) -> None:
        """Nobody asks for a while; the next frame is still a new one."""
        with self.ready() as camera:
            self._capture(camera)
            awake = self.now_s() + self.asleep_s
            wait_until(lambda: self.now_s() > awake, "the time passed")
            for _ in range(2):
                self._check_age(camera, self.now_s())

    def test_a_moment_that_is_still_to_come_is_waited_for(self) -> None:
        """``not_before_s`` may lie in the future."""
        with self.ready() as camera:
            self._check_age(camera, self.now_s() + 0.3)

    def test_frame_ids_advance_with_every_frame(self) -> None:
        """Strictly, and no frame counts as dropped twice."""
        with self.ready() as camera:
            frames = [self._capture(camera) for _ in range(4)]
        for before, after in itertools.pairwise(frames):
            step = after.frame_id - before.frame_id
            require(step >= 1, "frame counter stands or goes back")
            require(0 <= after.dropped < step, "more dropped than were counted")

    def test_times_of_a_frame_are_logged(self) -> None:
        """At debug level, with the name of the device."""
        with self.ready() as camera, _log_lines() as lines:
            self._capture(camera)
            told = [line for line in lines if camera.name in line and "frame" in line]
        require(told, "the log says nothing about the frame")

    def test_every_change_of_exposure_is_on_the_next_frame(self) -> None:
        """Short, long, short: each frame has the exposure that was set before it."""
        with self.ready() as camera:
            low, high = camera.exposure_range_s()
            for wanted in (0.004, 0.02, 0.004):
                asked = min(max(wanted, low), high)
                camera.configure(exposure_s=asked)
                frame = self._check_age(camera, self.now_s())
                wrong = abs(frame.exposure_s - asked) > 0.01 * asked
                require(not wrong, f"{frame.exposure_s} s instead of {asked} s")

    def test_only_one_capture_at_a_time(self) -> None:
        """A second one is refused; the first goes on until it is stopped."""
        with self.ready() as camera:
            later, started = self.now_s() + 1e4, self.now_s()

            def interfere() -> None:
                refuses(DeviceFault, lambda: self._capture(camera))
                camera.stop()

            result = meanwhile(
                lambda: camera.capture(not_before_s=later, timeout_s=1e5),
                lambda: self.now_s() > started + 0.5,
                interfere,
            )
            require(isinstance(result, MotionStopped), f"not MotionStopped: {result!r}")

    def _capture(self, camera: Camera) -> Frame:
        return camera.capture(not_before_s=self.now_s(), timeout_s=TIMEOUT_S)

    def _check_age(self, camera: Camera, not_before_s: float) -> Frame:
        """Capture; the frame must have begun at or after the moment, and ended since."""
        frame = camera.capture(not_before_s=not_before_s, timeout_s=TIMEOUT_S)
        late_s = not_before_s - frame.exposure_start_s
        require(late_s <= 0, f"exposed {late_s} s too early")
        ended_s = frame.exposure_start_s + frame.exposure_s
        require(frame.received_s >= ended_s, "received before its exposure had ended")
        require(frame.received_s <= self.now_s(), "received in the future")
        return frame

    def test_frames_are_grey_pictures_of_one_size(self) -> None:
        """uint8 or uint16, two-dimensional, with a full scale that fits."""
        with self.ready() as camera:
            frames = [
                camera.capture(not_before_s=self.now_s(), timeout_s=TIMEOUT_S)
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
            frame = camera.capture(not_before_s=self.now_s(), timeout_s=TIMEOUT_S)
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

    def test_a_lost_camera_is_an_error_and_has_its_settings_again(self) -> None:
        """DeviceError in time; then frames as before, at the latest once opened anew."""
        with self.ready() as camera:
            low, high = camera.exposure_range_s()
            asked = min(max(0.007, low), high)
            camera.configure(exposure_s=asked)
            before = self._capture(camera)
            self.lose()
            try:
                self._ends_in_an_error(camera)
            finally:
                self.bring_back()
            after = self._taken_again(camera)
        require(abs(after.exposure_s - asked) <= 0.01 * asked, "another exposure")
        require(after.pixels.shape == before.pixels.shape, "another size")

    def _ends_in_an_error(self, camera: Camera) -> None:
        """What had been read ahead may still come; then an error, and no waiting."""
        for _ in range(_READ_AHEAD):
            begun_s = time.monotonic()
            try:
                camera.capture(not_before_s=self.now_s(), timeout_s=TIMEOUT_S)
            except DeviceError:
                took_s = time.monotonic() - begun_s
                require(took_s <= self.lost_within_s, f"noticed only after {took_s} s")
                return
        raise AssertionError("a camera that is gone goes on to deliver")

    def _taken_again(self, camera: Camera) -> Frame:
        """A fresh frame, from the second try on after closing and opening."""
        last: DeviceError | None = None
        for _ in range(_TRIES):
            try:
                return self._check_age(camera, self.now_s())
            except DeviceError as error:
                last = error
            with suppress(DeviceError):
                camera.close()
            with suppress(DeviceError):
                camera.open()
        raise AssertionError("it does not come back") from last

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
            camera.capture(not_before_s=self.now_s(), timeout_s=TIMEOUT_S)


class _Lines(logging.Handler):
    """Keeps what is logged."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


@contextmanager
def _log_lines() -> Iterator[list[str]]:
    """Everything that is logged meanwhile, debug level included."""
    root, handler = logging.getLogger(), _Lines()
    level = root.level
    root.addHandler(handler)
    root.setLevel(logging.DEBUG)
    try:
        yield handler.lines
    finally:
        root.setLevel(level)
        root.removeHandler(handler)
