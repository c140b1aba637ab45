"""Whatever ends a motion of a gantry early: the machine is stopped, and stands."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest

from drivers._gantry.axes import GantryAxes
from mvp.errors import DeviceError, DeviceFault, DeviceTimeout
from mvp.testing.require import wait_until

ALL = pytest.mark.parametrize("firmware", ["grblhal", "fluidnc", "marlin"])
Make = "Callable[..., Any]"


def _truth(bench: Any) -> np.ndarray:
    return np.array(bench.do("state")["truth"])


def _stands(bench: Any) -> bool:
    before = _truth(bench)
    time.sleep(0.2)
    return bool(np.abs(_truth(bench) - before).max() < 1e-6)


def _moves(bench: Any) -> bool:
    before = _truth(bench)
    time.sleep(0.02)
    return bool(np.abs(_truth(bench) - before).max() > 1e-6)


@ALL
def test_an_exception_of_the_caller_stops_it(gantry_bench: Make, firmware: str) -> None:
    bench = gantry_bench(firmware)
    arm = bench.homed()
    session = arm._wire.session  # noqa: SLF001 - where a foreign exception comes up

    def torn() -> None:
        wait_until(lambda: _moves(bench), "it moves")
        session.abort(DeviceFault("torn out", device="arm"), in_step=False)

    tearing = threading.Thread(target=torn)
    tearing.start()
    with pytest.raises(DeviceFault, match="torn out"):
        arm.move_joints(bench.far, speed_fraction=0.01, timeout_s=60)
    tearing.join()
    assert _stands(bench)
    target = bench.far
    assert max(abs(a - b) for a, b in zip(arm.state().joints, target, strict=True)) > 1


@pytest.mark.parametrize("firmware", ["grblhal", "fluidnc"])
def test_a_homing_that_takes_too_long_is_stopped(
    gantry_bench: Make, firmware: str
) -> None:
    bench = gantry_bench(firmware, speed_scale=1)
    arm = bench.arm()
    arm.open()
    with pytest.raises(DeviceTimeout, match="did not arrive in time"):
        arm.home(timeout_s=1.0)
    assert _stands(bench)
    assert not arm.homed


@ALL
def test_an_answer_that_came_twice_does_not_leave_it_moving(
    gantry_bench: Make, firmware: str
) -> None:
    bench = gantry_bench(firmware)
    arm = bench.homed()
    done: list[BaseException] = []

    def move() -> None:
        try:
            arm.move_joints(bench.far, speed_fraction=0.01, timeout_s=60)
        except Exception as error:
            done.append(error)

    mover = threading.Thread(target=move)
    mover.start()
    wait_until(lambda: _moves(bench), "it moves")
    bench.do("say", hex=b"ok\r\n".hex())
    mover.join(30)
    assert not mover.is_alive()
    assert done
    assert isinstance(done[0], DeviceError)
    assert _stands(bench)


def test_a_stop_reaches_a_motion_that_nobody_here_began(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal", resets_on_open=False)
    arm = bench.homed()
    bench.tap.write(b"G53 G1 X-700 F600\n")
    wait_until(lambda: _moves(bench), "it moves")
    arm.stop()
    assert _stands(bench)


@pytest.mark.parametrize("firmware", ["grblhal", "marlin"])
def test_no_axis_is_faster_than_its_share(gantry_bench: Make, firmware: str) -> None:
    config = gantry_bench(firmware).config()
    axes = GantryAxes(config, "arm")
    start = np.array([0, 0, 400, 0, 0.0])
    target = np.array([10, 0, 400, np.radians(90), 0.0])
    share = 0.25
    feed = axes.feed_min(start, target, share)
    way = np.abs(axes.machine(target) - axes.machine(start))
    # Marlin counts the feed along sliding axes alone; the others along all of them.
    length = way[0] if firmware == "marlin" else float(np.linalg.norm(way))
    seconds = 60 * length / feed
    speeds = np.array([axis.speed for axis in config.axes])
    assert (way / seconds <= speeds * share * (1 + 1e-9)).all()
