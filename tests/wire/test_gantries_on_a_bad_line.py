"""What the gantry driver keeps to with every firmware when cable or supply fail."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from mvp.errors import DeviceError, DeviceFault, LimitError, LinkLost
from mvp.testing import nothing_in_the_way, refuses, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    Make = Callable[..., Any]

pytestmark = pytest.mark.parametrize("firmware", ["grblhal", "fluidnc", "marlin"])


def test_unplugged_in_motion(gantry_bench: Make, firmware: str) -> None:
    bench = gantry_bench(firmware)
    arm = bench.homed()
    result = bench.amid_a_move(arm, lambda: bench.do("unplug", reset=True))
    assert isinstance(result, LinkLost)
    assert not arm.homed
    refuses(DeviceError, lambda: arm.move_joints(bench.start, timeout_s=5))
    arm.stop()
    arm.close()
    bench.do("replug")
    arm.open()
    assert not arm.homed
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    arm.move_joints(bench.start, timeout_s=60)


def test_the_power_fails_for_a_moment(gantry_bench: Make, firmware: str) -> None:
    bench = gantry_bench(firmware)
    arm = bench.homed()
    result = bench.amid_a_move(arm, lambda: bench.do("power_cycle"))
    assert isinstance(result, DeviceFault)
    assert "restarted" in result.message
    assert not arm.homed
    arm.home(timeout_s=60, clear=nothing_in_the_way)
    bench.do("power_cycle")
    wait_until(lambda: not arm.homed, "the driver saw that it began anew")
    refuses(LimitError, lambda: arm.move_joints(bench.start, timeout_s=5))
