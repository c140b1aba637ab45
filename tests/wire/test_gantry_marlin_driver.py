"""The gantry driver against a simulated Marlin board."""

from __future__ import annotations

import re
import threading
import time
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
from mvp.testing.require import nothing_in_the_way, refuses, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Make = Callable[..., Any]


def test_it_moves_only_after_it_was_homed(gantry_bench: Make) -> None:
    bench = gantry_bench("marlin")
    arm = bench.arm()
    arm.open()
    refuses(LimitError, lambda: arm.move_joints(bench.start, timeout_s=5))
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    reached = arm.move_joints(bench.far, timeout_s=60)
    assert reached.joints == pytest.approx(bench.far, abs=1e-2)
    assert b"M502" not in bench.sent
    assert b"M500" not in bench.sent


def test_every_line_of_a_move_is_numbered_and_summed(gantry_bench: Make) -> None:
    bench = gantry_bench("marlin")
    bench.homed()
    moves = [data for data in bench.tap.sent if b"G1" in data or b"M400" in data]
    assert moves
    assert all(data.startswith(b"N") and b"*" in data for data in moves)


def test_a_damaged_line_is_sent_again(gantry_bench: Make) -> None:
    bench = gantry_bench("marlin")
    arm = bench.homed()
    damage = iter([True])

    def change(data: bytes) -> bytes:
        hit = b"G1" in data and next(damage, False)
        return data.replace(b"X900", b"X100") if hit else data

    bench.tap.change = change
    reached = arm.move_joints(bench.far, timeout_s=30)
    assert reached.joints == pytest.approx(bench.far, abs=1e-2)


def test_a_line_that_never_arrives_whole(gantry_bench: Make) -> None:
    bench = gantry_bench("marlin")
    arm = bench.homed()
    bench.tap.change = lambda data: data.replace(b"X900", b"X100")
    refuses(DeviceError, lambda: arm.move_joints(bench.far, timeout_s=30))
    assert not bench.moving()


def test_without_numbers_a_damaged_line_shows_in_the_place(gantry_bench: Make) -> None:
    bench = gantry_bench("marlin")
    arm = bench.homed(number_lines=False)
    bench.tap.change = lambda data: data.replace(b"X900", b"X100")
    error = refuses(DeviceFault, lambda: arm.move_joints(bench.far, timeout_s=30))
    assert error.code == "position"


def test_a_machine_that_clamps(gantry_bench: Make) -> None:
    slides = [
        slide(x, 700, start=100, joint_zero=0, switch="low", steps_per_unit=250)
        for x in "XYZ"
    ]
    bench = gantry_bench("marlin", axes=[*slides, *camera_head()])
    arm = bench.homed()
    error = refuses(DeviceFault, lambda: arm.move_joints(bench.far, timeout_s=30))
    assert error.code == "position"
    assert "X by -200" in error.message


def test_a_quick_stop_ends_a_move_and_loses_the_place(gantry_bench: Make) -> None:
    bench = gantry_bench("marlin")
    arm = bench.homed()
    result = bench.amid_a_move(arm, arm.stop)
    assert isinstance(result, MotionStopped)
    assert b"M410\n" in bench.tap.sent
    assert not bench.moving()
    assert not arm.homed
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    arm.move_joints(bench.start, timeout_s=60)


def test_a_stop_between_two_lines(gantry_bench: Make) -> None:
    bench = gantry_bench("marlin")
    arm = bench.homed()
    bench.tap.before = lambda data: arm.stop() if b"G1" in data else None
    refuses(
        MotionStopped,
        lambda: arm.move_joints(bench.far, speed_fraction=0.001, timeout_s=30),
    )
    assert not bench.moving()


def test_a_deadline_stops_it_though_it_says_that_it_is_busy(gantry_bench: Make) -> None:
    bench = gantry_bench("marlin")
    arm = bench.homed()
    refuses(
        DeviceTimeout,
        lambda: arm.move_joints(bench.far, speed_fraction=0.0005, timeout_s=2.5),
    )
    assert not bench.moving()


def test_a_board_that_halts(gantry_bench: Make, tmp_path: Path) -> None:
    bench = gantry_bench("marlin")
    arm = bench.arm(tmp_path)
    arm.open()
    bench.do("break", axis="X")
    error = refuses(
        DeviceFault, lambda: arm.home(timeout_s=60, clear=nothing_in_the_way)
    )
    assert "Homing Failed" in error.message
    assert ".wire.jsonl" in error.hint
    refuses(DeviceFault, lambda: arm.home(timeout_s=60, clear=nothing_in_the_way))
    bench.do("mend", axis="X")
    (first, *_) = list(arm.recovery())
    assert "switch it off and on" in first.text
    bench.do("power_cycle")
    first.act()
    arm.home(timeout_s=60, clear=nothing_in_the_way)


def test_it_is_no_grbl(gantry_bench: Make) -> None:
    bench = gantry_bench("marlin")
    wrong = bench.arm(firmware="grblhal", identify_s=0)
    error = refuses(ConnectError, wrong.open)
    assert "no GRBL answers on this port" in error.message
    assert re.search(rb"G\d|\$H|\$X|\$J", bench.sent) is None, "it was told to move"
    arm = bench.homed()  # it took no harm
    assert arm.state().joints == pytest.approx(bench.start, abs=1e-2)


def test_a_longer_ok_and_another_machine(gantry_bench: Make) -> None:
    uuid = "11111111-2222-4333-8444-555555555555"
    bench = gantry_bench("marlin", advanced_ok=True, uuid=uuid)
    refuses(ConnectError, bench.arm(serial="other").open)
    arm = bench.homed()
    assert arm.info().serial == uuid


def test_a_question_that_meets_the_beginning_of_a_move_does_not_wait_for_its_end(
    gantry_bench: Make,
) -> None:
    bench = gantry_bench("marlin")
    arm = bench.homed()
    seen: list[bool] = []
    asking = threading.Thread(target=lambda: seen.append(arm.state().standing))

    def ask_now(data: bytes) -> None:
        """The line before the motion is on its way; the question waits behind it."""
        if b"G90" in data and not asking.ident:
            asking.start()
            time.sleep(0.1)

    def move() -> None:
        with suppress(DeviceError):
            arm.move_joints(bench.far, speed_fraction=1e-4, timeout_s=60)

    bench.tap.before = ask_now
    moving = threading.Thread(target=move)
    moving.start()
    wait_until(lambda: len(seen) == 1, "it is answered")
    assert moving.is_alive()
    arm.stop()
    moving.join(30)
    asking.join()
