from collections.abc import Iterator
from typing import ClassVar

import numpy as np
import pytest

from drivers.lens_scf4 import Scf4Lens
from drivers.lens_theia import TheiaLens
from drivers.lens_visca import ViscaLens
from drivers.simulators.scf4 import Scf4Simulator
from drivers.simulators.theia import TheiaSimulator
from drivers.simulators.visca import ViscaSimulator
from mvp.devices import DeviceContext, Lens
from mvp.testing import LensConformance

FAST = 20.0


class OnASimulator:
    """Starts one simulator for each test and gives the driver its port."""

    simulator: type
    keys: ClassVar[dict[str, object]]
    driver: type

    @pytest.fixture(autouse=True)
    def far_end(self) -> Iterator[None]:
        config = self.simulator.Config.model_validate({"speed_scale": FAST})
        context = DeviceContext(rng=np.random.default_rng(1))
        running = self.simulator.from_config(config, context, name="lens")
        self.announced = running.start()
        yield
        running.stop()

    def device(self) -> Lens:
        config = self.driver.Config.model_validate({**self.announced, **self.keys})
        return self.driver.from_config(config, DeviceContext(), name="lens")


class TestScf4(OnASimulator, LensConformance):
    simulator = Scf4Simulator
    driver = Scf4Lens
    keys: ClassVar = {
        "zoom": {"low": 17850, "high": 38650, "backlash_steps": 60},
        "focus": {"low": 28500, "high": 38000, "approach": "from_above"},
        "iris": {"low": 100, "high": 2200, "backlash_steps": 20},
        "focus_motor": {"letter": "B", "home_step": 36000},
    }


class TestTheia(OnASimulator, LensConformance):
    simulator = TheiaSimulator
    driver = TheiaLens
    keys: ClassVar = {
        "zoom": {
            "low": 0,
            "high": 3000,
            "approach": "from_above",
            "backlash_steps": 60,
        },
        "focus": {"low": 200, "high": 7900, "backlash_steps": 60},
        "iris": {"low": 5, "high": 75, "backlash_steps": 0},
    }


class TestVisca(OnASimulator, LensConformance):
    simulator = ViscaSimulator
    driver = ViscaLens
    keys: ClassVar = {
        "zoom": {
            "low": 0,
            "high": 0x3F00,
            "approach": "from_above",
            "backlash_steps": 20,
        },
        "focus": {"low": 0x1100, "high": 0xE000, "backlash_steps": 20},
        "iris": {"low": 0, "high": 0x11},
    }
