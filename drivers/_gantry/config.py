"""Keys of ``[arm]`` for a serial gantry with a pan/tilt head."""

from __future__ import annotations

from typing import Literal, TypeAlias

from pydantic import Field, model_validator

from mvp.devices import TransportConfig
from mvp.errors import ConfigError
from mvp.fileedge import FileModel
from mvp.kinematics import NEEDS_HEAD, arm_model

Firmware: TypeAlias = Literal["grbl", "grblhal", "fluidnc", "marlin"]
USB_IDS = {
    "0403:6001": "a motion controller behind an FTDI chip",
    "0483:5740": "a motion controller with an STM32",
    "10c4:ea60": "a motion controller behind a CP210x chip",
    "16c0:0483": "a motion controller on a Teensy",
    "1a86:55d4": "a motion controller behind a CH9102 chip",
    "1a86:7523": "a motion controller behind a CH340 chip",
    "1d50:6029": "a Marlin board",
    "2341:0042": "a motion controller on an Arduino Mega",
    "2341:0043": "a motion controller on an Arduino Uno",
    "2e8a:000a": "a motion controller with an RP2040",
    "303a:1001": "a motion controller with an ESP32",
}


_SLIDES = "XYZ"


class GantryAxis(FileModel):
    """One axis of the machine, for one joint of the arm; mm, or deg where it turns.

    Attributes:
        letter: of the axis in G-code.
        zero: machine coordinate at which the joint is 0.
        sign: -1 where the joint grows while the coordinate falls.
        low: lowest machine coordinate that the driver sends.
        high: highest machine coordinate that the driver sends.
        speed: fastest, per second; a ceiling.
        acceleration: per second squared, for deadlines.
        home: ``switch``: the firmware finds it; ``declared``: a person had put it to
            its mark when the controller was switched on, and nothing measures that. An
            axis that turns must say it: few heads have switches, and a controller may
            call itself homed without having looked for them.
        declared_at: machine coordinate of the mark; homing ends there.
        tolerance: how far from its target it may stand.
    """

    letter: str = Field(pattern="^[XYZABCUVW]$")
    zero: float = 0.0
    sign: Literal[1, -1] = 1
    low: float
    high: float
    speed: float = Field(gt=0)
    acceleration: float = Field(gt=0)
    home: Literal["switch", "declared"] | None = None
    declared_at: float = 0.0
    tolerance: float = Field(default=0.02, gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> GantryAxis:
        if self.low >= self.high:
            raise ValueError(f"{self.letter}: low {self.low} is not below {self.high}")
        if self.declared and not self.low <= self.declared_at <= self.high:
            raise ValueError(f"{self.letter}: declared_at is outside of low and high")
        return self

    @property
    def declared(self) -> bool:
        """Whether nothing but a person's word says where it is."""
        return self.home == "declared"


class GantryConfig(TransportConfig):
    """Keys of the gantry, beside its port.

    Attributes:
        firmware: which family and dialect it speaks.
        model: kinematic model; its joints are those of ``axes``, in order.
        axes: one per joint.
        serial: name of this machine, for calibrations; the firmwares have none.
        identify_s: how long to ask who is there; boards that restart need seconds.
        answer_s: how long an answer may take that waits for no motion.
        homing_s: longest silence during homing.
        settle_s: wait after every motion; ringing is not visible to the firmware.
        number_lines: of Marlin: line numbers and checksums, its only protection.
    """

    firmware: Firmware
    model: str = "gantry_xyz_pan_tilt"
    axes: list[GantryAxis] = Field(min_length=1)
    serial: str = ""
    identify_s: float = Field(default=15.0, ge=0)
    answer_s: float = Field(default=1.0, gt=0)
    homing_s: float = Field(default=180.0, gt=0)
    settle_s: float = Field(default=0.2, ge=0, le=60)
    number_lines: bool = True

    @model_validator(mode="after")
    def _one_axis_per_joint(self) -> GantryConfig:
        try:
            joints = arm_model(self.model).joint_names
        except ConfigError as error:
            raise ValueError(error.message) from error
        if len(self.axes) == len(_SLIDES) < len(joints):
            raise ValueError(
                f"{self.model} has the joints {', '.join(joints)}, the machine only "
                f"three axes. {NEEDS_HEAD}"
            )
        if len(self.axes) != len(joints):
            raise ValueError(
                f"{self.model} has the joints {', '.join(joints)}: one axis for each, "
                f"not {len(self.axes)}"
            )
        letters = [axis.letter for axis in self.axes]
        if len(set(letters)) < len(letters):
            raise ValueError("two axes have the same letter")
        self._require_homes()
        return self

    def _require_homes(self) -> None:
        model = arm_model(self.model)
        silent = [
            f"{axis.letter} ({joint})"
            for axis, joint, unit in zip(
                self.axes, model.joint_names, model.joint_units, strict=True
            )
            if unit == "rad" and axis.home is None
        ]
        if silent:
            raise ValueError(
                f'{", ".join(silent)} turns: say home = "declared" where a person puts '
                'it to its mark before switching on, home = "switch" where the '
                "controller finds a switch of it"
            )
