"""What a controller says unasked, kept for whoever waits for the next of its kind."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers._gantry.wire import Report
    from mvp.devices import Clock


class Arrivals:
    """Reports and banners; the reader's thread brings them, others wait.

    Args:
        clock: what waiting is measured with.

    Attributes:
        last: the newest report.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._waiting: set[threading.Event] = set()
        self._reports = self._banners = self._signs = 0
        self.last: Report | None = None

    def forget(self) -> None:
        """Another connection: nothing was reported yet."""
        with self._lock:
            self.last = None

    def report(self, report: Report) -> None:
        """A report came."""
        with self._lock:
            self.last = report
            self._reports += 1
        self._tell()

    def banner(self) -> None:
        """The controller greeted."""
        with self._lock:
            self._banners += 1
        self._tell()

    def sign(self) -> None:
        """Something came that only such a controller says; or nothing will any more."""
        with self._lock:
            self._signs += 1
        self._tell()

    def next_report(
        self, ask: Callable[[], None], gone: Callable[[], bool], limit_s: float
    ) -> Report | None:
        """The first report after asking; None when none came in time."""
        before = self._reports
        ask()
        self._wait_for(lambda: self._reports != before or gone(), limit_s)
        with self._lock:
            return self.last if self._reports != before else None

    def next_banner(self, ask: Callable[[], None], limit_s: float) -> bool:
        """Whether it greeted after being asked to."""
        before = self._banners
        ask()
        return self._wait_for(lambda: self._banners != before, limit_s)

    def next_sign(self, ask: Callable[[], None], limit_s: float) -> bool:
        """Whether anything came after asking that only such a controller says."""
        before = self._signs
        ask()
        return self._wait_for(lambda: self._signs != before, limit_s)

    def _tell(self) -> None:
        with self._lock:
            for news in self._waiting:
                news.set()

    def _wait_for(self, come: Callable[[], bool], limit_s: float) -> bool:
        """Whether it came before the time was over; each waits on its own event."""
        end_s = self._clock.now_s() + limit_s
        news = threading.Event()
        with self._lock:
            self._waiting.add(news)
        try:
            while not come():
                left_s = end_s - self._clock.now_s()
                if left_s <= 0:
                    return False
                self._clock.wait(news, left_s)
                news.clear()
            return True
        finally:
            with self._lock:
                self._waiting.discard(news)
