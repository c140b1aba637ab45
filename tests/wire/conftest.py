"""Simulated far ends that several wire tests share."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.arm_ur import UrArm
from drivers.simulators.control import ControlClient
from drivers.simulators.ur import UrSimulator, UrSimulatorConfig
from mvp.devices import DeviceContext

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from mvp.devices import Lens

_MOVES = (1, 2, 3, 4, 45)  # moveJ, moveJ_IK, moveL, moveL_FK, a path


class UrBench:
    """A simulated controller, its fault channel, and arms that drive it."""

    def __init__(self, stack: ExitStack, **settings: object) -> None:
        settings = {"speed_scale": 3.0, "unlock_delay_s": 0.5, **settings}
        config = UrSimulatorConfig.model_validate(settings)
        self.simulator = stack.enter_context(UrSimulator(config, "ur"))
        self.faults = stack.enter_context(ControlClient(self.simulator.control_port))

    def arm(self, **settings: object) -> UrArm:
        """A driver for this controller, not yet open."""
        settings = {
            "host": self.simulator.host,
            "payload_kg": 1.5,
            "payload_cog_mm": [0, 5, 40],
            "tcp_mm": [0, 0, 100],
            "joint_speed_deg_s": 120,
            "data_timeout_s": 2.0,  # simulators starve on a busy machine
            **settings,
        }
        config = UrArm.Config.model_validate(settings)
        return UrArm.from_config(config, DeviceContext(), name="arm")

    def do(self, verb: str, **arguments: object) -> dict[str, object]:
        """One thing over the fault channel."""
        return self.faults.do(verb, **arguments)

    def now_s(self) -> float:
        """The controller's own time."""
        return float(self.do("state")["time_s"])

    def moves_since(self, t_s: float) -> list[dict[str, object]]:
        """The motion commands that it received: values are target, speed, ramp."""
        received = self.do("state")["commands"]
        return [c for c in received if c["command"] in _MOVES and c["t_s"] >= t_s]


@pytest.fixture(scope="module")
def ur_shared() -> Iterator[UrBench]:
    """One simulated UR controller for tests that leave it as they found it."""
    with ExitStack() as stack:
        yield UrBench(stack)


@pytest.fixture
def ur_bench() -> Iterator[Callable[..., UrBench]]:
    """Makes simulated UR controllers; all are ended with the test."""
    with ExitStack() as stack:
        yield lambda **settings: UrBench(stack, **settings)


class LensBench:
    """A simulated lens controller, its fault channel, and lenses that drive it."""

    def __init__(
        self,
        stack: ExitStack,
        simulator: type,
        driver: type,
        keys: dict[str, object],
        settings: dict[str, object],
    ) -> None:
        config = simulator.Config.model_validate({"speed_scale": 20, **settings})
        context = DeviceContext(rng=np.random.default_rng(7))
        self._stack = stack
        self._driver = driver
        self.simulator = simulator.from_config(config, context, name="lens")
        self.keys = {**self.simulator.start(), "identify_s": 3, **keys}
        stack.callback(self.simulator.stop)
        port = self.simulator.control_port
        self.faults = stack.enter_context(ControlClient(port))

    def lens(self, context: DeviceContext | None = None, **keys: object) -> Lens:
        """A driver for this controller, open; closed with the test."""
        config = self._driver.Config.model_validate({**self.keys, **keys})
        context = context or DeviceContext()
        lens = self._driver.from_config(config, context, name="lens")
        return self._stack.enter_context(lens)

    def do(self, verb: str, **arguments: object) -> dict[str, object]:
        """One thing over the fault channel."""
        return self.faults.do(verb, **arguments)

    def places(self) -> dict[str, float]:
        """Where the motors truly are, in steps."""
        return self.do("state")["places"]


@pytest.fixture
def lens_bench() -> Iterator[Callable[..., LensBench]]:
    """Makes simulated lens controllers; all are ended with the test."""
    with ExitStack() as stack:

        def make(
            simulator: type, driver: type, keys: dict[str, object], **settings: object
        ) -> LensBench:
            return LensBench(stack, simulator, driver, keys, settings)

        yield make
