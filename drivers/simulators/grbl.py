"""GRBL 1.1, grblHAL or FluidNC on a five-axis camera gantry, behind its port."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from drivers.simulators.gantry_machine import GantrySimulator
from drivers.simulators.grbl_machine import GrblMachine
from drivers.simulators.grbl_profiles import GrblConfig

if TYPE_CHECKING:
    from typing import Self

    from mvp.devices import DeviceContext

__all__ = ["GrblConfig", "GrblMachine", "GrblSimulator"]


class GrblSimulator(GantrySimulator):
    """The controller with its fault channel: ``gantry_verbs`` and ``refuse_next``."""

    key: ClassVar[str] = "grbl"
    Config = GrblConfig

    @classmethod
    def from_config(
        cls, config: GrblConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the simulator; no I/O."""
        machine = GrblMachine(config)
        return cls(
            machine,
            config,
            context,
            name=name,
            verbs={
                "refuse_next": lambda asked: machine.refuse_next(
                    int(str(asked["code"]))
                ),
            },
        )
