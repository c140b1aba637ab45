"""What a controller says unasked, kept for whoever waits for the next of its kind."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers._gantry.wire import Report


class Arrivals:
    """Reports and banners; the reader's thread brings them, others wait.

    Attributes:
        last: the newest report.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._reports = self._banners = self._signs = 0
        self.last: Report | None = None

    def forget(self) -> None:
        """Another connection: nothing was reported yet."""
        with self._changed:
            self.last = None

    def report(self, report: Report) -> None:
        """A report came."""
        with self._changed:
            self.last = report
            self._reports += 1
            self._changed.notify_all()

    def banner(self) -> None:
        """The controller greeted."""
        with self._changed:
            self._banners += 1
            self._changed.notify_all()

    def sign(self) -> None:
        """Something came that only such a controller says; or nothing will any more."""
        with self._changed:
            self._signs += 1
            self._changed.notify_all()

    def next_report(
        self, ask: Callable[[], None], gone: Callable[[], bool], limit_s: float
    ) -> Report | None:
        """The first report after asking; None when none came in time."""
        before = self._reports
        ask()
        with self._changed:
            self._changed.wait_for(lambda: self._reports != before or gone(), limit_s)
            return self.last if self._reports != before else None

    def next_banner(self, ask: Callable[[], None], limit_s: float) -> bool:
        """Whether it greeted after being asked to."""
        before = self._banners
        ask()
        with self._changed:
            return self._changed.wait_for(lambda: self._banners != before, limit_s)

    def next_sign(self, ask: Callable[[], None], limit_s: float) -> bool:
        """Whether anything came after asking that only such a controller says."""
        before = self._signs
        ask()
        with self._changed:
            return self._changed.wait_for(lambda: self._signs != before, limit_s)
