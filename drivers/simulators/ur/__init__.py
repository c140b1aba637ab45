"""A Universal Robots controller on its genuine ports, down to the bytes.

It answers RTDE (30004), script uploads (30001 to 30003) and the dashboard (29999) on
one loopback address, and moves an arm that nobody built.
"""

from drivers.simulators.ur.simulator import UrSimulator, UrSimulatorConfig

__all__ = ["UrSimulator", "UrSimulatorConfig"]
