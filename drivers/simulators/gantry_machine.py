"""What the simulated gantry controllers share: port, faults, and the arm they move."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, cast

from drivers.simulators.host import Machine
from drivers.simulators.serial_simulator import LineSettings, Reported, SerialSimulator

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivers.simulators.control import Verb
    from drivers.simulators.gcode_axes import Axes
    from drivers.simulators.world_port import WorldPort
    from mvp.devices import Clock, DeviceContext


class GantryMachine(Machine, Protocol):
    """A G-code controller whose axes can be tampered with."""

    axes: Axes

    def places(self) -> tuple[float, ...]:
        """True joints of the arm, rad or mm."""
        ...

    def state(self) -> dict[str, object]:
        """What the fault channel shows."""
        ...

    def power_up(self, now_s: float) -> None:
        """The power comes on."""
        ...


def _in_world(machine: GantryMachine, context: DeviceContext) -> Machine:
    """The machine, telling the world of a context where its axes are."""
    if context.world is None:
        return machine
    world = cast("WorldPort", context.world)
    world.report_arm(context.clock.now_s(), machine.places())
    return Reported(machine, world.report_arm)


def gantry_verbs(machine: GantryMachine, clock: Clock) -> dict[str, Verb]:
    """Faults of any G-code controller.

    ``state``; ``push`` (``axis``, ``amount``): an axis is moved by hand; ``press`` and
    ``let_go`` (``axis``): its switch is held down; ``break`` and ``mend`` (``axis``): it
    never closes any more; ``power_cycle``.
    """

    def axis(asked: Mapping[str, object]) -> int:
        letters = [one.letter for one in machine.axes.settings]
        return letters.index(str(asked["axis"]))

    return {
        "state": lambda asked: {**machine.state(), "moves_begun": machine.axes.begun},
        "push": lambda asked: machine.axes.turn_by_hand(
            axis(asked), float(str(asked["amount"]))
        ),
        "press": lambda asked: machine.axes.press.add(axis(asked)),
        "let_go": lambda asked: machine.axes.press.discard(axis(asked)),
        "break": lambda asked: machine.axes.broken.add(axis(asked)),
        "mend": lambda asked: machine.axes.broken.discard(axis(asked)),
        "power_cycle": lambda asked: machine.power_up(clock.now_s()),
    }


class GantrySimulator(SerialSimulator):
    """A G-code controller behind its port.

    The fault channel has ``gantry_verbs``, and those that are given beside them.
    """

    def __init__(
        self,
        machine: GantryMachine,
        line: LineSettings,
        context: DeviceContext,
        *,
        name: str,
        verbs: Mapping[str, Verb],
    ) -> None:
        super().__init__(
            _in_world(machine, context),
            line,
            rng=context.rng,
            name=name,
            verbs={**gantry_verbs(machine, context.clock), **verbs},
        )
