"""The lens controllers that wire tests drive: simulator, driver, and its keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.lens_scf4 import Scf4Lens
from drivers.lens_theia import TheiaLens
from drivers.lens_visca import ViscaLens
from drivers.simulators.scf4 import Scf4Simulator
from drivers.simulators.theia import TheiaSimulator
from drivers.simulators.visca import ViscaSimulator
from mvp.devices import DeviceContext

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mvp.devices import Lens
    from mvp.testing import FarEnd


@dataclass(frozen=True)
class LensMake:
    """One make of controller; ``keys`` are those of the driver beside its port."""

    simulator: type
    driver: type
    keys: Mapping[str, object]

    def over(self, far_end: FarEnd, **keys: object) -> Lens:
        """A driver over a link in memory, not yet open."""
        fast = {"answer_s": 0.2, "identify_s": 0}
        config = self.driver.Config.model_validate(
            {"port": "x", **self.keys, **fast, **keys}
        )
        context = DeviceContext(transports=far_end.as_link)
        return self.driver.from_config(config, context, name="lens")


SCF4 = LensMake(
    Scf4Simulator,
    Scf4Lens,
    {
        "zoom": {"low": 17850, "high": 38650, "backlash_steps": 60},
        "focus": {"low": 28500, "high": 38000, "approach": "from_above"},
        "iris": {"low": 100, "high": 2200, "backlash_steps": 20},
        "focus_motor": {"letter": "B", "home_step": 36000},
    },
)
# A backlash of 37 steps gives the vendor's overshoot of 60.
THEIA = LensMake(
    TheiaSimulator,
    TheiaLens,
    {
        "zoom": {"low": 100, "high": 3000, "backlash_steps": 37},
        "focus": {
            "low": 100,
            "high": 7800,
            "approach": "from_above",
            "backlash_steps": 37,
        },
        "iris": {"low": 0, "high": 75},
    },
)
VISCA = LensMake(
    ViscaSimulator,
    ViscaLens,
    {
        "zoom": {
            "low": 0,
            "high": 0x3F00,
            "approach": "from_above",
            "backlash_steps": 20,
        },
        "focus": {"low": 0x1100, "high": 0xE000, "backlash_steps": 20},
        "iris": {"low": 0, "high": 0x11},
    },
)
