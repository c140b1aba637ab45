"""The sensor of a simulated network camera: exposes, encodes, keeps the newest."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from drivers.simulators.world_port import WorldPort

_LOG = logging.getLogger(__name__)
_POLL_S = 0.02
_TAIL_S = 0.2


class MjpegSimulatorConfig(FileModel):
    """Keys of ``[simulators.camera]`` with ``kind = "mjpeg"``.

    A picture that is later than ``latency_s`` after its exposure is dropped, so that
    what the camera promises about its age holds on a slow computer as well.
    """

    fps: float = Field(default=5.0, gt=0, le=200)
    latency_s: float = Field(default=0.5, gt=0)
    quality: int = Field(default=97, ge=95, le=100)
    exposure_min_s: float = Field(default=20e-6, gt=0)
    exposure_max_s: float = Field(default=2.0, gt=0)
    columns: int = Field(default=640, ge=1, description="px, where no world says it")
    rows: int = Field(default=480, ge=1, description="px, where no world says it")
    serial: str = Field(default="SIM-MJPEG-1", min_length=1)
    port: int = Field(default=0, ge=0, le=65535)


class Faults:
    """What is wrong with the stream now; set by the fault channel."""

    def __init__(self) -> None:
        self.stalled = False
        self.drop_every = 0
        self.garbage = 0
        self.half = 0
        self.bytes_per_s = 0.0

    def take(self, what: str) -> bool:
        """Use one of a counted fault up."""
        left = int(getattr(self, what))
        setattr(self, what, max(0, left - 1))
        return left > 0


class Shutter:
    """Exposes picture after picture while somebody watches; keeps the newest.

    Args:
        world: what is seen; a moving ramp when None.
    """

    def __init__(self, config: MjpegSimulatorConfig, world: WorldPort | None) -> None:
        self._config = config
        self._world = world
        self.exposure_s, self.gain = 0.01, 1.0
        self.faults = Faults()
        self.number = 0
        self.dropped = 0
        self._jpeg = b""
        self._begun_s = 0.0
        self.watchers = 0
        self._changed = threading.Condition()
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin; safe to repeat."""
        if self._thread is None:
            self._ending.clear()
            self._thread = threading.Thread(target=self._run, name="mjpeg-shutter")
            self._thread.start()

    def stop(self) -> None:
        """End; safe to repeat."""
        self._ending.set()
        with self._changed:
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()
        self._thread = None

    @property
    def ending(self) -> bool:
        """Whether it has been told to end."""
        return self._ending.is_set()

    def wait(self, seen: int) -> tuple[int, bytes] | None:
        """The next picture after number ``seen``; None when there is none yet."""
        with self._changed:
            self._changed.wait_for(lambda: self.number > seen or self.ending, _TAIL_S)
            if self.number <= seen or self._late():
                return None
            return self.number, self._jpeg

    def _late(self) -> bool:
        return time.monotonic() > self._begun_s + self.exposure_s + (
            self._config.latency_s
        )

    def _run(self) -> None:
        next_s = time.monotonic()
        while not self._ending.wait(max(0.0, next_s - time.monotonic())):
            next_s = max(next_s + 1 / self._config.fps, time.monotonic())
            if self.watchers == 0:
                next_s = time.monotonic() + _POLL_S
            elif not self.faults.stalled:
                self._expose()

    def _expose(self) -> None:
        begun_s, exposure_s = time.monotonic(), self.exposure_s
        if self._ending.wait(exposure_s):
            return
        try:
            picture = self._picture(begun_s, exposure_s)
        except OSError:
            _LOG.warning("the world shows nothing any more")
            return
        jpeg = _encoded(picture, self._config.quality)
        with self._changed:
            self.number += 1
            self._jpeg, self._begun_s = jpeg, begun_s
            every = self.faults.drop_every
            if self._late() or (every and self.number % every == 0):
                self.dropped += 1
                self._begun_s = -np.inf
            self._changed.notify_all()

    def _picture(self, begun_s: float, exposure_s: float) -> NDArray[np.uint8]:
        if self._world is None:
            config = self._config
            ramp = np.add.outer(np.arange(config.rows), np.arange(config.columns))
            return ((ramp + self.number) % 256).astype(np.uint8)
        picture = self._world.frame(
            begun_s, exposure_s, gain=self.gain, index=self.number
        )
        if picture.dtype != np.uint8:
            raise ValueError("motion JPEG carries 8 bits only")
        return picture.astype(np.uint8, copy=False)


def _encoded(picture: NDArray[np.uint8], quality: int) -> bytes:
    import cv2

    done, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError("the picture cannot be encoded")
    return jpeg.tobytes()
