"""What the simulated camera sees: an exposure in real time, then the world's frame."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from drivers.simulators.gige.fake_camera import Region
    from drivers.simulators.world_port import WorldPort

_MONO8, _MONO16 = 0x01080001, 0x01100007
_US = 1e6


class Painter:
    """Exposes: waits as long as the light is collected, then asks for the picture.

    Without a world the pictures are a grey ramp that moves with every frame.

    Args:
        gain_db_per_raw: what one unit of GainRaw amplifies.
    """

    def __init__(
        self, world: WorldPort | None, size: tuple[int, int], gain_db_per_raw: float
    ) -> None:
        self._world = world
        self._size = size
        self._gain_db_per_raw = gain_db_per_raw
        self._awake = threading.Event()
        self.frames = 0
        self.delay_s = 0.0
        self.last_exposure_us = 0

    def __call__(
        self, exposure_us: int, gain_raw: int, code: int, region: Region
    ) -> bytes:
        """Pixels of the region, row by row.

        Raises:
            ValueError: a pixel format other than Mono8 and Mono16.
        """
        start_s = time.monotonic()
        exposure_s = exposure_us / _US
        self._awake.wait(exposure_s + self.delay_s)
        gain = 10.0 ** (gain_raw * self._gain_db_per_raw / 20.0)
        picture = self._picture(start_s, exposure_s, gain)
        self.frames += 1
        self.last_exposure_us = exposure_us
        cut = picture[
            region.y : region.y + region.height, region.x : region.x + region.width
        ]
        return _packed(cut, code)

    def interrupt(self) -> None:
        """Cut exposures short, so that the camera can be ended."""
        self._awake.set()

    def _picture(
        self, start_s: float, exposure_s: float, gain: float
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        if self._world is not None:
            return self._world.frame(start_s, exposure_s, gain=gain, index=self.frames)
        columns, rows = self._size
        ramp = np.add.outer(np.arange(rows), np.arange(columns)) + self.frames
        return (ramp % 256).astype(np.uint8)


def _packed(picture: NDArray[np.uint8] | NDArray[np.uint16], code: int) -> bytes:
    """Grey values in a pixel format of the stream, low byte first.

    Eight bits become sixteen by repetition, so that white stays white.
    """
    if code == _MONO8 and picture.dtype == np.uint8:
        return picture.tobytes()
    if code == _MONO16 and picture.dtype == np.uint16:
        return picture.astype("<u2").tobytes()
    if code == _MONO16:
        return (picture.astype("<u2") * 257).astype("<u2").tobytes()
    raise ValueError(f"the world's {picture.dtype} does not fit format 0x{code:08x}")
