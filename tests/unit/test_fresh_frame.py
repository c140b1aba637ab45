"""One picture whose exposure begins after it was asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from mvp.cell.fresh_frame import fresh_frame
from mvp.devices import Frame, RealClock
from mvp.errors import DeviceFault

if TYPE_CHECKING:
    from mvp.devices import Camera


class Stamping:
    """A camera that stamps its frames so much late, and notes how long it may take."""

    name = "camera"

    def __init__(self, late_s: float) -> None:
        self.late_s = late_s
        self.timeout_s = 0.0
        self.settings = (0.0, 0.0)

    def configure(self, *, exposure_s: float, gain: float = 1.0) -> None:
        self.settings = (exposure_s, gain)

    def capture(self, *, not_before_s: float, timeout_s: float) -> Frame:
        self.timeout_s = timeout_s
        start_s = not_before_s + self.late_s
        return Frame(np.zeros((2, 2), np.uint8), 255, start_s, 0.5, start_s, 1)


def test_it_is_taken_as_asked_and_may_take_a_few_exposures() -> None:
    camera = Stamping(0.0)
    taken = cast("Camera", camera)
    fresh_frame(taken, RealClock(), exposure_s=0.5, gain=2.0)
    assert camera.settings == (0.5, 2.0)
    assert camera.timeout_s == pytest.approx(12.0)
    fresh_frame(taken, RealClock(), exposure_s=0.5, spare_s=30.0)
    assert camera.timeout_s == pytest.approx(32.0)


def test_a_frame_from_before_it_was_asked_for_is_refused() -> None:
    with pytest.raises(DeviceFault, match="before it was asked for"):
        fresh_frame(cast("Camera", Stamping(-1e-3)), RealClock(), exposure_s=0.5)
