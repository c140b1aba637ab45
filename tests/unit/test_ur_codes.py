"""The controller's codes: every one explained to the program and to the reader."""

from pathlib import Path

import pytest

from drivers._ur.codes import (
    ROBOT_MODES,
    SAFETY_MODES,
    TROUBLES,
    mode_trouble,
    safety_trouble,
    trouble,
)
from drivers.arm_ur import UrArm
from mvp.devices import DeviceContext, ScaledClock
from mvp.errors import ConfigError

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to" / "connect-a-ur-arm.md"
# Bits of safety_status_bits as the controller sets them.
NORMAL, PROTECTIVE, ROBOT_EMERGENCY = 0x001, 0x404, 0x4C0


def test_the_how_to_explains_every_code():
    text = HOW_TO.read_text()
    assert [code for code in TROUBLES if f"`{code}`" not in text] == []


def test_every_code_says_what_to_do():
    assert all(row.message and row.hint for row in TROUBLES.values())
    fault = trouble("local-mode").fault("arm")
    assert (fault.code, fault.device) == ("local-mode", "arm")


def test_only_normal_and_reduced_allow_motion():
    free = [mode for mode in SAFETY_MODES if safety_trouble(mode) is None]
    assert free == [1, 2]
    assert safety_trouble(99) is not None


def test_only_running_allows_motion():
    free = [mode for mode in ROBOT_MODES if mode_trouble(mode) is None]
    assert free == [7]
    assert mode_trouble(42) is not None


@pytest.mark.parametrize(
    ("bits", "code"),
    [(PROTECTIVE, "protective-stop"), (ROBOT_EMERGENCY, "emergency-stop")],
)
def test_the_bits_of_a_stop_count_even_before_its_mode(bits, code):
    assert safety_trouble(1, NORMAL) is None
    assert safety_trouble(1, bits).code == code


@pytest.mark.parametrize(
    "keys",
    [
        {"model": "ur5"},
        {"model": "gantry_xyz_pan_tilt"},
        {"joint_speed_deg_s": 0},
        {"joint_speed_deg_s": 181},
        {"stop_deceleration_deg_s2": 50},
        {"payload_kg": -1},
        {"payload_cog_mm": [0, 0]},
        {"speed": 3},
    ],
)
def test_nonsense_in_the_cell_file_is_refused(keys):
    with pytest.raises(ValueError):  # noqa: PT011
        UrArm.Config.model_validate({"host": "robot", "payload_kg": 1.0, **keys})


def test_a_robot_on_a_wire_needs_real_time():
    config = UrArm.Config(host="robot", payload_kg=1.0)
    with pytest.raises(ConfigError, match="real time"):
        UrArm.from_config(config, DeviceContext(clock=ScaledClock(2.0)), name="arm")
