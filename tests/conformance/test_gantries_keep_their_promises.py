"""The gantry driver on three simulated firmwares, through real bytes."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar

import numpy as np
import pytest

from drivers.arm_gantry import GantryArm
from drivers.simulators.grbl import GrblSimulator
from drivers.simulators.marlin import MarlinSimulator
from mvp.devices import Arm, DeviceContext
from mvp.errors import LimitError, MotionStopped
from mvp.testing import ArmConformance
from mvp.testing.require import meanwhile, nothing_in_the_way

FAST = 20.0
LINEAR = {"speed": 3000, "acceleration": 8000}
HEAD = [
    {
        "letter": letter,
        "low": -170,
        "high": 170,
        "speed": 900,
        "acceleration": 3000,
        "home": "declared",
    }
    for letter in "AB"
]


@pytest.fixture(scope="class")
def port(request: pytest.FixtureRequest) -> Iterator[str]:
    tested = request.cls
    config = tested.simulator.Config.model_validate(
        {"speed_scale": FAST, "boot_s": 0.05, **tested.keys}
    )
    context = DeviceContext(rng=np.random.default_rng(1))
    running = tested.simulator.from_config(config, context, name="arm")
    yield str(running.start()["port"])
    running.stop()


class OnASimulatedGantry(ArmConformance):
    """Homed whenever it is not: boards that restart when the port opens forget it."""

    firmware: ClassVar[str]
    simulator: ClassVar[type]
    keys: ClassVar[dict[str, object]] = {}
    # zero, low, high of X and Y, then of Z
    slides: ClassVar = ((-600, -1200, 0), (-600, -1200, 0), (-900, -900, 0))
    slow_fraction = 0.001  # the simulator is twenty times as fast
    tolerance = 0.02  # mm; turning axes are as fine as a step of 1/160 deg

    @pytest.fixture(autouse=True)
    def _at(self, port: str) -> None:
        self.found_at = port

    def device(self) -> GantryArm:
        slides = [
            {"letter": x, "zero": zero, "low": low, "high": high, **LINEAR}
            for x, (zero, low, high) in zip("XYZ", self.slides, strict=True)
        ]
        config = GantryArm.Config.model_validate(
            {
                "port": self.found_at,
                "firmware": self.firmware,
                "serial": "G-1",
                "axes": [*slides, *HEAD],
                "settle_s": 0,
                "answer_s": 5,  # the simulator shares the processors with other tests
            }
        )
        return GantryArm.from_config(config, DeviceContext(), name="arm")

    @contextmanager
    def at_first_target(self) -> Iterator[Arm]:
        with self.device() as arm:
            assert isinstance(arm, GantryArm)
            if not arm.homed:
                arm.home(timeout_s=60, clear=nothing_in_the_way)
            arm.move_joints(self.targets()[0], timeout_s=60)
            yield arm

    def targets(self) -> tuple[list[float], list[float]]:
        return [0, 0, 400, 0, 0], [300, -200, 500, 0.5, -0.4]


class TestGrblHal(OnASimulatedGantry):
    firmware = "grblhal"
    simulator = GrblSimulator
    keys: ClassVar = {"profile": "grblhal", "resets_on_open": False}


class TestFluidNC(OnASimulatedGantry):
    firmware = "fluidnc"
    simulator = GrblSimulator
    keys: ClassVar = {"profile": "fluidnc"}


class TestMarlin(OnASimulatedGantry):
    firmware = "marlin"
    simulator = MarlinSimulator
    slides: ClassVar = ((600, 0, 1200), (600, 0, 1200), (0, 0, 900))

    def test_stop_from_another_thread_ends_a_motion(self) -> None:
        """A quick stop may lose steps: nothing moves until it is homed again."""
        first, second = self.targets()
        with self.device() as arm:
            arm.home(timeout_s=60, clear=nothing_in_the_way)
            arm.move_joints(first, timeout_s=60)
            result = meanwhile(
                lambda: arm.move_joints(
                    second, speed_fraction=self.slow_fraction, timeout_s=60
                ),
                lambda: not arm.state().standing,
                arm.stop,
            )
            assert isinstance(result, MotionStopped)
            assert arm.state().standing
            assert not arm.homed
            with pytest.raises(LimitError):
                arm.move_joints(first, timeout_s=60)
            arm.home(timeout_s=60, clear=nothing_in_the_way)
            self._same_place(arm.move_joints(first, timeout_s=60), first)
