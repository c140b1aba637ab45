"""What a driver is built with: time, randomness, the world it may be part of."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mvp.devices.transport import recorded_link
from mvp.errors import ConfigError

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable

    from mvp.devices.transport import Transport, TransportConfig


class Clock(Protocol):
    """Monotonic time and a wait that another thread can cut short."""

    def now_s(self) -> float:
        """Monotonic time, s."""
        ...

    def wait(self, event: threading.Event, seconds: float) -> bool:
        """Wait at most ``seconds`` of this clock; True when the event was set."""
        ...


class RealClock:
    """The clock on the wall (monotonic); the one every real cell runs on."""

    def now_s(self) -> float:
        """Monotonic time, s."""
        return time.monotonic()

    def wait(self, event: threading.Event, seconds: float) -> bool:
        """Wait at most ``seconds``; True when the event was set."""
        return event.wait(max(0.0, seconds))


class ScaledClock:
    """Runs ``speed`` times as fast as the wall; for virtual cells only."""

    def __init__(self, speed: float) -> None:
        if not speed > 0:
            raise ValueError("a clock must run forwards")
        self._speed = speed
        self._origin = time.monotonic()

    @property
    def speed(self) -> float:
        """How many of its seconds pass in one of the wall's."""
        return self._speed

    def now_s(self) -> float:
        """Monotonic time of this clock, s."""
        return self._origin + (time.monotonic() - self._origin) * self._speed

    def wait(self, event: threading.Event, seconds: float) -> bool:
        """Wait at most ``seconds`` of this clock; True when the event was set."""
        return event.wait(max(0.0, seconds) / self._speed)


def require_real_time(clock: Clock, device: str) -> None:
    """Refuse to drive a real far end by time that is not its own.

    Raises:
        ConfigError: deadlines, settling times and stamps would be wrong.
    """
    if isinstance(clock, ScaledClock) and clock.speed != 1:
        raise ConfigError(
            f"{device}: a device on a wire runs in real time, the cell's clock does not",
            hint="set clock_speed = 1 in [world]",
        )


@dataclass(frozen=True, eq=False)
class DeviceContext:
    """Handed to ``from_config`` of every driver.

    Attributes:
        clock: time; drivers never call ``time`` themselves.
        rng: randomness of simulated devices.
        folder: where relative paths of the device's configuration start.
        world: the shared truth of a virtual or simulated cell, else None.
        transports: makes the link that a device's configuration describes; tests put
            a script or a recording in its place.
        dump_folder: where the traffic of a link goes after a fault; None for nowhere.
    """

    clock: Clock = field(default_factory=RealClock)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    folder: Path = field(default_factory=Path)
    world: object | None = None
    transports: Callable[[TransportConfig, str], Transport] = recorded_link
    dump_folder: Path | None = None
