"""A head with switches of its own: the controller finds them, or says that it has not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.simulators.gcode_axes import AxisSettings
from drivers.simulators.grbl_profiles import camera_gantry
from mvp.errors import DeviceFault, LimitError, MotionStopped
from mvp.testing import refuses
from tests.wire.conftest import GRBL_AXES, TURN

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    Make = Callable[..., Any]

# Pan and tilt with a switch each, somewhere on their way when the power comes on.
HEAD = tuple(
    AxisSettings(
        letter=letter,
        travel=travel,
        rate_min=5400,
        acceleration=300,
        steps_per_unit=160,
        switch="high",
        start=-40,
        joint_zero=zero,
    )
    for letter, travel, zero in (("A", 340, 170), ("B", 180, 90))
)
SWITCHED = (*camera_gantry()[:3], *HEAD)
AXES = [
    *GRBL_AXES,
    {"letter": "A", "zero": -170, **TURN, "low": -340, "high": 0, "home": "switch"},
    {"letter": "B", "zero": -90, **TURN, "low": -180, "high": 0, "home": "switch"},
]
SINGLE = {"22": "3"}  # homing, and that of single axes


@pytest.fixture
def hal(gantry_bench: Make) -> Any:
    return gantry_bench(
        "grblhal", axes=SWITCHED, settings=SINGLE, resets_on_open=False, locked=False
    )


def test_every_axis_with_a_switch_is_homed(hal: Any) -> None:
    arm = hal.arm(axes=AXES)
    arm.open()
    assert not arm.homed
    at = arm.home(timeout_s=60)
    assert [data for data in hal.tap.sent if b"$H" in data] == [
        b"$H\n",
        b"$HA\n",
        b"$HB\n",
    ]
    assert hal.do("state")["homed"] == [0, 1, 2, 3, 4]
    assert arm.homed
    assert at.joints == pytest.approx((599, 599, 899, *np.radians((169, 89))))
    reached = arm.move_joints((0, 0, 400, 0, 0), timeout_s=60)
    truth = hal.do("state")["truth"]
    assert truth[3:] == pytest.approx([-170, -90], abs=0.05)
    assert reached.joints == pytest.approx((0, 0, 400, 0, 0), abs=1e-2)


def test_what_the_controller_still_knows_is_believed_axis_by_axis(hal: Any) -> None:
    first = hal.arm(axes=AXES)
    first.open()
    first.home(timeout_s=60)
    first.close()
    again = hal.arm(axes=AXES)
    again.open()
    assert again.homed


def test_a_controller_that_means_only_its_slides_is_not_believed(
    gantry_bench: Make,
) -> None:
    bench = gantry_bench("grblhal", axes=SWITCHED, resets_on_open=False)
    bench.homed().close()  # by X, Y and Z; it says H:1, and not of what
    arm = bench.arm(axes=AXES)
    arm.open()
    assert not arm.homed
    refuses(LimitError, lambda: arm.move_joints(bench.start, timeout_s=5))


def test_a_controller_that_homes_no_single_axis_is_refused(gantry_bench: Make) -> None:
    bench = gantry_bench("grblhal", axes=SWITCHED)
    arm = bench.arm(axes=AXES)
    arm.open()
    error = refuses(DeviceFault, lambda: arm.home(timeout_s=60))
    assert error.code == "error:5"
    assert "$22" in error.message
    assert not arm.homed


@pytest.mark.parametrize("firmware", ["grblhal", "fluidnc"])
def test_a_switch_that_was_only_configured_is_not_found(
    gantry_bench: Make, firmware: str
) -> None:
    bench = gantry_bench(firmware, settings=SINGLE)  # a head without switches
    arm = bench.arm(axes=AXES)
    arm.open()
    error = refuses(DeviceFault, lambda: arm.home(timeout_s=60))
    assert error.code == "ALARM:9"
    assert not arm.homed
    refuses(LimitError, lambda: arm.move_joints(bench.start, timeout_s=5))


def test_an_axis_that_the_controller_does_not_name_is_missing(hal: Any) -> None:
    arm = hal.arm(axes=AXES)
    arm.open()
    hal.tap.change = lambda data: data.replace(b"$HB", b"$HA")
    error = refuses(DeviceFault, lambda: arm.home(timeout_s=60))
    assert error.code == "home"
    assert "not B" in error.message
    assert not arm.homed


def test_homing_of_a_head_is_stopped_like_that_of_the_slides(
    gantry_bench: Make,
) -> None:
    bench = gantry_bench("fluidnc", axes=SWITCHED)
    arm = bench.arm(axes=AXES)
    arm.open()
    bench.tap.before = lambda data: arm.stop() if data == b"$HA\n" else None
    refuses(MotionStopped, lambda: arm.home(timeout_s=60))
    assert not arm.homed
    assert b"$HB" not in bench.sent
