"""GRBL 1.1, grblHAL or FluidNC on a five-axis camera gantry, behind its port."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from drivers.simulators.gantry_machine import gantry_in_world, gantry_verbs
from drivers.simulators.grbl_machine import GrblMachine
from drivers.simulators.grbl_profiles import GrblConfig
from drivers.simulators.serial_simulator import SerialSimulator

if TYPE_CHECKING:
    from typing import Self

    from mvp.devices import DeviceContext

__all__ = ["GrblConfig", "GrblMachine", "GrblSimulator"]


class GrblSimulator(SerialSimulator):
    """The controller with its fault channel: ``gantry_verbs`` and ``refuse_next``."""

    key: ClassVar[str] = "grbl"
    own_process: ClassVar[bool] = False
    Config = GrblConfig

    @classmethod
    def from_config(
        cls, config: GrblConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the simulator; no I/O."""
        machine = GrblMachine(config)
        return cls(
            gantry_in_world(machine, context),
            config,
            rng=context.rng,
            name=name,
            verbs={
                **gantry_verbs(machine, context.clock),
                "refuse_next": lambda asked: machine.refuse_next(
                    int(str(asked["code"]))
                ),
            },
        )
