"""Pictures while jogging: one exposure for all of them, one user of the camera at a time."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

from mvp.cell.fresh_frame import fresh_frame
from mvp.errors import DeviceTimeout, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.cell.engine import CellDevices
    from mvp.devices import Frame

_LET_GO_S = 60.0  # a simulated camera draws a picture taken in motion for many seconds


class JogCamera:
    """Takes pictures for whoever asks, from any thread, one after the other.

    Args:
        devices: opened.

    Attributes:
        exposure_s: of the next picture, as far as the camera can.
    """

    def __init__(self, devices: CellDevices) -> None:
        self._devices = devices
        self._free = threading.Condition()
        self._taken = False
        self._range_s: tuple[float, float] | None = None
        self.exposure_s = 0.01

    def expose(self, seconds: float) -> str:
        """Another exposure from the next picture on.

        Raises:
            UsageError: the camera cannot expose so long, or so shortly.
            DeviceError: it cannot be asked.
        """
        if self._range_s is None:
            with self._turn():
                self._range_s = self._devices.camera.exposure_range_s()
        low, high = self._range_s
        if not low <= seconds <= high:
            raise UsageError(
                f"the camera exposes {low * 1e3:g} to {high * 1e3:g} ms, not "
                f"{seconds * 1e3:g} ms"
            )
        self.exposure_s = seconds
        return f"exposure {seconds * 1e3:g} ms"

    def picture(self) -> Frame:
        """One picture whose exposure begins after this is called.

        Raises:
            DeviceError: none came, or somebody else did not let go of the camera.
        """
        with self._turn():
            camera = self._devices.camera
            low, high = self._range_s = camera.exposure_range_s()
            exposure_s = min(max(self.exposure_s, low), high)
            return fresh_frame(camera, self._devices.clock, exposure_s=exposure_s)

    def stop(self) -> None:
        """Let a picture that is waited for end now, from any thread."""
        self._devices.camera.stop()

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """The camera for oneself; drivers refuse two users at once."""
        with self._free:
            if not self._free.wait_for(lambda: not self._taken, _LET_GO_S):
                raise DeviceTimeout(
                    "another picture is still waited for",
                    device=self._devices.camera.name,
                    hint="check cable, supply and trigger of the camera",
                )
            self._taken = True
        try:
            yield
        finally:
            with self._free:
                self._taken = False
                self._free.notify()


def frame_words(frame: Frame) -> str:
    """Size, exposure and brightness of a picture."""
    rows, columns = frame.pixels.shape
    saturated = float((frame.pixels >= frame.full_scale).mean())
    return (
        f"{columns} x {rows} px, exposed {frame.exposure_s * 1e3:g} ms, mean "
        f"{frame.pixels.mean() / frame.full_scale:.0%}, saturated {saturated:.1%}"
    )
