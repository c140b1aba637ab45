"""A device on a wire knows no time but the wall's."""

from __future__ import annotations

from typing import Any

import pytest

from mvp.devices import DeviceContext, RealClock, Role, ScaledClock, load_driver
from mvp.errors import ConfigError

AXES = [
    {
        "letter": x,
        "low": -1,
        "high": 1,
        "speed": 1,
        "acceleration": 1,
        "home": "declared",
    }
    for x in "XYZAB"
]
DRIVERS: dict[str, tuple[Role, dict[str, Any]]] = {
    "ur": ("arm", {"host": "192.0.2.7", "payload_kg": 1}),
    "gantry": ("arm", {"port": "x", "firmware": "grblhal", "axes": AXES}),
    "scf4": ("lens", {"port": "x"}),
    "theia-mcr": ("lens", {"port": "x"}),
    "visca": ("lens", {"port": "x"}),
    "genicam": ("camera", {"address": "192.0.2.8"}),
    "opencv": ("camera", {"source": "http://192.0.2.8/"}),
}


def build(key: str, context: DeviceContext) -> object:
    role, keys = DRIVERS[key]
    driver = load_driver(key, role)
    return driver.from_config(driver.Config.model_validate(keys), context, name=role)


@pytest.mark.parametrize("key", DRIVERS)
def test_a_driver_is_not_built_on_a_clock_that_runs_faster(key: str) -> None:
    with pytest.raises(ConfigError, match="real time") as refused:
        build(key, DeviceContext(clock=ScaledClock(2.0)))
    assert "clock_speed = 1" in refused.value.hint


@pytest.mark.parametrize("key", DRIVERS)
@pytest.mark.parametrize("clock", [RealClock(), ScaledClock(1.0)])
def test_a_driver_is_built_on_real_time(key: str, clock: Any) -> None:
    assert build(key, DeviceContext(clock=clock)) is not None
