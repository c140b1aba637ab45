"""Promises of every camera."""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from mvp.devices import Camera
from mvp.errors import ConnectError, DeviceTimeout, LimitError, MotionStopped
from mvp.testing.conformance import TIMEOUT_S, DeviceConformance
from mvp.testing.require import meanwhile, refuses, require

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.devices import Role


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
                frame = camera.capture(not_before_s=not_before, timeout_s=TIMEOUT_S)
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
