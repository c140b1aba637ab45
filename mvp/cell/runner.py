"""The runner owns the state of a run: order, pause, abort, faults and the end.

It knows no device and no file: the engine executes one view, the journal keeps what
happened. Pause takes effect between two views; abort stops the devices at once. After
an abort or a fault nothing is commanded any more, nothing is retried, nothing returns
home by itself.
"""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, TypeVar

from mvp.cell.records import (
    Captured,
    Fault,
    FinishReason,
    Record,
    RunFinished,
    Verified,
    ViewStarted,
)
from mvp.cell.states import TRANSITIONS, RunState, RunStatus
from mvp.errors import DeviceError, MvpCellError, StoppedByOperator

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mvp.planning.plan import PlannedView

_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)
_STOP_AGAIN_S = 0.05
_STOP_GIVE_UP_S = 10.0


class Engine(Protocol):
    """Executes one view. Every call blocks until done; ``stop`` cuts it short."""

    def prepare(self) -> None:
        """Everything that must be true before the first motion. Moves nothing."""
        ...

    def move(self, view: PlannedView) -> None:
        """Drive the arm to the view and wait until it stands."""
        ...

    def adjust(self, view: PlannedView) -> None:
        """Set the lens and wait until it stands."""
        ...

    def capture(self, view: PlannedView) -> Captured:
        """Take the picture; it is on disk when this returns."""
        ...

    def verify(self, view: PlannedView, captured: Captured) -> Verified:
        """Measure in the picture whether the promise was kept."""
        ...

    def stop(self) -> Sequence[Exception]:
        """Stop every device now, from any thread; returns what failed."""
        ...

    def may_still_move(self) -> str:
        """What an accepted command may still be moving, and until when."""
        ...


class Journal(Protocol):
    """Keeps records; a record is safe when ``write`` returns."""

    def write(self, record: Record) -> None:
        """Keep one record."""
        ...


@dataclass(frozen=True)
class RunOutcome:
    """How a run ended.

    Attributes:
        error: what ended it early, if anything.
        further: errors met while ending it.
        may_still_move: what an accepted command may still be moving, and until when.
        stands: what was seen to stand after everything had been told to stop.
    """

    reason: FinishReason
    verified: tuple[Verified, ...]
    error: Exception | None = None
    further: tuple[Exception, ...] = ()
    may_still_move: str = ""
    stands: str = ""


class Runner:
    """Takes the views of a plan in order, once. See ``mvp.cell.states``.

    Args:
        engine: executes a view.
        journal: where records go.
        views: what to take, in order.
        step: pause before every view.
        on_status: told about every change; its errors are logged and ignored.
    """

    def __init__(
        self,
        engine: Engine,
        journal: Journal,
        views: Sequence[PlannedView],
        *,
        step: bool = False,
        on_status: Callable[[RunStatus], None] | None = None,
    ) -> None:
        self._engine = engine
        self._journal = journal
        self._views = tuple(views)
        self._step = step
        self._on_status = on_status
        self._changed = threading.Condition()
        self._status = RunStatus(RunState.IDLE, None, 0, len(self._views))
        self._pause_asked = False
        self._abort_asked = False
        self._at_device = False
        self._worker: int | None = None
        self._captured = 0
        self._verified: list[Verified] = []

    # ------------------------------------------------------------ any thread

    @property
    def status(self) -> RunStatus:
        """Where the run is now."""
        with self._changed:
            return self._status

    def pause(self) -> None:
        """Stop before the next view."""
        with self._changed:
            self._pause_asked = True
        _LOG.info("run: told to pause before the next view")

    def resume(self) -> None:
        """Go on after a pause."""
        _LOG.info("run: told to go on")
        with self._changed:
            self._pause_asked = False
            if self._status.state is RunState.PAUSED:
                self._enter_locked(RunState.MOVING)

    def abort(self) -> None:
        """Stop every device now; returns once no device call is in progress.

        A command that slipped past the flag just before it was set is met by stopping
        again until the worker has come back.
        """
        with self._changed:
            self._abort_asked = True
            self._changed.notify_all()
        _LOG.warning("run: told to stop now")
        self._stop_devices()
        if threading.get_ident() == self._worker:
            return
        deadline = time.monotonic() + _STOP_GIVE_UP_S
        while not self._quiet() and time.monotonic() < deadline:
            self._stop_devices()

    def wait(
        self, condition: Callable[[RunStatus], bool], *, timeout_s: float
    ) -> RunStatus:
        """Wait until a status fulfils the condition, at most ``timeout_s``."""
        with self._changed:
            self._changed.wait_for(lambda: condition(self._status), timeout_s)
            return self._status

    # ------------------------------------------------------------ the worker

    def run(self) -> RunOutcome:
        """Take every view; blocks until the run has ended, and never raises.

        Raises:
            RuntimeError: called a second time.
        """
        self._worker = threading.get_ident()
        self._enter(RunState.PREPARING)
        error = self._guarded(self._take_views)
        reason = self._reason(error)
        moving = "" if error is None else self._engine.may_still_move()
        further = self._finish(reason, error, moving)
        if error is None and further:
            # Done, but not written down that it is.
            reason, (error, *further) = "error", further
        verified = tuple(self._verified)
        return RunOutcome(reason, verified, error, tuple(further), moving)

    def _take_views(self) -> None:
        self._device(self._engine.prepare)
        for view in self._views:
            self._boundary(view)
            self._take(view)

    def _take(self, view: PlannedView) -> None:
        self._refuse_if_aborted()
        self._journal.write(ViewStarted(view=view.id))
        self._device(lambda: self._engine.move(view))
        self._enter(RunState.ADJUSTING)
        self._device(lambda: self._engine.adjust(view))
        self._enter(RunState.CAPTURING)
        captured = self._device(lambda: self._engine.capture(view))
        self._journal.write(captured)
        self._captured += 1
        self._enter(RunState.VERIFYING)
        verified = self._engine.verify(view, captured)
        self._journal.write(verified)
        self._verified.append(verified)
        self._advance()

    def _boundary(self, view: PlannedView) -> None:
        """Where a pause takes effect."""
        with self._changed:
            self._status = replace(self._status, view=view.id)
            paused = (self._pause_asked or self._step) and not self._abort_asked
            if paused:
                self._pause_asked = True
                self._enter_locked(RunState.PAUSED)
        if paused:
            self._tell()
        with self._changed:
            if paused:
                self._changed.wait_for(
                    lambda: self._abort_asked or not self._pause_asked
                )
            self._refuse_if_aborted_locked()
            if self._status.state is not RunState.MOVING:
                self._enter_locked(RunState.MOVING)
        self._tell()

    def _device(self, call: Callable[[], _T]) -> _T:
        """Call the engine, unless the run was aborted."""
        with self._changed:
            self._refuse_if_aborted_locked()
            self._at_device = True
        try:
            return call()
        finally:
            with self._changed:
                self._at_device = False
                self._changed.notify_all()

    def _advance(self) -> None:
        with self._changed:
            self._status = replace(self._status, index=self._status.index + 1)
            self._changed.notify_all()

    def _refuse_if_aborted(self) -> None:
        with self._changed:
            self._refuse_if_aborted_locked()

    def _refuse_if_aborted_locked(self) -> None:
        if self._abort_asked:
            raise StoppedByOperator("the run was stopped by the operator")

    def _guarded(self, call: Callable[[], None]) -> Exception | None:
        try:
            call()
        except Exception as error:
            return error
        return None

    def _reason(self, error: Exception | None) -> FinishReason:
        if error is None:
            return "completed"
        with self._changed:
            aborted = self._abort_asked
        if aborted and isinstance(error, StoppedByOperator | DeviceError):
            return "aborted"
        return "fault" if isinstance(error, DeviceError) else "error"

    def _finish(
        self, reason: FinishReason, error: Exception | None, may_still_move: str
    ) -> list[Exception]:
        """Stop what may move, record why, and record the end as the last line."""
        self._enter(RunState.FINISHING)
        further: list[Exception] = []
        if error is not None:
            _log_end(error, reason, may_still_move)
            further += self._stop_devices()
            fault = _fault(error, may_still_move)
            further += _present(self._guarded(lambda: self._journal.write(fault)))
        passed = sum(v.verdict == "pass" for v in self._verified)
        end = RunFinished(
            reason=reason, views_captured=self._captured, views_passed=passed
        )
        further += _present(self._guarded(lambda: self._journal.write(end)))
        with self._changed:
            self._status = replace(self._status, reason=reason)
        self._enter(RunState.FINISHED)
        _LOG.info(
            "run: ended (%s), %d captured, %d passed", reason, self._captured, passed
        )
        return further

    # ------------------------------------------------------------ helpers

    def _stop_devices(self) -> list[Exception]:
        try:
            return list(self._engine.stop())
        except Exception as error:
            _LOG.exception("run: stopping the devices failed")
            return [error]

    def _quiet(self) -> bool:
        with self._changed:
            return self._changed.wait_for(
                lambda: not self._at_device, timeout=_STOP_AGAIN_S
            )

    def _enter(self, state: RunState) -> None:
        with self._changed:
            self._enter_locked(state)
        self._tell()

    def _enter_locked(self, state: RunState) -> None:
        if state not in TRANSITIONS[self._status.state]:
            raise RuntimeError(
                f"a run cannot go from {self._status.state.value} to {state.value}"
            )
        self._status = replace(self._status, state=state)
        self._changed.notify_all()

    def _tell(self) -> None:
        status = self.status
        _LOG.info(
            "run: %s, view %s, %d of %d done",
            status.state.value,
            status.view or "none yet",
            status.index,
            status.total,
        )
        if self._on_status is None:
            return
        try:
            self._on_status(status)
        except Exception:
            _LOG.exception("a status listener failed")


def _log_end(error: Exception, reason: FinishReason, may_still_move: str) -> None:
    """Why a run ended early; with a traceback where it is a defect of ours."""
    _LOG.error(
        "run: %s: %s: %s%s",
        reason,
        type(error).__name__,
        error,
        f"; may still move: {may_still_move}" if may_still_move else "",
        exc_info=None if isinstance(error, MvpCellError) else error,
    )


def _fault(error: Exception, may_still_move: str) -> Fault:
    where = error.where if isinstance(error, MvpCellError) else ""
    return Fault(
        kind=type(error).__name__,
        where=where,
        message=str(error),
        may_still_move=may_still_move,
    )


def _present(error: Exception | None) -> list[Exception]:
    return [] if error is None else [error]
