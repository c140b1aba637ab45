"""For driver authors: what every driver promises, as test classes, and helpers.

Needs pytest only to be run; nothing of it is used at run time.
"""

from mvp.testing.conformance import (
    ArmConformance,
    CameraConformance,
    DeviceConformance,
    LensConformance,
)
from mvp.testing.require import meanwhile, refuses, require, wait_until
from mvp.testing.virtual_cell import VirtualCell, block, example_belief, virtual_cell

__all__ = [
    "ArmConformance",
    "CameraConformance",
    "DeviceConformance",
    "LensConformance",
    "VirtualCell",
    "block",
    "example_belief",
    "meanwhile",
    "refuses",
    "require",
    "virtual_cell",
    "wait_until",
]
