"""The gantry driver against the simulated GRBL family: faults, stops, recoveries."""

from __future__ import annotations

import re
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

from drivers.simulators.gcode_axes import camera_head, slide
from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    LimitError,
    MotionStopped,
)
from mvp.testing.require import (
    meanwhile,
    nothing_in_the_way,
    refuses,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Make = Callable[..., Any]

BOTH = pytest.mark.parametrize("firmware", ["grblhal", "fluidnc"])


@BOTH
def test_it_moves_only_after_it_was_homed(gantry_bench: Make, firmware: str) -> None:
    bench = gantry_bench(firmware)
    arm = bench.arm()
    arm.open()
    assert not arm.homed
    refuses(LimitError, lambda: arm.move_joints(bench.start, timeout_s=5))
    assert b"G1" not in bench.sent
    home = arm.home(timeout_s=60, clear=nothing_in_the_way)
    assert arm.homed
    assert home.joints == pytest.approx((599, 599, 899, 0, 0))
    reached = arm.move_joints(bench.far, timeout_s=60)
    assert reached.joints == pytest.approx(bench.far, abs=1e-2)


def test_nothing_is_ever_unlocked_or_set(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal", hard_limits=True)
    arm = bench.homed()
    bench.do("press", axis="X")
    refuses(DeviceFault, lambda: arm.move_joints(bench.far, timeout_s=30))
    bench.do("let_go", axis="X")
    for step in arm.recovery():
        step.act()
    arm.move_joints(bench.start, timeout_s=30)
    assert b"$X" not in bench.sent
    assert not re.search(rb"\$\w+=|M3|M4|M7|M8|[\x99-\x9e\xa0\xa1]", bench.sent)


def test_a_hand_may_have_turned_a_declared_axis_since(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal", resets_on_open=False)
    bench.homed().close()
    arm = bench.arm()
    arm.open()
    assert not arm.homed  # although grblHAL says so of the axes with a switch
    refuses(LimitError, lambda: arm.move_joints(bench.far, timeout_s=30))
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    arm.move_joints(bench.far, timeout_s=30)


def test_inches_are_refused(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal", settings={"13": "1"})
    error = refuses(ConnectError, bench.arm().open)
    assert "$13" in error.message


def test_grbl_itself_has_no_head(gantry_bench: Make) -> None:
    bench = gantry_bench("grbl")
    bench.firmware = "grbl"
    error = refuses(ConnectError, bench.arm().open)
    assert "XYZ; A, B" in error.message
    assert "grblHAL" in error.hint


def test_another_machine_of_the_same_make(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal", user_text="south")
    error = refuses(ConnectError, bench.arm(serial="north").open)
    assert "south" in error.message
    arm = bench.arm()
    arm.open()
    assert arm.info().serial == "south"


def test_two_programs_on_one_port(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    first = bench.arm()
    first.open()
    error = refuses(ConnectError, bench.arm().open)
    assert "another program" in f"{error.message} {error.hint}"
    assert first.state().standing


def test_reports_that_nobody_asked_for_do_no_harm(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal", auto_report_s=0.01)
    arm = bench.homed()
    reached = arm.move_joints(bench.far, timeout_s=30)
    assert reached.joints == pytest.approx(bench.far, abs=1e-2)


@BOTH
def test_a_limit_switch_ends_a_move_and_loses_the_place(
    gantry_bench: Make, firmware: str, tmp_path: Path
) -> None:
    # FluidNC has its limits in a file of its own; the switch itself is the same.
    bench = gantry_bench(firmware, hard_limits=True)
    arm = bench.homed(tmp_path)
    result = bench.amid_a_move(arm, lambda: bench.do("press", axis="Y"))
    assert isinstance(result, DeviceFault)
    assert result.code == "ALARM:1"
    assert ".wire.jsonl" in result.hint
    assert list(tmp_path.iterdir())
    assert not arm.homed
    refuses(DeviceError, lambda: arm.move_joints(bench.start, timeout_s=5))
    refuses(DeviceFault, lambda: arm.home(timeout_s=30))
    bench.do("let_go", axis="Y")
    steps = [step.act() for step in arm.recovery()]
    assert len(steps) == 2
    if not arm.homed:  # the head had turned: left to those who know what is near it
        arm.home(timeout_s=60, clear=nothing_in_the_way)
    arm.move_joints(bench.start, timeout_s=30)


def test_a_switch_that_is_not_found(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.arm()
    arm.open()
    bench.do("break", axis="X")
    error = refuses(
        DeviceFault, lambda: arm.home(timeout_s=60, clear=nothing_in_the_way)
    )
    assert error.code == "ALARM:9"
    assert not arm.homed
    bench.do("mend", axis="X")
    bench.do("push", axis="X", amount=-50.0)
    arm.home(
        timeout_s=60, clear=nothing_in_the_way
    )  # the ok after the alarm was not taken for this one's
    assert arm.homed


def test_a_machine_smaller_than_configured(gantry_bench: Make) -> None:
    slides = [
        slide(x, 150, start=0, joint_zero=0, switch="high", steps_per_unit=250)
        for x in "XYZ"
    ]
    bench = gantry_bench("grblhal", axes=[*slides, *camera_head()])
    arm = bench.arm()
    arm.open()
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    error = refuses(DeviceFault, lambda: arm.move_joints(bench.start, timeout_s=30))
    assert error.code == "ALARM:2"


def test_a_line_that_was_damaged_shows_in_the_place(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.homed()
    bench.tap.change = lambda data: data.replace(b"X-300", b"X-30")
    error = refuses(DeviceFault, lambda: arm.move_joints(bench.far, timeout_s=30))
    assert error.code == "position"
    assert "X by" in error.message
    assert bench.sent.count(b"G53 G1") == 2  # the first was to the start: no retry


def test_one_refused_line_does_not_stick(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.homed()
    bench.do("refuse_next", code=20)
    error = refuses(DeviceFault, lambda: arm.move_joints(bench.far, timeout_s=30))
    assert error.code == "error:20"
    arm.move_joints(bench.far, timeout_s=30)


@BOTH
def test_a_stop_is_one_byte_and_keeps_the_place(
    gantry_bench: Make, firmware: str
) -> None:
    bench = gantry_bench(firmware)
    arm = bench.homed()
    result = bench.amid_a_move(arm, arm.stop)
    assert isinstance(result, MotionStopped)
    place = [k for k, data in enumerate(bench.tap.sent) if b"G4" in data][-1]
    hold = [data for data in bench.tap.sent[place:] if data in (b"!", b"\x82")]
    assert hold[:1] == [b"\x82" if firmware == "grblhal" else b"!"]
    assert not bench.moving()
    assert arm.homed
    arm.stop()
    arm.stop()
    reached = arm.move_joints(bench.start, timeout_s=30)
    assert reached.joints == pytest.approx(bench.start, abs=1e-2)


def test_a_stop_before_the_first_byte(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.homed()
    before = len(bench.tap.sent)
    bench.tap.before = lambda data: arm.stop() if data.startswith(b"G21") else None
    refuses(MotionStopped, lambda: arm.move_joints(bench.far, timeout_s=30))
    assert b"G53" not in b"".join(bench.tap.sent[before:])
    bench.tap.before = lambda data: None
    arm.move_joints(bench.far, timeout_s=30)


def test_a_stop_between_two_lines(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.homed()
    bench.tap.before = lambda data: arm.stop() if data.startswith(b"G4") else None
    refuses(
        MotionStopped,
        lambda: arm.move_joints(bench.far, speed_fraction=0.001, timeout_s=30),
    )
    assert not bench.moving()
    bench.tap.before = lambda data: None
    arm.move_joints(bench.far, timeout_s=30)


def test_a_stop_while_it_homes(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal", speed_scale=2)
    arm = bench.arm()
    arm.open()
    result = meanwhile(
        lambda: arm.home(timeout_s=60, clear=nothing_in_the_way), bench.moving, arm.stop
    )
    assert isinstance(result, MotionStopped)
    assert not bench.moving()
    assert not arm.homed
    assert bench.tap.sent.count(b"\x18") == 1


def test_a_deadline_stops_it(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.homed()
    refuses(
        DeviceTimeout,
        lambda: arm.move_joints(bench.far, speed_fraction=0.001, timeout_s=0.3),
    )
    assert not bench.moving()
    assert arm.homed
    arm.move_joints(bench.start, timeout_s=30)


def test_closing_while_it_moves_stops_it_first(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.homed()
    result = bench.amid_a_move(arm, arm.close)
    assert isinstance(result, DeviceError)
    assert not bench.moving()
    assert b"\x82" in bench.sent


def test_somebody_else_holds_it(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.homed()
    bench.tap.write(b"\x82")
    error = refuses(DeviceFault, arm.state)
    assert "held" in error.message
    for step in arm.recovery():
        step.act()
    arm.move_joints(bench.far, timeout_s=30)


def test_a_late_answer_is_nobody_elses(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.homed(answer_s=1.0)
    bench.do("hold_next", seconds=2.0)
    refuses(DeviceError, lambda: arm.move_joints(bench.far, timeout_s=30))
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    reached = arm.move_joints(bench.far, timeout_s=30)
    assert reached.joints == pytest.approx(bench.far, abs=1e-2)


def test_garbage_from_a_modem_manager_at_first(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    bench.do("say", hex=b"AT+CGMM\r\r\nERROR\r\n".hex())
    assert bench.homed().state().joints == pytest.approx(bench.start, abs=1e-2)


def test_a_poor_line(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    bench.do("noise", max_chunk=8, delay_s=0.002)
    arm = bench.homed()
    reached = arm.move_joints(bench.far, timeout_s=30)
    assert reached.joints == pytest.approx(bench.far, abs=1e-2)


def test_only_one_motion_at_a_time(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.homed()
    asked: list[int] = []

    def interfere() -> None:
        asked.append(bench.sent.count(b"G1"))
        error = refuses(DeviceFault, lambda: arm.move_joints(bench.start, timeout_s=5))
        assert "another action is in progress" in error.message
        asked.append(bench.sent.count(b"G1"))

    reached = bench.amid_a_move(arm, interfere)
    assert asked[0] == asked[1], "the second motion reached the wire"
    assert reached.joints == pytest.approx(bench.far, abs=1e-2)


@BOTH
def test_a_hold_that_nobody_could_end_is_given_up_at_the_next_opening(
    gantry_bench: Make, firmware: str
) -> None:
    """The line fell silent in a motion: the stop got through, the reset after it not."""
    bench = gantry_bench(firmware, resets_on_open=False)
    arm = bench.homed()

    def fall_silent_and_stop() -> None:
        bench.do("noise", silence=True)
        with suppress(DeviceError):
            arm.stop()

    result = bench.amid_a_move(arm, fall_silent_and_stop)
    assert isinstance(result, DeviceError)
    arm.close()
    bench.do("noise")
    assert str(bench.do("state")["state"]).startswith("Hold")
    before = bench.do("state")
    again = bench.arm()
    again.open()
    after = bench.do("state")
    assert after["truth"] == pytest.approx(before["truth"], abs=1e-6)
    assert after["moves_begun"] == before["moves_begun"]
    if not again.homed:
        again.home(timeout_s=60, clear=nothing_in_the_way)
    again.move_joints(bench.far, timeout_s=30)
