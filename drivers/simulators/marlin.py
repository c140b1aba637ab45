"""Marlin 2 on a five-axis camera gantry, behind its port."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from drivers.simulators.gantry_machine import gantry_in_world, gantry_verbs
from drivers.simulators.marlin_config import MarlinConfig
from drivers.simulators.marlin_machine import MarlinMachine
from drivers.simulators.serial_simulator import SerialSimulator

if TYPE_CHECKING:
    from typing import Self

    from mvp.devices import DeviceContext

__all__ = ["MarlinConfig", "MarlinMachine", "MarlinSimulator"]


class MarlinSimulator(SerialSimulator):
    """The board behind its port."""

    key: ClassVar[str] = "marlin"
    own_process: ClassVar[bool] = False
    Config = MarlinConfig

    @classmethod
    def from_config(
        cls, config: MarlinConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the simulator; no I/O."""
        machine = MarlinMachine(config)
        return cls(
            gantry_in_world(machine, context),
            config,
            rng=context.rng,
            name=name,
            verbs=gantry_verbs(machine, context.clock),
        )
