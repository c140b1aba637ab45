"""Checks of the conformance suites; they hold with ``python -O`` as well."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from mvp.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_Error = TypeVar("_Error", bound=BaseException)
_PATIENCE_S = 20.0
_POLL_S = 0.001
_WATCH_S = 0.02


def require(condition: object, message: str) -> None:
    """Fail the test with a message unless the condition holds."""
    if not condition:
        raise AssertionError(message)


def refuses(kind: type[_Error], action: Callable[[], object]) -> _Error:
    """Run an action that must raise ``kind``; returns what was raised."""
    try:
        result = action()
    except kind as error:
        return error
    raise AssertionError(f"{kind.__name__} expected, got {result!r}")


def wait_until(condition: Callable[[], bool], what: str) -> None:
    """Poll until a condition holds, for at most 20 s of the wall's time."""
    deadline = time.monotonic() + _PATIENCE_S
    while not condition():
        require(time.monotonic() < deadline, f"never happened: {what}")
        time.sleep(_POLL_S)


def meanwhile(
    action: Callable[[], object],
    ready: Callable[[], bool],
    interrupt: Callable[[], None],
) -> BaseException | object:
    """Run ``action``, call ``interrupt`` from another thread once ``ready``.

    Returns:
        What the action returned, or the exception that it raised.
    """
    outcome: list[BaseException | object] = []

    def run() -> None:
        try:
            outcome.append(action())
        except BaseException as error:
            outcome.append(error)

    worker = threading.Thread(target=run, name="conformance")
    worker.start()
    try:
        wait_until(lambda: bool(outcome) or ready(), "the device got busy")
        interrupt()
    finally:
        worker.join(_PATIENCE_S)
    require(not worker.is_alive(), "the action never came back")
    return outcome[0]


@contextmanager
def watched(ask: Callable[[], object]) -> Iterator[None]:
    """Ask a device again and again from another thread, as one who follows a motion.

    It may refuse to answer with a ``DeviceError``; anything else fails the test.
    """
    ending = threading.Event()
    failures: list[BaseException] = []

    def watch() -> None:
        while not failures and not ending.wait(_WATCH_S):
            try:
                ask()
            except DeviceError:
                continue
            except BaseException as error:
                failures.append(error)

    watcher = threading.Thread(target=watch, name="conformance watcher")
    watcher.start()
    try:
        yield
    finally:
        ending.set()
        watcher.join(_PATIENCE_S)
    require(not watcher.is_alive(), "a question during a motion never came back")
    require(not failures, f"asked during a motion it raised {failures}")


def nothing_in_the_way(start: tuple[float, ...], end: tuple[float, ...]) -> None:
    """Judges a motion of homing where a test has nothing that could be touched."""
