"""What the simulated lens controllers share: port, faults, and the world they move."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, cast

from drivers.simulators.host import Machine
from drivers.simulators.serial_simulator import LineSettings, Reported, SerialSimulator

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivers.simulators.control import Verb
    from drivers.simulators.motor import Motor
    from drivers.simulators.world_port import WorldPort
    from mvp.devices import Axis, Clock, DeviceContext


class LensMachine(Machine, Protocol):
    """A lens controller as seen from its wire, with motors that can be tampered with."""

    axes: dict[Axis, Motor]

    def places(self) -> dict[str, float]:
        """True steps of zoom, focus and iris."""
        ...

    def state(self) -> dict[str, object]:
        """What the fault channel shows."""
        ...

    def power_up(self, now_s: float) -> None:
        """The power comes on."""
        ...


def _in_world(machine: LensMachine, context: DeviceContext) -> Machine:
    """The machine, telling the world of a context where its motors are."""
    if context.world is None:
        return machine
    world = cast("WorldPort", context.world)
    world.report_lens(context.clock.now_s(), machine.places())
    return Reported(machine, world.report_lens)


def lens_verbs(machine: LensMachine, clock: Clock) -> dict[str, Verb]:
    """Faults of any lens controller.

    ``state``; ``stall`` and ``release`` (``axis``): the shaft is held and let go;
    ``turn`` (``axis``, ``steps``): somebody turns it by hand; ``power_cycle``.
    """

    def motor(asked: Mapping[str, object]) -> Motor:
        return machine.axes[cast("Axis", asked["axis"])]

    def hold(asked: Mapping[str, object], *, fast: bool) -> None:
        motor(asked).stalled = fast

    def turn(asked: Mapping[str, object]) -> None:
        motor(asked).turn_by_hand(float(str(asked["steps"])))

    def begun() -> int:
        return sum(motor.begun for motor in machine.axes.values())

    return {
        "state": lambda asked: {**machine.state(), "moves_begun": begun()},
        "stall": lambda asked: hold(asked, fast=True),
        "release": lambda asked: hold(asked, fast=False),
        "turn": turn,
        "power_cycle": lambda asked: machine.power_up(clock.now_s()),
    }


class LensSimulator(SerialSimulator):
    """A lens controller behind its port; the fault channel has ``lens_verbs``."""

    def __init__(
        self,
        machine: LensMachine,
        line: LineSettings,
        context: DeviceContext,
        *,
        name: str,
    ) -> None:
        super().__init__(
            _in_world(machine, context),
            line,
            rng=context.rng,
            name=name,
            verbs=lens_verbs(machine, context.clock),
        )
