"""A controller without a dashboard: stops, what may go on, and the way back."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import pytest

from mvp.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from mvp.testing import meanwhile, refuses, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable

HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
FAR = [1.2, -1.3, 1.4, -1.57, -1.4, 0.5]


@pytest.fixture
def bench(ur_bench: Callable[..., Any]) -> Any:
    return ur_bench(profile="x10.11", unlock_delay_s=0.0)


def met_in_motion(bench: Any, arm: Any, verb: str, **arguments: object) -> DeviceError:
    """What a motion makes of a fault on its way."""
    arm.move_joints(HOME, timeout_s=30)
    error = meanwhile(
        lambda: arm.move_joints(FAR, timeout_s=60),
        lambda: not arm.state().standing,
        lambda: bench.do(verb, **arguments),
    )
    assert isinstance(error, DeviceError), repr(error)
    return error


def standing(bench: Any) -> list[float]:
    """Where it stands, once it does."""
    wait_until(lambda: bench.do("state")["standing"], "it stands")
    return list(bench.do("state")["joints"])


def test_a_broken_link_takes_nothing_down(bench: Any) -> None:
    with bench.arm(joint_speed_deg_s=15) as arm:
        error = met_in_motion(bench, arm, "drop", how="fin")
    assert isinstance(error, LinkLost | DeviceTimeout), repr(error)
    assert "may go on" in str(error)
    assert len(bench.moves_since(0)) == 2
    assert standing(bench)[0] < FAR[0] - 0.1, "the program in its place has braked"
    assert bench.do("state")["program"] is None


def test_a_guard_in_motion_is_told_with_what_may_go_on(bench: Any) -> None:
    with bench.arm(joint_speed_deg_s=15) as arm:
        error = met_in_motion(bench, arm, "safeguard_stop")
        assert isinstance(error, DeviceFault)
        assert error.code == "safeguard-stop"
        assert "may go on with the motion" in error.message
        assert error.hint.startswith("stop the program on the pendant")
        refuses(DeviceError, lambda: arm.move_joints(HOME, timeout_s=30))
    since, stands = bench.now_s(), standing(bench)
    bench.do("release")
    time.sleep(0.5)
    assert standing(bench) == pytest.approx(stands, abs=0.02), "it brakes, no more"
    arm = bench.arm()
    texts = []
    for step in arm.recovery():
        texts.append(step.text)
        step.act()
    assert "Stop the program first" in texts[0]
    assert not bench.moves_since(since)
    assert arm.move_joints(HOME, timeout_s=30).standing
    arm.close()


@pytest.mark.full
def test_a_guard_at_rest(bench: Any) -> None:
    with bench.arm() as arm:
        arm.move_joints(HOME, timeout_s=30)
        bench.do("safeguard_stop")
        wait_until(lambda: arm.state().fault != "", "the stop is seen")
        error = refuses(DeviceFault, lambda: arm.move_joints(FAR, timeout_s=30))
        assert error.code == "safeguard-stop"
        bench.do("release")
        wait_until(
            lambda: bench.do("state")["runtime_state"] == "PLAYING", "it goes on"
        )
        wait_until(lambda: arm.state().fault == "", "the end of the stop is seen")
        assert arm.move_joints(HOME, timeout_s=30).standing


@pytest.mark.full
@pytest.mark.parametrize("program", ["stop", "pause"])
def test_a_protective_stop_in_motion(bench: Any, program: str) -> None:
    with bench.arm(joint_speed_deg_s=15) as arm:
        error = met_in_motion(bench, arm, "protective_stop", program=program)
    assert isinstance(error, DeviceFault)
    assert error.code == "protective-stop"
    # A program that has ended cannot go on; one that waits can.
    assert ("may go on" in error.message) is (program == "pause")
