"""A simulated device, its fault channel, and the real driver that talks to it."""

from __future__ import annotations

import socket
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.simulators.control import ControlClient
from mvp.devices import AXES, DeclaresAxes, DeviceContext
from mvp.testing import nothing_in_the_way
from tools.faults.devices import IMPOSTORS, MAKES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from contextlib import ExitStack

    from tools.faults.devices import Make
    from tools.faults.words import Case, Order

_UR_MOTIONS = (1, 2, 3, 4, 45)  # its words for every kind of move
_EXPOSURE_S = 0.01
_FRAME_IN_S = 0.8  # when a frame may begin that a fault shall find awaited
_CAMERA_TIMEOUT_S = 10.0
_GVCP_PORT = 3956
_DATAGRAMS = 200


class Bench:
    """One simulator that runs, and drivers for it.

    Args:
        make: of which kind.
        case: which fault it is for.
        stack: ends everything.
    """

    def __init__(self, make: Make, case: Case, stack: ExitStack) -> None:
        self.make = make
        self._case = case
        self._stack = stack
        brisk = {} if case.at == "motion" else make.brisk
        self._announced, port = _started(make, {**brisk, **case.simulator}, stack)
        self._faults = stack.enter_context(ControlClient(port))

    def device(self, announced: Mapping[str, object] | None = None) -> Any:
        """A driver, not yet open."""
        at = self._announced if announced is None else announced
        keys = {**at, **self.make.driver_keys, **self._case.driver}
        config = self.make.driver.Config.model_validate(keys)
        return self.make.driver.from_config(
            config, DeviceContext(), name=self.make.role
        )

    def misled(self) -> Any:
        """A driver whose port leads to another simulator."""
        other = MAKES[IMPOSTORS[self._case.impostor]]
        announced, _ = _started(other, {}, self._stack)
        return self.device({**self._announced, **announced})

    def do(self, orders: tuple[Order, ...]) -> None:
        """Through the fault channel, in order."""
        for one in orders:
            self._faults.do(one.verb, **one.keys)

    def motions(self) -> int:
        """How many motions the far end was ever asked for."""
        return int(str(self._faults.do("state")["moves_begun"]))

    def place(self) -> tuple[float, ...]:
        """Where the far end truly is, in units of its own."""
        state = self._faults.do("state")
        found = state.get("truth", state.get("joints", state.get("places")))
        values = found.values() if isinstance(found, dict) else found
        return tuple(float(value) for value in values)  # type: ignore[union-attr]

    def is_far(self, place: tuple[float, ...]) -> bool:
        """Whether a place is the target of ``go_far``, in units of its own."""
        return False

    def under_way(self) -> Callable[[], bool]:
        """To be asked after an action was begun: whether the far end is at it."""
        before = self.motions()
        return lambda: self.motions() > before

    def make_ready(self, device: Any) -> None:
        """Whatever it takes until it may act; a person would allow each step."""
        device.open()

    def go_near(self, device: Any) -> object:
        """An action that ends soon; what was reached."""
        return self.go(device, self.make.near, 60)

    def go_far(self, device: Any, timeout_s: float) -> object:
        """An action that takes long enough to be met by a fault."""
        return self.go(device, self.make.far, timeout_s)

    def go_beyond(self, device: Any) -> object:
        """An action that must be refused."""
        return self.go(device, self.make.beyond, 60)

    def go(self, device: Any, target: tuple[float, ...], timeout_s: float) -> object:
        """Move there."""
        raise TypeError("a bench says how to move")

    def is_near(self, reached: Any) -> bool:
        """Whether ``go_near`` did what it should."""
        raise TypeError("a bench says what is near")


class ArmBench(Bench):
    """An arm; it is brought back by its own way of recovery."""

    def make_ready(self, device: Any) -> None:
        """Each step of the recovery, and open."""
        for step in device.recovery():
            step.act()
        device.open()
        if isinstance(device, DeclaresAxes) and not device.homed:
            device.home(timeout_s=60, clear=nothing_in_the_way)

    def go(self, device: Any, target: tuple[float, ...], timeout_s: float) -> object:
        """Move there; slowly to ``far``."""
        share = self.make.slow if target == self.make.far else 1.0
        return device.move_joints(target, speed_fraction=share, timeout_s=timeout_s)

    def is_near(self, reached: Any) -> bool:
        """It stands there."""
        off = np.abs(np.subtract(reached.joints, self.make.near)).max()
        return bool(off < 0.05) and reached.standing


class UrBench(ArmBench):
    """The controller counts brakings as motions, so its log is counted instead."""

    def motions(self) -> int:
        """Motion commands received."""
        commands = self._faults.do("state")["commands"]
        return sum(c["command"] in _UR_MOTIONS for c in commands)  # type: ignore[attr-defined]


class LensBench(Bench):
    """A motorised lens; it is homed where it has lost its home."""

    def make_ready(self, device: Any) -> None:
        """Open and home."""
        device.open()
        if not device.state().homed:
            device.home(timeout_s=60)

    def go(self, device: Any, target: tuple[float, ...], timeout_s: float) -> object:
        """Move there."""
        steps = {axis: int(n) for axis, n in zip(AXES, target, strict=True)}
        return device.move_steps(**steps, timeout_s=timeout_s)

    def is_far(self, place: tuple[float, ...]) -> bool:
        """Every motor stands at its step."""
        return bool(np.abs(np.subtract(place, self.make.far)).max() < 1)

    def is_near(self, reached: Any) -> bool:
        """Every motor stands at its step."""
        return tuple(reached.steps()[axis] for axis in AXES) == self.make.near


class CameraBench(Bench):
    """A camera; it moves nothing, so there are no motions to count."""

    def do(self, orders: tuple[Order, ...]) -> None:
        """Through the fault channel; datagrams go to the camera's own port."""
        for one in orders:
            if one.verb == "datagrams":
                self._send_garbage()
            else:
                super().do((one,))

    def motions(self) -> int:
        """None."""
        return 0

    def under_way(self) -> Callable[[], bool]:
        """After a moment: the frame is awaited and has not been exposed."""
        from_s = time.monotonic() + _FRAME_IN_S / 3
        return lambda: time.monotonic() > from_s

    def go_near(self, device: Any) -> object:
        """One frame, now."""
        device.configure(exposure_s=_EXPOSURE_S)
        return device.capture(
            not_before_s=time.monotonic(), timeout_s=_CAMERA_TIMEOUT_S
        )

    def go_far(self, device: Any, timeout_s: float) -> object:
        """One frame, soon."""
        return device.capture(
            not_before_s=time.monotonic() + _FRAME_IN_S, timeout_s=timeout_s
        )

    def go_beyond(self, device: Any) -> object:
        """An exposure that it cannot make."""
        return device.configure(exposure_s=self.make.beyond[0])

    def is_near(self, reached: Any) -> bool:
        """A picture of the right age and exposure."""
        age_s = time.monotonic() - reached.exposure_start_s
        exposed = abs(reached.exposure_s - _EXPOSURE_S) < 1e-4
        return exposed and reached.pixels.size > 0 and age_s < _CAMERA_TIMEOUT_S

    def _send_garbage(self) -> None:
        rng = np.random.default_rng(5)
        place = (str(self._announced["address"]), _GVCP_PORT)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            for size in rng.integers(0, 600, _DATAGRAMS):
                line.sendto(rng.bytes(size), place)


_BY_ROLE: dict[str, type[Bench]] = {
    "arm": ArmBench,
    "lens": LensBench,
    "camera": CameraBench,
}


def bench_of(device: str, case: Case, stack: ExitStack) -> Bench:
    """Start the simulator of a device; it ends with the stack."""
    make = MAKES[device]
    kind = UrBench if device == "ur" else _BY_ROLE[make.role]
    return kind(make, case, stack)


def _started(
    make: Make, keys: Mapping[str, object], stack: ExitStack
) -> tuple[dict[str, object], int]:
    """Start a simulator; what it announces, and the port of its fault channel."""
    config = make.simulator.Config.model_validate({**make.simulator_keys, **keys})
    context = DeviceContext(rng=np.random.default_rng(7))
    simulator = make.simulator.from_config(config, context, name=make.role)
    stack.callback(simulator.stop)
    return dict(simulator.start()), simulator.control_port
