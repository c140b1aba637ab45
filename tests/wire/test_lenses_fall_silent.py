"""A lens that says nothing any more in the middle of a move: the stop goes out all the same."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import pytest

from mvp.errors import DeviceTimeout, MotionStopped
from mvp.testing import meanwhile
from mvp.testing.require import wait_until
from tests.wire.lens_makes import SCF4, VISCA

if TYPE_CHECKING:
    from collections.abc import Callable

    Make = Callable[..., Any]

LOOK_S = 0.1
MAKES = {
    # far: many seconds away at the speed of the test
    "scf4": (SCF4, 1.5, {"zoom": 20000, "focus": 36000, "iris": 500}),
    "visca": (VISCA, 0.15, {"zoom": 0x3E00, "focus": 0x6000, "iris": 8}),
}


@pytest.fixture(params=MAKES)
def amid(request: pytest.FixtureRequest, lens_bench: Make) -> tuple[Any, Any, Any]:
    """A bench, a homed lens on it, and what a far move ends in when something happens."""
    make, scale, far = MAKES[request.param]
    bench = lens_bench(make, speed_scale=scale)
    if make is SCF4:
        bench.do("turn", axis="zoom", steps=8100)  # close to its edge
        bench.do("turn", axis="focus", steps=6100)
    lens = bench.lens(answer_s=0.3)
    lens.home(timeout_s=60)

    def move(act: Callable[[], object]) -> tuple[object, float]:
        """The outcome, and how far the zoom still was from its target."""
        found = meanwhile(
            lambda: lens.move_steps(**far, timeout_s=60), lambda: runs(bench), act
        )
        return found, abs(bench.places()["zoom"] - far["zoom"])

    return bench, lens, move


def runs(bench: Any) -> bool:
    """Whether a motor truly turns."""
    before = bench.places()
    time.sleep(LOOK_S)
    return bool(bench.places() != before)


def mute(bench: Any) -> None:
    bench.do("noise", silence=True)


def test_a_stop_reaches_a_lens_that_answers_nothing(amid: Any) -> None:
    bench, lens, move = amid

    def act() -> None:
        mute(bench)
        lens.stop()
        wait_until(lambda: not runs(bench), "it stands")

    found, left = move(act)
    assert isinstance(found, MotionStopped)
    assert left > 1000


def test_a_stop_reaches_a_lens_that_is_out_of_step(
    amid: Any, caplog: pytest.LogCaptureFixture
) -> None:
    bench, lens, move = amid

    def act() -> None:
        mute(bench)
        wait_until(lambda: "asked again" in caplog.text, "it is out of step")
        lens.stop()
        wait_until(lambda: not runs(bench), "it stands")

    found, left = move(act)
    assert isinstance(found, MotionStopped)
    assert left > 1000


def test_a_move_that_is_not_answered_any_more_is_stopped(amid: Any) -> None:
    bench, _, move = amid
    found, left = move(lambda: mute(bench))
    assert isinstance(found, DeviceTimeout)
    assert left > 1000
    assert not runs(bench)


def test_who_only_looks_is_not_stopped(amid: Any) -> None:
    bench, lens, move = amid
    seen: list[object] = []

    def act() -> None:
        bench.do("hold_next", seconds=0.1)
        found = meanwhile(lens.state, lambda: True, lens.stop)
        seen.append(found)

    assert isinstance(move(act)[0], MotionStopped)
    assert seen[0].steps()["zoom"] > 0  # type: ignore[attr-defined]
    assert not runs(bench)
