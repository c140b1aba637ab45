"""For driver authors: what every driver promises, as test classes, and helpers.

Needs pytest only to be run; nothing of it is used at run time.
"""

from mvp.testing.conformance import DeviceConformance
from mvp.testing.conformance_arm import ArmConformance
from mvp.testing.conformance_camera import CameraConformance
from mvp.testing.conformance_lens import LensConformance
from mvp.testing.far_end import FarEnd
from mvp.testing.require import (
    meanwhile,
    nothing_in_the_way,
    refuses,
    require,
    wait_until,
)
from mvp.testing.virtual_cell import VirtualCell, block, example_belief, virtual_cell

__all__ = [
    "ArmConformance",
    "CameraConformance",
    "DeviceConformance",
    "FarEnd",
    "LensConformance",
    "VirtualCell",
    "block",
    "example_belief",
    "meanwhile",
    "nothing_in_the_way",
    "refuses",
    "require",
    "virtual_cell",
    "wait_until",
]
