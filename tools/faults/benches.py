"""A simulated device, its fault channel, and the real driver that talks to it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.arm_gantry import GantryArm
from drivers.lens_scf4 import Scf4Lens
from drivers.lens_theia import TheiaLens
from drivers.lens_visca import ViscaLens
from drivers.simulators.control import ControlClient
from drivers.simulators.grbl import GrblSimulator
from drivers.simulators.marlin import MarlinSimulator
from drivers.simulators.scf4 import Scf4Simulator
from drivers.simulators.theia import TheiaSimulator
from drivers.simulators.visca import ViscaSimulator
from mvp.devices import AXES, DeviceContext

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from contextlib import ExitStack

    from tools.faults.words import Case, Order

ANSWER_S = 0.5
SETTLE_S = 0.4  # what the simulator was sent last has arrived by then


@dataclass(frozen=True)
class Make:
    """How to build one kind of device.

    Attributes:
        near, far: two targets that are a visible way apart.
        beyond: a target that must be refused.
        tolerance: how far from ``near`` it may truly stand, by the driver's own words.
    """

    role: str
    simulator: Any
    driver: Any
    simulator_keys: Mapping[str, object]
    driver_keys: Mapping[str, object]
    near: tuple[float, ...]
    far: tuple[float, ...]
    beyond: tuple[float, ...]
    slow: float = 1.0
    own_keys: Mapping[str, object] = field(default_factory=dict)


class Bench:
    """One simulator that runs, and drivers for it.

    Args:
        make: of which kind.
        case: which fault it is for.
        stack: ends everything.
    """

    def __init__(self, make: Make, case: Case, stack: ExitStack) -> None:
        self.make = make
        self.role = make.role
        self._announced = _started(make, case.simulator, stack, self)
        self._case = case
        self._stack = stack

    faults: ControlClient

    def device(self, announced: Mapping[str, object] | None = None) -> Any:
        """A driver, not yet open."""
        keys = {**self.make.driver_keys, **self._case.driver}
        keys |= self._announced if announced is None else announced
        config = self.make.driver.Config.model_validate(keys)
        return self.make.driver.from_config(config, DeviceContext(), name=self.role)

    def misled(self) -> Any:
        """A driver whose port leads to another simulator."""
        other = MAKES[IMPOSTORS[self._case.impostor]]
        announced = _started(other, {}, self._stack)
        return self.device({**self._announced, **announced})

    def do(self, orders: tuple[Order, ...]) -> None:
        """Through the fault channel, in order."""
        for one in orders:
            self.faults.do(one.verb, **one.keys)

    def motions(self) -> int:
        """How many motions the far end was ever asked for."""
        return int(str(self.faults.do("state")["moves_begun"]))

    def make_ready(self, device: Any) -> None:
        """Whatever it takes until it may move; a person would allow each step."""
        if hasattr(device, "recovery"):
            for step in device.recovery():
                step.act()
        device.open()
        if self.role == "lens" and not device.state().homed:
            device.home(timeout_s=60)

    def go(self, device: Any, target: tuple[float, ...], timeout_s: float) -> object:
        """Move there."""
        if self.role == "arm":
            share = 1.0 if target == self.make.near else self.make.slow
            return device.move_joints(target, speed_fraction=share, timeout_s=timeout_s)
        steps = {axis: int(n) for axis, n in zip(AXES, target, strict=True)}
        return device.move_steps(**steps, timeout_s=timeout_s)

    def home(self, device: Any, timeout_s: float) -> object:
        """Find the references."""
        return device.home(timeout_s=timeout_s)

    def stands_near(self, reached: Any) -> bool:
        """Whether a move to ``near`` has ended there."""
        if self.role == "arm":
            off = np.abs(np.subtract(reached.joints, self.make.near)).max()
            return bool(off < 0.05) and reached.standing
        places = tuple(reached.steps()[axis] for axis in AXES)
        return places == self.make.near

    def under_way(self) -> Callable[[], bool]:
        """To be asked after a motion was begun: whether the far end has begun it."""
        before = self.motions()
        return lambda: self.motions() > before


def _started(
    make: Make, keys: Mapping[str, object], stack: ExitStack, bench: Bench | None = None
) -> dict[str, object]:
    """Start a simulator; what it announces for the driver."""
    config = make.simulator.Config.model_validate({**make.simulator_keys, **keys})
    context = DeviceContext(rng=np.random.default_rng(7))
    simulator = make.simulator.from_config(config, context, name=make.role)
    stack.callback(simulator.stop)
    announced = dict(simulator.start())
    if bench is not None:
        bench.faults = stack.enter_context(ControlClient(simulator.control_port))
    return announced


def wait_while(condition: Callable[[], bool], patience_s: float) -> bool:
    """Poll while a condition holds; whether it has ended in time."""
    end_s = time.monotonic() + patience_s
    while condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.005)
    return True


_SERIAL = {"answer_s": ANSWER_S, "identify_s": 2.0}
_FEEDS = {"speed": 300, "acceleration": 1000}
_TURNS = {"speed": 90, "acceleration": 300, "home": "declared"}


def _gantry(firmware: str, linear: list[tuple[float, float, float]]) -> dict[str, Any]:
    """Axes X, Y, Z as (zero, low, high), and two that turn."""
    axes = [
        {"letter": letter, "zero": zero, "low": low, "high": high, **_FEEDS}
        for letter, (zero, low, high) in zip("XYZ", linear, strict=True)
    ]
    axes += [{"letter": letter, "low": -90, "high": 90, **_TURNS} for letter in "AB"]
    return {**_SERIAL, "firmware": firmware, "axes": axes, "settle_s": 0.0}


_GANTRY_TARGETS = {
    "near": (300.0, 300.0, 600.0, 0.1, 0.1),
    "far": (100.0, 100.0, 500.0, 0.3, 0.2),
    "beyond": (900.0, 0.0, 600.0, 0.0, 0.0),
    "slow": 0.05,
}

MAKES: dict[str, Make] = {
    "gantry, grblHAL": Make(
        "arm",
        GrblSimulator,
        GantryArm,
        {"speed_scale": 10, "profile": "grblhal", "boot_s": 0.2},
        _gantry(
            "grblhal", [(-600, -1199, -0.5), (-600, -1199, -0.5), (-900, -899, -0.5)]
        ),
        **_GANTRY_TARGETS,
    ),
    "gantry, Marlin": Make(
        "arm",
        MarlinSimulator,
        GantryArm,
        {"speed_scale": 10, "boot_s": 0.2},
        _gantry("marlin", [(600, 0, 1200), (600, 0, 1200), (0, 0, 900)]),
        **_GANTRY_TARGETS,
    ),
    "scf4": Make(
        "lens",
        Scf4Simulator,
        Scf4Lens,
        {"speed_scale": 6},
        {
            **_SERIAL,
            "zoom": {"low": 17850, "high": 38650, "backlash_steps": 60},
            "focus": {"low": 28500, "high": 38000, "approach": "from_above"},
            "iris": {"low": 100, "high": 2200, "backlash_steps": 20},
            "focus_motor": {"letter": "B", "home_step": 36000},
        },
        near=(31000, 35000, 900),
        far=(20000, 29000, 1500),
        beyond=(40000, 35000, 900),
    ),
    "theia-mcr": Make(
        "lens",
        TheiaSimulator,
        TheiaLens,
        {"speed_scale": 6},
        {
            **_SERIAL,
            "zoom": {"low": 100, "high": 3000, "backlash_steps": 37},
            "focus": {
                "low": 100,
                "high": 7800,
                "approach": "from_above",
                "backlash_steps": 37,
            },
            "iris": {"low": 0, "high": 75},
        },
        near=(2800, 7000, 50),
        far=(400, 2000, 20),
        beyond=(3100, 7000, 50),
    ),
    "visca": Make(
        "lens",
        ViscaSimulator,
        ViscaLens,
        {"speed_scale": 2},
        {
            **_SERIAL,
            "zoom": {
                "low": 0,
                "high": 0x3F00,
                "approach": "from_above",
                "backlash_steps": 20,
            },
            "focus": {"low": 0x1100, "high": 0xE000, "backlash_steps": 20},
            "iris": {"low": 0, "high": 0x11},
        },
        near=(0x1000, 0x6000, 8),
        far=(0x3000, 0xC000, 5),
        beyond=(0x3FF0, 0x6000, 8),
    ),
}
IMPOSTORS = {
    "grbl": "gantry, grblHAL",
    "marlin": "gantry, Marlin",
    "scf4": "scf4",
    "theia": "theia-mcr",
    "visca": "visca",
}
