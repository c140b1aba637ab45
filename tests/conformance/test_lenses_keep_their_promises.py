from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from drivers.simulators.control import ControlClient
from mvp.devices import AXES, DeviceContext, DrivesStraight, Lens
from mvp.testing import LensConformance
from mvp.testing.conformance import TIMEOUT_S
from tests.wire.lens_makes import SCF4, THEIA, VISCA, LensMake

FAST = 20.0


class OnASimulator:
    """Starts one simulator for each test and gives the driver its port."""

    make: ClassVar[LensMake]

    @pytest.fixture(autouse=True)
    def far_end(self) -> Iterator[None]:
        simulator = self.make.simulator
        config = simulator.Config.model_validate({"speed_scale": FAST})
        context = DeviceContext(rng=np.random.default_rng(1))
        running = simulator.from_config(config, context, name="lens")
        self.announced = running.start()
        self.control_port = running.control_port
        yield
        running.stop()

    def device(self) -> Lens:
        driver = self.make.driver
        config = driver.Config.model_validate({**self.announced, **self.make.keys})
        return driver.from_config(config, DeviceContext(), name="lens")

    def test_driven_straight_no_motor_takes_a_run_up(self) -> None:
        """One motion for each motor, away from the side of the lens table."""
        lens = self.device()
        assert isinstance(lens, DrivesStraight)
        with lens, ControlClient(self.control_port) as far_end:
            lens.home(timeout_s=TIMEOUT_S)
            approach = lens.approach()
            aside = {
                axis: (0.3, 0.6) if approach[axis] == "from_above" else (0.6, 0.3)
                for axis in AXES
            }
            begun = []
            for drive, turn in (
                (lens.move_steps, 0),
                (lens.move_steps_straight, 1),
                (lens.move_steps, 0),
                (lens.move_steps, 1),
            ):
                before = far_end.do("state")["moves_begun"]
                steps = {
                    axis: round(low + aside[axis][turn] * (high - low))
                    for axis, (low, high) in lens.limits().items()
                }
                reached = drive(**steps, timeout_s=TIMEOUT_S)
                assert reached.steps() == steps
                begun.append(far_end.do("state")["moves_begun"] - before)
        play = sum(axis["backlash_steps"] > 0 for axis in self.keys().values())
        assert begun[1] == len(AXES)
        assert begun[3] == len(AXES) + play

    def keys(self) -> dict[str, dict[str, int]]:
        """What the configuration says of each axis."""
        keys = self.make.keys
        return {axis: {"backlash_steps": 0, **keys[axis]} for axis in AXES}


class TestScf4(OnASimulator, LensConformance):
    make = SCF4


class TestTheia(OnASimulator, LensConformance):
    make = replace(
        THEIA,
        keys={
            "zoom": {
                "low": 0,
                "high": 3000,
                "approach": "from_above",
                "backlash_steps": 60,
            },
            "focus": {"low": 200, "high": 7900, "backlash_steps": 60},
            "iris": {"low": 5, "high": 75, "backlash_steps": 0},
        },
    )


class TestVisca(OnASimulator, LensConformance):
    make = VISCA
