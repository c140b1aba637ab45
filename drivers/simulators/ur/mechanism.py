"""The moving arm: what it runs, how fast the slider lets it, where it is."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from drivers.simulators.ur.motion import Brake, Motion

if TYPE_CHECKING:
    from drivers.simulators.ur.poses import Floats
    from drivers.simulators.ur.stream import Stream

_RATE_RAMP_S = 0.2
_PROGRAM_STOP_RAD_S2 = 4.0


class Mechanism:
    """Joints of one arm, advanced cycle by cycle.

    A move runs in its own time, which the speed slider slows down; a hold (pause,
    safeguard, protective stop) lets that time run out within 0.2 s and keeps the move.

    Args:
        joints: (6,) rad at the start.
        speed_scale: moves take this many times less time than the controller says.
    """

    def __init__(self, joints: Floats, *, speed_scale: float = 1.0) -> None:
        self.joints = np.array(joints, dtype=np.float64)
        self.rate = np.zeros(6)
        self.acceleration = np.zeros(6)
        self.slider = 1.0
        self.held = False
        self.begun = 0
        self._scale = speed_scale
        self._scaling = 1.0
        self._queue: deque[Motion] = deque()
        self._time_s = 0.0
        self._stream: Stream | None = None
        self._stream_left_s = 0.0

    @property
    def idle(self) -> bool:
        """Nothing left to run."""
        return not self._queue and self._stream is None

    @property
    def streaming(self) -> bool:
        """Whether a stream drives it: that knows no limits of its own."""
        return self._stream is not None

    @property
    def standing(self) -> bool:
        """No joint turns."""
        return not any(self.rate.tolist())

    @property
    def scaling(self) -> float:
        """By how much moves are slowed down now, 0 .. 1."""
        return self._scaling

    @property
    def time_s(self) -> float:
        """How far into the present move, in the move's own time."""
        return self._time_s

    @property
    def current(self) -> Motion | None:
        """The move that is running."""
        return self._queue[0] if self._queue else None

    def will_stand_at(self) -> Floats:
        """Where the arm comes to rest when it brakes for a new move."""
        return self._braked().at(np.inf)

    def begin(self, motion: Motion) -> None:
        """Run a move that starts at ``will_stand_at``; brake first if need be."""
        first = self._braked()
        self.drop()
        if first.duration_s > 0:
            self._queue.append(first)
        self._queue.append(motion)
        self.begun += 1

    def follow(self, stream: Stream, seconds: float = np.inf) -> None:
        """Let a stream drive the arm for some time."""
        if self._stream is None:
            self.begun += 1
        self._queue.clear()
        self._stream, self._stream_left_s = stream, seconds

    def halt(self, stop: Brake | None = None) -> None:
        """Replace whatever runs by a brake; without one as when a program is stopped."""
        halting = stop or self._braked()
        self.drop()
        if halting.duration_s > 0:
            self._queue.append(halting)

    def drop(self) -> None:
        """Forget every move."""
        self._queue.clear()
        self._stream = None
        self._time_s = 0.0

    def tick(self, dt_s: float) -> None:
        """One control cycle."""
        before, rate = self.joints, self.rate
        self._ramp(dt_s)
        if self._stream is not None:
            self._stream_step(self._stream, dt_s)
        elif self._queue:
            self._move_step(dt_s)
        elif self.standing:
            self.acceleration = rate
            return
        self.rate = (self.joints - before) / dt_s
        self.acceleration = (self.rate - rate) / dt_s

    def scaled_deceleration(self, deceleration: float) -> float:
        """A deceleration of the controller in this arm's faster time."""
        return deceleration * self._scale**2

    def _braked(self) -> Brake:
        deceleration = self.scaled_deceleration(_PROGRAM_STOP_RAD_S2)
        return Brake(
            self.joints, self.rate, float(np.abs(self.rate).max()) / deceleration
        )

    def _ramp(self, dt_s: float) -> None:
        """Bring the scaling towards the slider, or to zero while held."""
        wanted = 0.0 if self.held else self.slider
        step = dt_s / _RATE_RAMP_S
        self._scaling += min(max(wanted - self._scaling, -step), step)

    def _move_step(self, dt_s: float) -> None:
        motion = self._queue[0]
        # A brake already runs in real time.
        pace = 1.0 if isinstance(motion, Brake) else self._scaling * self._scale
        self._time_s += dt_s * pace
        self.joints = np.asarray(motion.at(self._time_s))
        if self._time_s >= motion.duration_s:
            self._queue.popleft()
            self._time_s = 0.0

    def _stream_step(self, stream: Stream, dt_s: float) -> None:
        self._stream_left_s -= dt_s
        over = self._stream_left_s <= 0
        wanted = np.zeros(6) if over else stream.wanted(self.joints) * self._scaling
        step = stream.acceleration * dt_s
        rate = self.rate + np.clip(wanted - self.rate, -step, step)
        self.joints = self.joints + rate * dt_s
        if over and not rate.any():
            self._stream = None
