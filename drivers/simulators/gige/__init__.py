"""A GigE Vision camera on the loopback interface that shows the world."""

from drivers.simulators.gige.simulator import GigeSimulator, GigeSimulatorConfig

__all__ = ["GigeSimulator", "GigeSimulatorConfig"]
