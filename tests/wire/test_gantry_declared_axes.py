"""Axes that nothing measures: where homing takes them, and what it says before."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mvp.errors import DeviceFault, LimitError
from mvp.testing import nothing_in_the_way, refuses

Make = "Callable[..., Any]"
TURNED = (300.0, -200.0, 500.0, 0.5, -0.4)
FIRMWARES = pytest.mark.parametrize("firmware", ["grblhal", "marlin"])
# Boards that keep their counters when a program connects anew.
KEEPS: dict[str, dict[str, object]] = {
    "grblhal": {"resets_on_open": False},
    "marlin": {"resets_on_open": False},
}


@pytest.fixture
def turned(gantry_bench: Make, firmware: str) -> tuple[Any, Any]:
    """A bench, and an arm that was opened anew after another program turned the head."""
    bench = gantry_bench(firmware, **KEEPS[firmware])
    arm = bench.homed()
    arm.move_joints(TURNED, timeout_s=60)
    arm.close()
    arm = bench.arm()
    arm.open()
    assert not arm.homed
    return bench, arm


@FIRMWARES
def test_homing_says_where_each_axis_is_believed_to_be(turned: tuple[Any, Any]) -> None:
    _, arm = turned
    homing = arm.homing()
    assert homing.away == ("A", "B")
    assert "X, Y, Z go to their switches" in homing.words
    assert "A 28.6" in homing.words
    assert "its mark is 0" in homing.words
    assert "turn back to their marks" in homing.words


@FIRMWARES
def test_the_head_stays_where_nobody_can_say_that_its_way_is_clear(
    turned: tuple[Any, Any],
) -> None:
    bench, arm = turned
    error = refuses(DeviceFault, lambda: arm.home(timeout_s=60))
    assert error.code == "declared"
    assert "mvp-cell home" in error.hint
    assert not arm.homed
    assert arm.state().joints[3:] == pytest.approx(TURNED[3:], abs=1e-2)
    refuses(LimitError, lambda: arm.move_joints(bench.start, timeout_s=5))


@FIRMWARES
def test_the_head_stays_where_its_way_is_judged_not_clear(
    turned: tuple[Any, Any],
) -> None:
    _, arm = turned

    def touches(start: tuple[float, ...], end: tuple[float, ...]) -> None:
        raise LimitError("the camera would touch", device="arm")

    refuses(LimitError, lambda: arm.home(timeout_s=60, clear=touches))
    assert not arm.homed
    assert arm.state().joints[3:] == pytest.approx(TURNED[3:], abs=1e-2)


@FIRMWARES
def test_the_way_that_is_judged_is_the_way_that_is_driven(
    turned: tuple[Any, Any],
) -> None:
    _, arm = turned
    judged: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
    reached = arm.home(timeout_s=60, clear=lambda a, b: judged.append((a, b)))
    ((start, end),) = judged
    assert start[3:] == pytest.approx(TURNED[3:], abs=1e-2)
    assert start[:3] == pytest.approx(end[:3])  # the slides stand at their switches
    assert end == pytest.approx(reached.joints, abs=1e-2)
    assert np.allclose(end[3:], 0)
    assert arm.homed


def test_an_axis_at_its_mark_moves_nothing_of_ours(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.arm()
    arm.open()
    assert arm.homing().away == ()
    assert "(its mark)" in arm.homing().words
    assert arm.homing().believed == ("A 0 (its mark)", "B 0 (its mark)")
    arm.home(timeout_s=60)
    assert arm.homed
    assert b"G1" not in bench.sent


def test_the_way_back_from_an_alarm_leaves_a_turned_head_to_homing(
    gantry_bench: Make,
) -> None:
    bench = gantry_bench("grblhal", hard_limits=True)
    arm = bench.homed()
    arm.move_joints(TURNED, timeout_s=60)
    bench.do("press", axis="Y")
    refuses(DeviceFault, lambda: arm.move_joints(bench.start, timeout_s=30))
    bench.do("let_go", axis="Y")
    steps = list(_walked(arm))
    assert "mvp-cell home" in steps[-1]
    assert not arm.homed
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    assert arm.homed


def _walked(arm: Any) -> Any:
    for step in arm.recovery():
        step.act()
        yield step.text
