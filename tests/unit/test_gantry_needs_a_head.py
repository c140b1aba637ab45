"""A machine with three sliding axes: what is said about it, and where."""

from __future__ import annotations

import pytest

from drivers.arm_gantry import GantryArm
from mvp.errors import ConfigError
from mvp.kinematics import arm_model

AXES = [
    {"letter": x, "low": -100, "high": 0, "speed": 10, "acceleration": 10}
    for x in "XYZ"
]
HEAD = [{**axis, "letter": x} for axis, x in zip(AXES, "AB", strict=False)]


@pytest.mark.parametrize("firmware", ["grbl", "grblhal", "fluidnc", "marlin"])
def test_three_axes_are_refused_and_what_is_supported_is_said(firmware: str) -> None:
    keys = {"port": "x", "firmware": firmware, "axes": AXES}
    with pytest.raises(ValueError, match="one viewing direction") as refused:
        GantryArm.Config.model_validate(keys)
    assert "pan/tilt head (gantry_xyz_pan_tilt)" in str(refused.value)
    assert "grblHAL, FluidNC or Marlin" in str(refused.value)
    declared = [{**axis, "home": "declared"} for axis in HEAD]
    assert GantryArm.Config.model_validate({**keys, "axes": AXES + declared})


@pytest.mark.parametrize("firmware", ["grblhal", "fluidnc", "marlin"])
def test_an_axis_that_turns_has_to_say_what_finds_it(firmware: str) -> None:
    tilt = {**HEAD[1], "home": "switch"}
    keys = {"port": "x", "firmware": firmware, "axes": [*AXES, HEAD[0], tilt]}
    with pytest.raises(ValueError, match=r"A \(pan\) turns: say home") as refused:
        GantryArm.Config.model_validate(keys)
    assert "B (tilt)" not in str(refused.value)


@pytest.mark.parametrize("name", ["gantry_xyz", "xyz", "Cartesian"])
def test_a_model_of_three_axes_is_refused_with_the_reason(name: str) -> None:
    with pytest.raises(ConfigError, match="unknown arm model") as refused:
        arm_model(name)
    assert "one viewing direction" in refused.value.hint
