"""Marlin 2 on a five-axis camera gantry, behind its port."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from drivers.simulators.gantry_machine import GantrySimulator
from drivers.simulators.marlin_config import MarlinConfig
from drivers.simulators.marlin_machine import MarlinMachine

if TYPE_CHECKING:
    from typing import Self

    from mvp.devices import DeviceContext

__all__ = ["MarlinConfig", "MarlinMachine", "MarlinSimulator"]


class MarlinSimulator(GantrySimulator):
    """The board behind its port."""

    key: ClassVar[str] = "marlin"
    Config = MarlinConfig

    @classmethod
    def from_config(
        cls, config: MarlinConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the simulator; no I/O."""
        return cls(MarlinMachine(config), config, context, name=name, verbs={})
