"""Simulated far ends that several wire tests share."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.arm_gantry import GantryArm
from drivers.arm_ur import UrArm
from drivers.simulators.control import ControlClient
from drivers.simulators.grbl import GrblSimulator
from drivers.simulators.marlin import MarlinSimulator
from drivers.simulators.ur import UrSimulator, UrSimulatorConfig
from mvp.devices import DeviceContext, RecordingTransport
from mvp.devices.transport import recorded_link
from mvp.testing import meanwhile, nothing_in_the_way

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from drivers._gantry.config import GantryConfig
    from mvp.devices import Lens, Transport, TransportConfig
    from tests.wire.lens_makes import LensMake

_MOVES = (1, 2, 3, 4, 45)  # moveJ, moveJ_IK, moveL, moveL_FK, a path


class UrBench:
    """A simulated controller, its fault channel, and arms that drive it."""

    def __init__(self, stack: ExitStack, **settings: object) -> None:
        settings = {"speed_scale": 3.0, "unlock_delay_s": 0.5, **settings}
        config = UrSimulatorConfig.model_validate(settings)
        self._stack = stack
        self.simulator = stack.enter_context(UrSimulator(config, "ur"))
        self.faults = stack.enter_context(ControlClient(self.simulator.control_port))

    def arm(self, **settings: object) -> UrArm:
        """A driver for this controller, not yet open; closed with the test."""
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
        arm = UrArm.from_config(config, DeviceContext(), name="arm")
        self._stack.callback(arm.close)
        return arm

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
        self, stack: ExitStack, make: LensMake, settings: dict[str, object]
    ) -> None:
        config = make.simulator.Config.model_validate({"speed_scale": 20, **settings})
        context = DeviceContext(rng=np.random.default_rng(7))
        self._stack = stack
        self._driver = make.driver
        self.simulator = make.simulator.from_config(config, context, name="lens")
        self.keys = {**self.simulator.start(), "identify_s": 10, **make.keys}
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

    def amid_a_move(
        self, lens: Lens, target: dict[str, int], act: Callable[[], object]
    ) -> object:
        """What a move ends in when something happens while it goes on."""
        return meanwhile(
            lambda: lens.move_steps(**target, timeout_s=60),
            lambda: not lens.state().standing,
            act,
        )


@pytest.fixture
def lens_bench() -> Iterator[Callable[..., LensBench]]:
    """Makes simulated lens controllers; all are ended with the test."""
    with ExitStack() as stack:
        yield lambda make, **settings: LensBench(stack, make, settings)


SLIDE = {"speed": 3000, "acceleration": 8000}
TURN = {
    "low": -170,
    "high": 170,
    "speed": 900,
    "acceleration": 3000,
    "home": "declared",
}
GRBL_AXES: list[dict[str, object]] = [
    {"letter": "X", "zero": -600, "low": -1200, "high": 0, **SLIDE},
    {"letter": "Y", "zero": -600, "low": -1200, "high": 0, **SLIDE},
    {"letter": "Z", "zero": -900, "low": -900, "high": 0, **SLIDE},
]
MARLIN_AXES: list[dict[str, object]] = [
    {"letter": "X", "zero": 600, "low": 0, "high": 1200, **SLIDE},
    {"letter": "Y", "zero": 600, "low": 0, "high": 1200, **SLIDE},
    {"letter": "Z", "zero": 0, "low": 0, "high": 900, **SLIDE},
]
HEAD: list[dict[str, object]] = [{"letter": x, **TURN} for x in "AB"]


class Tap:
    """Hears what a driver writes, may change it, and may act just before."""

    def __init__(self, link: Transport) -> None:
        self._link = link
        self.name = link.name
        self.sent: list[bytes] = []
        self.change: Callable[[bytes], bytes] = lambda data: data
        self.before: Callable[[bytes], None] = lambda data: None

    @property
    def address(self) -> str:
        return self._link.address

    def open(self) -> None:
        self._link.open()

    def close(self) -> None:
        self._link.close()

    def write(self, data: bytes) -> None:
        self.before(data)
        self.sent.append(data)
        self._link.write(self.change(data))

    def read(self, *, timeout_s: float) -> bytes:
        return self._link.read(timeout_s=timeout_s)


class GantryBench:
    """A simulated controller, its fault channel, and arms that drive it."""

    start = (0.0, 0.0, 400.0, 0.0, 0.0)
    far = (300.0, -200.0, 500.0, 0.5, -0.4)

    def __init__(self, stack: ExitStack, firmware: str, **settings: object) -> None:
        self.firmware = firmware
        marlin = firmware == "marlin"
        simulator = MarlinSimulator if marlin else GrblSimulator
        profile = {} if marlin else {"profile": firmware}
        quick = {"speed_scale": 60, "homing_seek_min": 12_000, "homing_feed_min": 1500}
        keys = {**quick, "boot_s": 0.05, **profile, **settings}
        self.simulator = simulator.from_config(
            simulator.Config.model_validate(keys),
            DeviceContext(rng=np.random.default_rng(3)),
            name="arm",
        )
        stack.callback(self.simulator.stop)
        self.port = str(self.simulator.start()["port"])
        client = ControlClient(self.simulator.control_port)
        self.faults = stack.enter_context(client)
        self._stack = stack
        self.taps: list[Tap] = []

    def config(self, **keys: object) -> GantryConfig:
        slides = MARLIN_AXES if self.firmware == "marlin" else GRBL_AXES
        told = {
            "port": self.port,
            "firmware": self.firmware,
            "axes": [*slides, *HEAD],
            "settle_s": 0,
            "answer_s": 3,  # the simulator shares the processors
            "identify_s": 10,
            **keys,
        }
        return GantryArm.Config.model_validate(told)

    def context(self, dump_folder: Path | None = None) -> DeviceContext:
        return DeviceContext(transports=self._tapped, dump_folder=dump_folder)

    def arm(self, dump_folder: Path | None = None, **keys: object) -> GantryArm:
        """A driver for this controller, not yet open; closed with the test."""
        arm = GantryArm.from_config(
            self.config(**keys), self.context(dump_folder), name="arm"
        )
        self._stack.callback(arm.close)
        return arm

    def homed(self, dump_folder: Path | None = None, **keys: object) -> GantryArm:
        """A driver that is open, homed, and stands at the start."""
        arm = self.arm(dump_folder, **keys)
        arm.open()
        arm.home(timeout_s=60, clear=nothing_in_the_way)
        arm.move_joints(self.start, timeout_s=60)
        return arm

    def slow_move(self, arm: GantryArm) -> object:
        """A move that takes some seconds."""
        return arm.move_joints(self.far, speed_fraction=0.001, timeout_s=60)

    def amid_a_move(self, arm: GantryArm, act: Callable[[], object]) -> object:
        """What a slow move ends in when something happens while it goes on."""
        return meanwhile(lambda: self.slow_move(arm), self.moving, act)

    @property
    def tap(self) -> Tap:
        """Of the arm that was made last."""
        return self.taps[-1]

    @property
    def sent(self) -> bytes:
        """Everything that the arm wrote which was made last."""
        return b"".join(self.tap.sent)

    def do(self, verb: str, **arguments: object) -> dict[str, object]:
        """One thing over the fault channel."""
        return self.faults.do(verb, **arguments)

    def moving(self) -> bool:
        state = self.do("state")
        return bool(state.get("busy")) or state.get("state") in ("Run", "Home")

    def _tapped(self, config: TransportConfig, name: str) -> Transport:
        self.taps.append(Tap(recorded_link(config, name)))
        return RecordingTransport(self.taps[-1])


@pytest.fixture
def gantry_bench() -> Iterator[Callable[..., GantryBench]]:
    """Makes simulated gantries; all are ended with the test."""
    with ExitStack() as stack:
        yield lambda firmware, **keys: GantryBench(stack, firmware, **keys)
