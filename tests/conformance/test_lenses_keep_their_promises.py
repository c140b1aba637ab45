from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from mvp.devices import DeviceContext, Lens
from mvp.testing import LensConformance
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
        yield
        running.stop()

    def device(self) -> Lens:
        driver = self.make.driver
        config = driver.Config.model_validate({**self.announced, **self.make.keys})
        return driver.from_config(config, DeviceContext(), name="lens")


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
