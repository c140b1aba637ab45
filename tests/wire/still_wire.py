"""A far end that damages its answers, and a clock that stands still meanwhile.

A driver that waits for what never comes has waited at once, however long its deadline:
conversations by the hundred thousand, and the same each time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from mvp.devices import DeviceContext
from mvp.testing import FarEnd
from tests.fuzzing import Mutants, fuzz

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable, Sequence

_STUCK_S = 60.0


class StillClock:
    """A ``Clock`` that goes on only while somebody waits and nothing is on its way."""

    def __init__(self, far_end: FarEnd) -> None:
        self._far_end = far_end
        self._now_s = 1000.0

    def now_s(self) -> float:
        """Time that passes only while somebody waits."""
        return self._now_s

    def wait(self, event: threading.Event, seconds: float) -> bool:
        """Until everything that was said has been read; then the time is over."""
        if not self._far_end.wait_heard(_STUCK_S):
            raise RuntimeError("the reader does not come back")
        if event.is_set():
            return True
        self._now_s += max(seconds, 1e-4)
        return False


class Damaged:
    """A far end that damages some of its answers.

    Args:
        answer: what it would say.
        good: what is damaged where nobody asked for anything.
        meant: pieces that mean something to the driver.

    Attributes:
        share: of the answers that are damaged.
    """

    def __init__(
        self,
        answer: Callable[[bytes], bytes],
        good: Sequence[bytes],
        meant: Sequence[bytes],
    ) -> None:
        self.far_end = FarEnd("fuzzed", self._answer)
        self.share = 0.0
        self.mutants = Mutants(good, meant)
        self._good_answer = answer

    def context(self) -> DeviceContext:
        """For the driver."""
        clock = StillClock(self.far_end)
        return DeviceContext(transports=self.far_end.as_link, clock=clock)

    def _answer(self, sent: bytes) -> bytes:
        said = self._good_answer(sent)
        damaged = self.mutants.rng.random() < self.share
        return self.mutants.next(said) if damaged else said


class Opens(Protocol):
    """What a device is here."""

    def open(self) -> None: ...

    def close(self) -> None: ...


def fuzz_conversations(
    device: Opens,
    damaged: Damaged,
    converse: Callable[[bytes], None],
    check: Callable[[], None],
) -> None:
    """100,000 damaged answers and greetings; it works as ever after each round.

    Args:
        device: not open.
        damaged: what it talks to.
        converse: opens the device and does all that it can, each time answered by
            anything; gets what nobody asked for.
        check: that the device, opened anew, gets the right answers.
    """

    def survived(unasked: bytes) -> None:
        converse(unasked)
        damaged.share = 0.0
        damaged.far_end.sent.clear()
        device.close()
        device.open()
        check()
        device.close()

    fuzz(survived, damaged.mutants)
