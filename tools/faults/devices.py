"""The devices of the matrix: simulator, driver, and how both are set up."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivers.arm_gantry import GantryArm
from drivers.arm_ur import UrArm
from drivers.camera_genicam import GenicamCamera
from drivers.camera_opencv import OpencvCamera
from drivers.lens_scf4 import Scf4Lens
from drivers.lens_theia import TheiaLens
from drivers.lens_visca import ViscaLens
from drivers.simulators.gige import GigeSimulator
from drivers.simulators.grbl import GrblSimulator
from drivers.simulators.marlin import MarlinSimulator
from drivers.simulators.mjpeg import MjpegSimulator
from drivers.simulators.scf4 import Scf4Simulator
from drivers.simulators.theia import TheiaSimulator
from drivers.simulators.ur import UrSimulator
from drivers.simulators.visca import ViscaSimulator

if TYPE_CHECKING:
    from collections.abc import Mapping

ANSWER_S = 0.5


@dataclass(frozen=True)
class Make:
    """How to build one kind of device.

    Attributes:
        near, far: two targets that are a visible way apart.
        beyond: a target that must be refused.
        slow: share of its speed on the way to ``far``, so that a fault meets it there.
        brisk: keys of the simulator where no fault has to meet it in motion.
        keeps: its library opens things once that stay until the process ends.
    """

    role: str
    simulator: Any
    driver: Any
    simulator_keys: Mapping[str, object]
    driver_keys: Mapping[str, object]
    near: tuple[float, ...] = ()
    far: tuple[float, ...] = ()
    beyond: tuple[float, ...] = ()
    slow: float = 1.0
    brisk: Mapping[str, object] = field(default_factory=dict)
    keeps: bool = False


_SERIAL = {"answer_s": ANSWER_S, "identify_s": 1.5}
_FEEDS = {"speed": 300, "acceleration": 1000}
_TURNS = {"speed": 90, "acceleration": 300, "home": "declared"}


def _gantry(firmware: str, linear: list[tuple[float, float, float]]) -> dict[str, Any]:
    """Axes X, Y, Z as (zero, low, high), and two that turn."""
    axes = [
        {"letter": letter, "zero": zero, "low": low, "high": high, **_FEEDS}
        for letter, (zero, low, high) in zip("XYZ", linear, strict=True)
    ]
    axes += [{"letter": letter, "low": -90, "high": 90, **_TURNS} for letter in "AB"]
    return {**_SERIAL, "firmware": firmware, "axes": axes, "settle_s": 0.0}


_QUICK_HOME = {"boot_s": 0.2, "homing_seek_min": 12_000}
_GANTRY_TARGETS = {
    "near": (300.0, 300.0, 600.0, 0.1, 0.1),
    "far": (100.0, 100.0, 500.0, 0.3, 0.2),
    "beyond": (900.0, 0.0, 600.0, 0.0, 0.0),
    "slow": 0.0125,
}

MAKES: dict[str, Make] = {
    "ur": Make(
        "arm",
        UrSimulator,
        UrArm,
        {"speed_scale": 3.0, "unlock_delay_s": 0.2},
        {
            "serial": "20225500123",
            "payload_kg": 1.5,
            "payload_cog_mm": [0, 5, 40],
            "tcp_mm": [0, 0, 100],
            "joint_speed_deg_s": 120,
            "data_timeout_s": 1.0,
            "handshake_timeout_s": 5,
        },
        near=(0.0, -1.57, 1.57, -1.57, -1.57, 0.0),
        far=(1.2, -1.3, 1.4, -1.57, -1.4, 0.5),
        beyond=(7.0, -1.57, 1.57, -1.57, -1.57, 0.0),
        slow=0.1,
    ),
    "gantry, grblHAL": Make(
        "arm",
        GrblSimulator,
        GantryArm,
        {"speed_scale": 40, "profile": "grblhal", **_QUICK_HOME},
        _gantry(
            "grblhal", [(-600, -1199, -0.5), (-600, -1199, -0.5), (-900, -899, -0.5)]
        ),
        **_GANTRY_TARGETS,
    ),
    "gantry, Marlin": Make(
        "arm",
        MarlinSimulator,
        GantryArm,
        {"speed_scale": 40, **_QUICK_HOME},
        _gantry("marlin", [(600, 0, 1200), (600, 0, 1200), (0, 0, 900)]),
        **_GANTRY_TARGETS,
    ),
    "scf4": Make(
        "lens",
        Scf4Simulator,
        Scf4Lens,
        {
            "speed_scale": 6,
            "zoom": {"low": 17000, "high": 39500, "start": 31800, "reference": 32000},
            "focus": {"low": 27500, "high": 39000, "start": 35800, "reference": 36000},
        },
        {
            **_SERIAL,
            "zoom": {"low": 17850, "high": 38650, "backlash_steps": 60},
            "focus": {"low": 28500, "high": 38000, "approach": "from_above"},
            "iris": {"low": 100, "high": 2200, "backlash_steps": 20},
            "focus_motor": {"letter": "B", "home_step": 36000},
        },
        near=(31000, 35000, 900),
        far=(20000, 29000, 1500),
        beyond=(40000, 35000, 900),
        brisk={"speed_scale": 40},
    ),
    "theia-mcr": Make(
        "lens",
        TheiaSimulator,
        TheiaLens,
        {
            "speed_scale": 6,
            "zoom": {"low": 0, "high": 3227, "start": 3000, "reference": 3119},
            "focus": {"low": 0, "high": 8390, "start": 7800, "reference": 7959},
        },
        {
            **_SERIAL,
            "zoom": {"low": 100, "high": 3000, "backlash_steps": 37},
            "focus": {
                "low": 100,
                "high": 7800,
                "approach": "from_above",
                "backlash_steps": 37,
            },
            "iris": {"low": 0, "high": 75},
        },
        near=(2800, 7000, 50),
        far=(1000, 4000, 20),
        beyond=(3100, 7000, 50),
        brisk={"speed_scale": 40},
    ),
    "visca": Make(
        "lens",
        ViscaSimulator,
        ViscaLens,
        {"speed_scale": 4},
        {
            **_SERIAL,
            "zoom": {
                "low": 0,
                "high": 0x3F00,
                "approach": "from_above",
                "backlash_steps": 20,
            },
            "focus": {"low": 0x1100, "high": 0xE000, "backlash_steps": 20},
            "iris": {"low": 0, "high": 0x11},
        },
        near=(0x1000, 0x6000, 8),
        far=(0x3000, 0xC000, 5),
        beyond=(0x3FF0, 0x6000, 8),
        brisk={"speed_scale": 40},
    ),
}
MAKES |= {
    "genicam": Make(
        "camera",
        GigeSimulator,
        GenicamCamera,
        {"columns": 320, "rows": 240, "wait_s": 300},
        {"packet_size": 1400, "frame_slack_s": 1.0},
        beyond=(1e5,),
        keeps=True,
    ),
    "opencv": Make(
        "camera",
        MjpegSimulator,
        OpencvCamera,
        {"columns": 64, "rows": 48, "fps": 20, "latency_s": 0.2},
        {},
        beyond=(1e5,),
    ),
}
IMPOSTORS = {
    "grbl": "gantry, grblHAL",
    "marlin": "gantry, Marlin",
    "scf4": "scf4",
    "theia": "theia-mcr",
    "visca": "visca",
}
