"""Motion beside the main thread: Ctrl-C reaches the devices, and nobody is left alone."""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import dataclass, field
from typing import cast

import pytest

from mvp.cell.beside import call_beside, run_beside
from mvp.cell.runner import Runner, RunOutcome
from mvp.errors import MotionStopped


@dataclass
class Arm:
    """Moves until it is stopped, as a driver does; counts what it is told."""

    moving: threading.Event = field(default_factory=threading.Event)
    stopped: threading.Event = field(default_factory=threading.Event)
    thread: threading.Thread | None = None
    ended_by: str = ""

    def move(self) -> None:
        self.thread = threading.current_thread()
        self.moving.set()
        try:
            self.stopped.wait(20)
            raise MotionStopped("stopped while it moved", device="arm")
        except BaseException as error:
            self.ended_by = type(error).__name__
            raise

    def stop(self) -> None:
        self.stopped.set()


def press_ctrl_c_when(event: threading.Event, *, times: int = 1) -> None:
    def press() -> None:
        event.wait(20)
        for _ in range(times):
            os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=press).start()


@pytest.mark.parametrize("times", [1, 4])
def test_ctrl_c_stops_the_motion_through_its_driver(times: int) -> None:
    arm = Arm()
    press_ctrl_c_when(arm.moving, times=times)
    with pytest.raises(KeyboardInterrupt):
        call_beside(arm.move, arm.stop)
    assert arm.ended_by == "MotionStopped"
    assert arm.thread is not threading.main_thread()


def test_a_stop_that_fails_is_tried_again_until_the_motion_has_ended() -> None:
    arm = Arm()
    tries: list[int] = []

    def stop() -> None:
        tries.append(1)
        if len(tries) < 3:
            raise OSError("no way")
        arm.stop()

    press_ctrl_c_when(arm.moving)
    with pytest.raises(KeyboardInterrupt):
        call_beside(arm.move, stop)
    assert len(tries) >= 3
    assert arm.ended_by == "MotionStopped"


def test_without_ctrl_c_it_is_a_plain_call() -> None:
    assert call_beside(lambda: 7, pytest.fail) == 7
    with pytest.raises(ZeroDivisionError):
        call_beside(lambda: 1 / 0, pytest.fail)


class Running:
    """A run that goes on until it is aborted."""

    def __init__(self) -> None:
        self.aborted = threading.Event()

    def run(self) -> RunOutcome:
        done = self.aborted.wait(20)
        return RunOutcome("aborted" if done else "completed", ())

    def abort(self) -> None:
        self.aborted.set()


def test_a_run_that_nobody_watches_any_more_is_stopped() -> None:
    """The terminal is gone, and with it whoever answers and presses Ctrl-C."""

    def follow(runner: Runner) -> None:
        raise OSError(5, "Input/output error")

    outcome = run_beside(cast("Runner", Running()), follow)
    assert outcome.reason == "aborted"
    assert [type(error) for error in outcome.further] == [OSError]


def test_a_run_whose_abort_fails_is_waited_for() -> None:
    class Stuck(Running):
        def abort(self) -> None:
            super().abort()
            raise RuntimeError("abort failed")

    def fails(runner: Runner) -> None:
        raise ValueError("a bug")

    outcome = run_beside(cast("Runner", Stuck()), fails)
    assert [str(error) for error in outcome.further] == ["a bug", "abort failed"]
