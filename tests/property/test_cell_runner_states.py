"""The runner against random orders of pause, resume, abort and faults.

The engine is a fake at the protocol seam that blocks inside every call until the test
lets it go, so that every interleaving of a person and the worker can be played.
"""

from __future__ import annotations

import itertools
import threading
import time

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
)

from mvp.cell.records import (
    Captured,
    CaptureTimes,
    Fault,
    Reached,
    Record,
    RunFinished,
    Verified,
)
from mvp.cell.runner import Runner, RunOutcome
from mvp.cell.states import TRANSITIONS, RunState, RunStatus
from mvp.errors import DeviceFault, MotionStopped
from mvp.planning.plan import LensSteps, PlannedView, Tolerance

UNIT = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]
PATIENCE_S = 5.0


def planned_view(number: int) -> PlannedView:
    return PlannedView(
        id=f"v{number}",
        features=["edge"],
        part_from_camera=UNIT,
        base_from_tool=UNIT,
        position_mm=(0, 0, 0),
        view_direction=(0, 0, 1),
        roll_rad=0,
        f_mm=12.5,
        d_mm=13,
        a_mm=1,
        pupil_offset_mm=0,
        lens_steps=LensSteps(zoom=1, focus=2, iris=3),
        joints_rad=[0.0],
        exposure_s=0.01,
        margins={},
        binding="resolution",
        tolerance=Tolerance(position_mm=1, angle_deg=1, d_mm=0.01, method="certified"),
    )


def captured(view: str) -> Captured:
    return Captured(
        view=view,
        image=f"images/{view}.png",
        sha256="0" * 64,
        full_scale=255,
        exposure_s=0.01,
        gain=1,
        exposure_source="task",
        frame_id=1,
        dropped=0,
        asked_joints=[0.0],
        asked_lens_steps={"zoom": 1},
        reached=Reached(joints=[0.0], base_from_tool=UNIT, lens_steps={"zoom": 1}),
        times=CaptureTimes(
            arm_standing_s=0,
            lens_standing_s=0,
            not_before_s=0,
            exposure_start_s=0,
            received_s=0,
        ),
    )


class SteppedEngine:
    """Blocks in every device call until ``step`` or ``stop``."""

    def __init__(self) -> None:
        self.turn = threading.Condition()
        self.inside: str | None = None
        self.allowed = 0
        self.stopped = False
        self.fault_next = False
        self.began: list[str] = []
        self.stops = 0

    def _call(self, name: str) -> None:
        with self.turn:
            self.began.append(name)
            self.inside = name
            self.stopped = False
            self.turn.notify_all()
            self.turn.wait_for(lambda: self.allowed or self.stopped, PATIENCE_S)
            self.inside = None
            self.turn.notify_all()
            if self.stopped:
                raise MotionStopped("stopped", device="arm")
            self.allowed -= 1
            if self.fault_next:
                self.fault_next = False
                raise DeviceFault("broken", device="arm")

    def prepare(self) -> None:
        self._call("prepare")

    def move(self, view: PlannedView) -> None:
        self._call(f"move {view.id}")

    def adjust(self, view: PlannedView) -> None:
        self._call(f"adjust {view.id}")

    def capture(self, view: PlannedView) -> Captured:
        self._call(f"capture {view.id}")
        return captured(view.id)

    def verify(self, view: PlannedView, record: Captured) -> Verified:
        return Verified(view=view.id, verdict="pass", cause=None, verification={})

    def stop(self) -> list[Exception]:
        with self.turn:
            self.stops += 1
            self.stopped = True
            self.turn.notify_all()
        return []

    def may_still_move(self) -> str:
        return ""

    def step(self) -> None:
        """Let the call in progress finish, and wait for what follows."""
        with self.turn:
            before = len(self.began)
            self.allowed += 1
            self.turn.notify_all()
            self.turn.wait_for(
                lambda: self.inside is None or len(self.began) > before, PATIENCE_S
            )


class Journal:
    def __init__(self) -> None:
        self.records: list[Record] = []

    def write(self, record: Record) -> None:
        self.records.append(record)


class RunnerMachine(RuleBasedStateMachine):
    @initialize(views=st.integers(0, 3), step=st.booleans())
    def begin(self, views: int, step: bool) -> None:
        self.engine = SteppedEngine()
        self.journal = Journal()
        self.seen: list[RunStatus] = []
        self.runner = Runner(
            self.engine,
            self.journal,
            [planned_view(i) for i in range(views)],
            step=step,
            on_status=self.seen.append,
        )
        self.outcome: list[RunOutcome] = []
        self.began_at_abort: int | None = None
        self.faulted = False
        self.worker = threading.Thread(
            target=lambda: self.outcome.append(self.runner.run())
        )
        self.worker.start()

    def _settle(self) -> None:
        """Until the worker waits in a device call or a pause, or has ended."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            waits = self.engine.inside is not None and not self.engine.stopped
            if waits or self.runner.status.state is RunState.PAUSED:
                return
            if not self.worker.is_alive():
                return
            time.sleep(0.0005)

    @precondition(lambda self: self.engine.inside is not None)
    @rule()
    def let_go(self) -> None:
        self._settle()
        if self.engine.inside is not None:
            self.engine.step()
        self._settle()

    @precondition(lambda self: self.engine.inside is not None)
    @rule()
    def fail(self) -> None:
        self._settle()
        if self.engine.inside is None:
            return
        self.engine.fault_next = True
        self.engine.step()
        self.worker.join(PATIENCE_S)
        self.faulted = True
        self.began_at_abort = len(self.engine.began)

    @rule()
    def pause(self) -> None:
        self.runner.pause()

    @rule()
    def resume(self) -> None:
        self.runner.resume()
        self._settle()

    @rule()
    def abort(self) -> None:
        self.runner.abort()
        if self.began_at_abort is None:
            self.began_at_abort = len(self.engine.began)

    @invariant()
    def nothing_is_commanded_after_abort_or_fault(self) -> None:
        if getattr(self, "began_at_abort", None) is not None:
            assert len(self.engine.began) == self.began_at_abort

    @invariant()
    def every_transition_is_in_the_table(self) -> None:
        states = [s.state for s in getattr(self, "seen", [])]
        for before, after in itertools.pairwise(states):
            # Resume passes from paused to moving before the listener is told.
            assert after is before or _follows(before, after)

    def teardown(self) -> None:
        if not hasattr(self, "runner"):
            return
        aborted = self.began_at_abort is not None
        deadline = time.monotonic() + PATIENCE_S
        while self.worker.is_alive() and time.monotonic() < deadline:
            self.runner.resume()
            if self.engine.inside is not None:
                self.engine.step()
            time.sleep(0.0005)
        self.worker.join(PATIENCE_S)
        assert not self.worker.is_alive()
        last = self.journal.records[-1]
        assert isinstance(last, RunFinished)
        assert self.runner.status.state is RunState.FINISHED
        faults = [r for r in self.journal.records if isinstance(r, Fault)]
        if self.faulted:
            assert last.reason == "fault"
            assert faults
        elif not aborted:
            assert last.reason == "completed"
            assert not faults
        else:
            assert last.reason in ("aborted", "completed")
        if last.reason != "completed":
            assert self.engine.stops > 0


def _follows(before: RunState, after: RunState) -> bool:
    """Directly, or by way of one state that nobody was told about."""
    return after in TRANSITIONS[before] or any(
        after in TRANSITIONS[between] for between in TRANSITIONS[before]
    )


TestRunner = RunnerMachine.TestCase
TestRunner.settings = settings(max_examples=60, stateful_step_count=14, deadline=None)


def test_a_second_run_of_the_same_runner_is_refused() -> None:
    engine = SteppedEngine()
    engine.allowed = 10
    runner = Runner(engine, Journal(), [])
    assert runner.run().reason == "completed"
    with pytest.raises(RuntimeError, match="finished"):
        runner.run()


def test_a_journal_that_cannot_write_ends_the_run_before_the_next_motion() -> None:
    class FullDisk(Journal):
        def write(self, record: Record) -> None:
            if isinstance(record, Captured):
                raise OSError(28, "no space left on device")
            super().write(record)

    engine = SteppedEngine()
    engine.allowed = 100
    outcome = Runner(engine, FullDisk(), [planned_view(1), planned_view(2)]).run()
    assert outcome.reason == "error"
    assert "move v2" not in engine.began
    assert engine.stops


def test_a_failing_listener_does_not_end_the_run() -> None:
    def listen(status: RunStatus) -> None:
        raise ValueError("listener")

    engine = SteppedEngine()
    engine.allowed = 100
    runner = Runner(engine, Journal(), [planned_view(1)], on_status=listen)
    assert runner.run().reason == "completed"
