"""What a byte-level simulator tells the world, and what a camera asks of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray


class WorldPort(Protocol):
    """The world as seen by simulated motors and simulated sensors.

    Times are those of the monotonic clock, which all processes of a machine share.
    """

    def report_arm(self, t_s: float, joints: Sequence[float]) -> None:
        """Say where the axes truly are.

        Args:
            t_s: the moment; never earlier than the one before.
            joints: (dof,) rad, or mm on linear axes; straight between two reports.
        """
        ...

    def report_lens(self, t_s: float, steps: Mapping[str, float]) -> None:
        """Say where the motors truly are: steps of zoom, focus and iris."""
        ...

    def frame(
        self, start_s: float, exposure_s: float, *, gain: float = 1.0, index: int = 0
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """What the sensor delivers for an exposure: (rows, columns) grey values."""
        ...

    def frame_size(self) -> tuple[int, int]:
        """Columns and rows of a picture."""
        ...
