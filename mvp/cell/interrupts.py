"""Keep Ctrl-C out of the few moments that must not be cut short."""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

# The end of the terminal, which not every system tells, ends a command as Ctrl-C does:
# a process that just died would leave the arm moving.
ENDING = tuple(
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)
)
_SIGNALS = (signal.SIGINT, *ENDING)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ignore Ctrl-C and its like meanwhile; nothing to do outside the main thread.

    Only for what ends by itself within moments.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = [signal.signal(number, signal.SIG_IGN) for number in _SIGNALS]
    try:
        yield
    finally:
        for number, handler in zip(_SIGNALS, before, strict=True):
            signal.signal(number, handler)
