"""Let what moves work beside the caller's thread, which stays free for Ctrl-C."""

from __future__ import annotations

import logging
import threading
import time
from concurrent.futures import Future
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.runner import Runner, RunOutcome

_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)
_STOP_AGAIN_S = 0.05
_LOOK_S = 0.1
_GIVE_UP_S = 30.0


class _Beside:
    """A thread that begins when it is told to.

    A Ctrl-C while a thread is being started leaves it open whether it runs; here nothing
    has begun then.
    """

    def __init__(self, work: Callable[[], None], name: str, *, daemon: bool) -> None:
        self._work = work
        self._go = threading.Event()
        self._cancelled = False
        self.done = threading.Event()
        try:
            threading.Thread(target=self._run, name=name, daemon=daemon).start()
        except BaseException:
            self.cancel()
            raise

    @property
    def begun(self) -> bool:
        """Whether it was told to begin."""
        return self._go.is_set()

    def begin(self) -> None:
        """Let it begin; safe to repeat."""
        self._go.set()

    def cancel(self) -> None:
        """Let it end without having begun."""
        self._cancelled = True
        self._go.set()

    def _run(self) -> None:
        self._go.wait()
        try:
            if not self._cancelled:
                self._work()
        finally:
            self.done.set()


def _abort(runner: Runner) -> None:
    runner.abort()


def run_beside(runner: Runner, follow: Callable[[Runner], None]) -> RunOutcome:
    """Run in a thread of its own until the end; Ctrl-C, once or often, stops it.

    Args:
        runner: not yet started.
        follow: called in this thread; may return early or raise KeyboardInterrupt. When
            it fails nobody watches any more, and the run is stopped, too.

    Raises:
        RuntimeError: the thread died without an outcome.
    """
    outcomes: list[RunOutcome] = []
    beside = _Beside(
        lambda: outcomes.append(runner.run()), "mvp-cell run", daemon=False
    )
    failures: list[Exception] = []
    serve: Callable[[Runner], object] = follow
    ended = False
    while not ended:
        # Another Ctrl-C may come while the first one is still being served. Not
        # Thread.join, which takes a thread for dead when it is interrupted.
        try:
            beside.begin()
            serve(runner)
            ended = beside.done.wait()
        except KeyboardInterrupt:
            serve = _abort
        except Exception as error:
            _LOG.exception("run: nobody watches it any more")
            failures.append(error)
            serve = _abort if len(failures) == 1 else _leave
    if not outcomes:
        raise RuntimeError("the run ended without an outcome")
    return replace(outcomes[0], further=(*outcomes[0].further, *failures))


def _leave(runner: Runner) -> None:
    """Stopping itself has failed: wait for the end."""


def _wait_s(
    ended_by: BaseException | None, meanwhile: Callable[[], None] | None
) -> float | None:
    """Until the next look; None: nobody looks."""
    if ended_by is not None:
        return _STOP_AGAIN_S
    return None if meanwhile is None else _LOOK_S


def _tell(stop: Callable[[], object]) -> None:
    """A stop that fails is tried again."""
    try:
        stop()
    except Exception as error:
        _LOG.error("stopping failed: %s", error)


def call_beside(
    call: Callable[[], _T],
    stop: Callable[[], object],
    meanwhile: Callable[[], None] | None = None,
) -> _T:
    """Do something that moves in a thread of its own; Ctrl-C, once or often, stops it.

    A Ctrl-C that hit the driver itself would tear it out of the motion that it watches;
    here the driver is told to stop, as in a run, and ends its motion in its own way.

    Args:
        call: what to do.
        stop: stops the devices, from any thread; called until ``call`` has come back.
        meanwhile: called in this thread several times per second until then, but not
            after a Ctrl-C. Where it fails nobody watches any more: that stops it, too.

    Raises:
        KeyboardInterrupt: after ``call`` has come back, or has not for 30 s.
        Whatever ``meanwhile`` or ``call`` raises.
    """
    outcome: Future[_T] = Future()

    def work() -> None:
        try:
            outcome.set_result(call())
        except BaseException as error:
            outcome.set_exception(error)

    beside = _Beside(work, "mvp-cell motion", daemon=True)
    ended_by: BaseException | None = None
    give_up_s = float("inf")
    while time.monotonic() < give_up_s:
        try:
            if ended_by is not None:
                _tell(stop)
            beside.begin()
            if beside.done.wait(_wait_s(ended_by, meanwhile)):
                break
            if meanwhile is not None and ended_by is None:
                meanwhile()
        except (KeyboardInterrupt, Exception) as error:
            if not beside.begun:
                beside.cancel()
                raise
            if ended_by is None:
                give_up_s = time.monotonic() + _GIVE_UP_S
            ended_by = ended_by or error
    if ended_by is not None:
        raise ended_by
    return outcome.result()
