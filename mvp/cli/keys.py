"""Single keys from the terminal, without waiting for the end of a line."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

_SLICE_S = 0.05


@contextmanager
def leaving() -> Iterator[Callable[[float], bool]]:
    """Yields what waits so many seconds, and says whether the person wants to leave.

    Enter, q, Ctrl-C and the end of the input mean that. Ctrl-C means nothing more
    meanwhile; the end of the program by other signals stays what it was.
    """
    left = threading.Event()
    with _ctrl_c(left), _single_keys():

        def waited(seconds: float) -> bool:
            end_s = time.monotonic() + seconds
            while not left.is_set() and (left_s := end_s - time.monotonic()) > 0:
                if _key_within(min(left_s, _SLICE_S)) in _LEAVE:
                    left.set()
            return left.is_set()

        yield waited


_LEAVE = (b"\n", b"\r", b"q", b"Q", b"\x04", b"")


def _key_within(seconds: float) -> bytes | None:
    """A key; empty for the end of the input, None for none."""
    if sys.platform == "win32":
        time.sleep(seconds)
        return None
    import select

    if not select.select([sys.stdin], [], [], seconds)[0]:
        return None
    return os.read(sys.stdin.fileno(), 1)


@contextmanager
def _ctrl_c(left: threading.Event) -> Iterator[None]:
    """Ctrl-C leaves, and does not end the program."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def leave(number: int, frame: FrameType | None) -> None:
        left.set()

    before = signal.signal(signal.SIGINT, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _single_keys() -> Iterator[None]:
    """Keys arrive as they are pressed, and are not shown."""
    if sys.platform == "win32":
        yield
        return
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal, termios.TCSANOW)
    try:
        yield
    finally:
        termios.tcsetattr(terminal, termios.TCSANOW, before)
