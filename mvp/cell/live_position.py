"""Where what moves is: asked again and again, beside the motion and beside who looks."""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING, Self

from mvp.devices import RealClock
from mvp.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.devices import Clock

_LOG = logging.getLogger(__name__)
_EVERY_S = 0.2  # GRBL asks for no more than five questions a second while it moves
_LEAVE_S = 3.0


class LivePosition:
    """Asks in a thread of its own: an answer that does not come keeps nobody waiting.

    Args:
        ask: says where it is; empty while nothing moves. May raise ``DeviceError``.
        clock: of whoever looks.
        every_s: pause before each question.
    """

    def __init__(
        self,
        ask: Callable[[], str],
        clock: Clock | None = None,
        every_s: float = _EVERY_S,
    ) -> None:
        self._ask = ask
        self._clock = clock or RealClock()
        self._every_s = every_s
        self._ending = threading.Event()
        self._text = ""
        self._since_s: float | None = None
        self._thread = threading.Thread(
            target=self._run, name="mvp-cell position", daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *exc: object) -> None:
        self.end()
        if kind is None:  # otherwise something is to be stopped, which cannot wait
            self._thread.join(_LEAVE_S)

    @property
    def text(self) -> str:
        """How long it moves, and where it was a moment ago; empty when nothing moves."""
        return self._text

    def end(self) -> None:
        """Ask no more; returns at once, from any thread."""
        self._ending.set()

    def _run(self) -> None:
        while not self._clock.wait(self._ending, self._every_s):
            try:
                self._text = self._timed(self._ask())
            except DeviceError as error:
                self._text = self._timed(
                    f"cannot be asked where it is now: {error.detail}"
                )
            except Exception:
                _LOG.exception("the position cannot be followed any more")
                self._text = ""
                return

    def _timed(self, said: str) -> str:
        now_s = self._clock.now_s()
        if not said:
            self._since_s = None
            return ""
        if self._since_s is None:
            self._since_s = now_s - self._every_s
        return f"{now_s - self._since_s:.1f} s: {said}"
