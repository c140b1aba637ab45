"""What holds an arm that stands is part of its state."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mvp.cell.engine import CellEngine
from mvp.devices import ArmState
from mvp.errors import DeviceFault
from mvp.testing.require import wait_until


def test_a_protective_stop_at_rest_is_seen(ur_bench: Any) -> None:
    bench = ur_bench(unlock_delay_s=0.0)
    with bench.arm(data_timeout_s=2.0) as arm:
        assert arm.state().fault == ""
        bench.do("protective_stop")
        wait_until(lambda: arm.state().fault != "", "the stop is seen")
        assert "protective" in arm.state().fault


def test_no_picture_counts_that_was_taken_during_a_stop() -> None:
    class Devices:
        class arm:  # noqa: N801
            name = "arm"

    class View:
        id = "v1"
        joints_rad = (0.0,)

    engine = object.__new__(CellEngine)
    engine._devices = Devices()  # type: ignore[assignment]
    stopped = ArmState((0.0,), np.eye(4), True, 0.0, fault="protective stop")
    with pytest.raises(DeviceFault, match="protective stop"):
        engine._check_arm(View(), stopped)  # type: ignore[arg-type]
