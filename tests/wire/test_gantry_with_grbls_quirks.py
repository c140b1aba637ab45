"""Five axes behind a controller that is as awkward as GRBL 1.1 itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from drivers.simulators.gcode_axes import camera_head, slide
from mvp.errors import DeviceError, DeviceFault, LimitError, MotionStopped
from mvp.testing.require import nothing_in_the_way, refuses

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    Make = Callable[..., Any]

QUIRKS = ["dead_after_alarm", "counts_both_ends", "coalesces_queries", "small_buffer"]
SMALL = [
    *(
        slide(x, 150, start=0, joint_zero=0, switch="high", steps_per_unit=250)
        for x in "XYZ"
    ),
    *camera_head(),
]
# Every number as long as it gets: the line is near the 79 bytes that GRBL takes.
LONG = (-500.1234, -500.2345, 100.3456, -2.12345, -1.23456)


@pytest.fixture(params=["grblhal", pytest.param("fluidnc", marks=pytest.mark.full)])
def make(request: pytest.FixtureRequest, gantry_bench: Make) -> Make:
    """A bench whose controller has all of them."""
    return lambda **keys: gantry_bench(request.param, quirks=QUIRKS, **keys)


def test_it_homes_and_moves_and_never_overfills_the_buffer(make: Make) -> None:
    bench = make()
    arm = bench.homed()
    reached = arm.move_joints(LONG, timeout_s=60)
    assert reached.joints == pytest.approx(LONG, abs=1e-2)
    lines = [data for data in bench.tap.sent if data.endswith(b"\n")]
    assert max(map(len, lines)) > 60
    assert max(map(len, lines)) <= 80
    assert all(data.count(b"\n") == 1 and b"\r" not in data for data in lines)


def test_a_limit_switch_silences_it_and_a_person_leads_back(make: Make) -> None:
    bench = make(hard_limits=True)
    arm = bench.homed(answer_s=1)
    result = bench.amid_a_move(arm, lambda: bench.do("press", axis="Y"))
    assert isinstance(result, DeviceFault)
    assert result.code == "ALARM:1"
    assert bench.do("state")["dead"]
    assert not arm.homed
    error = refuses(DeviceFault, arm.state)  # it does not answer: the alarm is known
    assert error.code == "ALARM:1"
    refuses(DeviceFault, lambda: arm.move_joints(bench.start, timeout_s=5))
    refuses(DeviceFault, lambda: arm.home(timeout_s=30))
    assert bench.do("state")["dead"]  # nothing was reset by itself
    bench.do("let_go", axis="Y")
    back_home(bench, arm)


def test_a_soft_limit_silences_it_and_a_person_leads_back(make: Make) -> None:
    bench = make(axes=SMALL)
    arm = bench.arm(answer_s=1)
    arm.open()
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    error = refuses(DeviceFault, lambda: arm.move_joints(bench.start, timeout_s=30))
    assert error.code == "ALARM:2"
    assert bench.do("state")["dead"]
    refuses(DeviceFault, arm.state)
    for step in arm.recovery():
        step.act()
    assert not bench.do("state")["dead"]
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    near = (550, 550, 850, 0, 0)
    assert arm.move_joints(near, timeout_s=30).joints == pytest.approx(near, abs=1e-2)


def back_home(bench: Any, arm: Any) -> None:
    """Through every step, and on; the answers swallowed before are nobody's."""
    for step in arm.recovery():
        step.act()
    if not arm.homed:
        arm.home(timeout_s=60, clear=nothing_in_the_way)
    reached = arm.move_joints(bench.start, timeout_s=30)
    assert reached.joints == pytest.approx(bench.start, abs=1e-2)


def test_it_connects_to_a_controller_that_is_dead_already(make: Make) -> None:
    bench = make(axes=SMALL, resets_on_open=False)
    arm = bench.arm()
    arm.open()
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    refuses(DeviceFault, lambda: arm.move_joints(bench.start, timeout_s=30))
    arm.close()
    again = bench.arm(identify_s=1, answer_s=0.5)
    refuses(DeviceError, again.open)
    assert bench.do("state")["dead"]
    assert b"\x18" not in bench.sent


def test_a_stop_keeps_the_place_while_others_keep_asking(make: Make) -> None:
    bench = make()
    arm = bench.homed()

    def act() -> None:
        bench.tap.write(b"?" * 30)
        arm.stop()

    assert isinstance(bench.amid_a_move(arm, act), MotionStopped)
    assert arm.homed
    reached = arm.move_joints(bench.start, timeout_s=30)
    assert reached.joints == pytest.approx(bench.start, abs=1e-2)


def test_a_buffer_that_others_overfill_is_never_taken_for_arrival(make: Make) -> None:
    bench = make()
    arm = bench.homed()
    lines = [b"G53 G1 X-%d Y-600 Z-500 F3000\n" % (700 + 10 * k) for k in range(12)]
    flood = b"".join(lines)
    assert len(flood) > 2 * 128
    result = bench.amid_a_move(arm, lambda: bench.tap.write(flood))
    assert isinstance(result, DeviceError)
    assert not bench.moving()
    back_home(bench, arm)


def test_line_ends_that_count_twice_shift_no_answer(make: Make) -> None:
    bench = make()
    arm = bench.homed()
    bench.tap.change = lambda data: data.replace(b"\n", b"\r\n")
    try:
        reached = arm.move_joints(bench.far, timeout_s=30)
    except DeviceError:
        assert not bench.moving()
    else:
        assert reached.joints == pytest.approx(bench.far, abs=1e-2)
        truth = bench.do("state")["counter"]
        assert truth[0] == pytest.approx(-300, abs=0.01)


def test_five_axes_that_call_themselves_grbl(gantry_bench: Make) -> None:
    bench = gantry_bench("fluidnc", quirks=QUIRKS)
    arm = bench.homed(firmware="grbl")
    assert isinstance(bench.amid_a_move(arm, arm.stop), MotionStopped)
    assert arm.homed
    reached = arm.move_joints(LONG, timeout_s=60)
    assert reached.joints == pytest.approx(LONG, abs=1e-2)


def test_an_envelope_is_kept_before_the_controller_would_die_of_it(make: Make) -> None:
    bench = make()
    arm = bench.homed()
    refuses(LimitError, lambda: arm.move_joints((700, 0, 400, 0, 0), timeout_s=5))
    assert not bench.do("state")["dead"]
    assert arm.homed
