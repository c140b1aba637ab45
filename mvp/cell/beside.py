"""Let a run work beside the caller's thread, which stays free for Ctrl-C."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.runner import Runner, RunOutcome


def _abort(runner: Runner) -> None:
    runner.abort()


def run_beside(runner: Runner, follow: Callable[[Runner], None]) -> RunOutcome:
    """Run in a thread of its own until the end; Ctrl-C, once or often, stops it.

    Args:
        runner: not yet started.
        follow: called in this thread; may return early or raise KeyboardInterrupt.

    Raises:
        RuntimeError: the thread died without an outcome.
    """
    outcomes: list[RunOutcome] = []
    done = threading.Event()

    def work() -> None:
        try:
            outcomes.append(runner.run())
        finally:
            done.set()

    threading.Thread(target=work, name="mvp-cell run").start()
    serve = follow
    ended = False
    while not ended:
        # Another Ctrl-C may come while the first one is still being served. Not
        # Thread.join, which takes a thread for dead when it is interrupted.
        try:
            serve(runner)
            ended = done.wait()
        except KeyboardInterrupt:
            serve = _abort
    if not outcomes:
        raise RuntimeError("the run ended without an outcome")
    return outcomes[0]
