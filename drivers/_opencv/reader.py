"""A thread that owns a capture, keeps its queue empty and knows how old frames are."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import cv2
    import numpy as np
    from numpy.typing import NDArray

    from mvp.devices import Clock

_SURE = 2  # grabs in a row that had to wait: one alone may be a busy processor


@dataclass(frozen=True)
class Reading:
    """One picture and the earliest moment it can have reached this computer.

    Attributes:
        picture: (rows, columns) or (rows, columns, 3) as the source has it.
        arrived_after_s: lower bound, monotonic.
        received_s: when it was read.
        number: frames read since the source was opened.
    """

    picture: NDArray[np.uint8]
    arrived_after_s: float
    received_s: float
    number: int


class ArrivalBound:
    """When a frame of a first-in-first-out queue arrived, at the earliest.

    A grab that had to wait found the queue empty: its frame came just now. One that
    returned at once took a frame that may have waited since the last time the queue
    was known to be empty.
    """

    def __init__(self, period_s: float) -> None:
        self._waited_s = period_s / 2  # period: the shortest there is
        self._in_a_row = 0
        self._empty_s = -math.inf

    def of_grab(self, began_s: float, ended_s: float) -> float:
        """Lower bound of the arrival of the frame that a grab brought."""
        if ended_s - began_s >= self._waited_s:
            self._in_a_row += 1
        else:
            self._in_a_row = 0
        if self._in_a_row >= _SURE:
            self._empty_s = ended_s
        return self._empty_s


class Reader:
    """Grabs without pause; hands out the first picture that is young enough.

    A picture is handed out when the next one has come, since the last picture of a
    stream that breaks off may have been decoded from half of its bytes.

    Args:
        capture: owned from now on; released by ``stop``.
        period_s: shortest time between two frames; a grab that took half of it had
            to wait.
    """

    def __init__(
        self, capture: cv2.VideoCapture, clock: Clock, *, period_s: float, name: str
    ) -> None:
        self._capture = capture
        self._clock = clock
        self._bound = ArrivalBound(period_s)
        self._lock = threading.Lock()
        self._wanted_s = math.inf
        self._ready: Reading | None = None
        self._lost = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"{name}-reader")

    def start(self) -> None:
        """Begin to grab."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread, at the latest when its present grab times out; release."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        self._capture.release()

    @property
    def lost(self) -> bool:
        """Whether the source has ended."""
        return self._lost

    def want(self, arrived_after_s: float) -> None:
        """Ask for the next picture that arrived at or after a moment."""
        with self._lock:
            self._wanted_s, self._ready = arrived_after_s, None

    def take(self) -> Reading | None:
        """The picture that was asked for, once it is there."""
        with self._lock:
            reading, self._ready = self._ready, None
        return reading

    def forget(self) -> None:
        """Ask for nothing any more."""
        self.want(math.inf)

    def _run(self) -> None:
        number, held = 0, None
        while not self._stop.is_set():
            began_s = self._clock.now_s()
            if not self._capture.grab():
                # A picture that broke off in the middle is the last one that comes:
                # the one held back is not handed out.
                self._lost = True
                return
            received_s = self._clock.now_s()
            if held is not None:
                self._hand_out(held)
            arrived_after_s = self._bound.of_grab(began_s, received_s)
            number += 1
            wanted = arrived_after_s >= self._wanted_s
            held = self._read(arrived_after_s, received_s, number) if wanted else None

    def _read(
        self, arrived_after_s: float, received_s: float, number: int
    ) -> Reading | None:
        """Decode the picture that was grabbed."""
        good, picture = self._capture.retrieve()
        if not good or picture is None:
            return None
        pixels = picture.astype("uint8", copy=False)
        return Reading(pixels, arrived_after_s, received_s, number)

    def _hand_out(self, reading: Reading) -> None:
        with self._lock:
            # The request may have changed since.
            if reading.arrived_after_s >= self._wanted_s:
                self._ready, self._wanted_s = reading, math.inf
