"""Keys of ``[arm]`` for a Universal Robots arm."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, field_validator

from mvp.fileedge import FileModel
from mvp.kinematics import arm_model

if TYPE_CHECKING:
    from mvp.kinematics import ArmModel

_FASTEST_RAD_S = 3.14  # the client library refuses more
_NEXT_TO_NOTHING_M = 1e-6
_Three = Annotated[list[float], Field(min_length=3, max_length=3)]


def _zeros() -> list[float]:
    return [0.0, 0.0, 0.0]


class UrArmConfig(FileModel):
    """What the cell file says about the robot. Speeds and accelerations are ceilings."""

    host: str = Field(min_length=1, description="name or address of the controller")
    model: str = "ur5e"
    serial: str = Field(default="", description="refuse any other robot")
    tcp_mm: _Three = Field(default_factory=_zeros, description="tool point, tool frame")
    tcp_rotation_deg: _Three = Field(
        default_factory=_zeros, description="rotation vector of the tool point's frame"
    )
    payload_kg: float = Field(ge=0, le=35, description="everything on the flange")
    payload_cog_mm: _Three = Field(
        default_factory=_zeros, description="its centre of gravity, tool frame"
    )
    joint_speed_deg_s: float = Field(default=60.0, gt=0, le=180)
    joint_acceleration_deg_s2: float = Field(default=80.0, gt=0, le=800)
    stop_deceleration_deg_s2: float = Field(default=170.0, ge=115, le=229)
    arrival_tolerance_deg: float = Field(default=0.05, gt=0, le=1)
    handshake_timeout_s: float = Field(default=10.0, ge=1, le=60)
    data_timeout_s: float = Field(
        default=0.5,
        ge=0.1,
        le=2.0,
        description="older data of the controller are a fault",
    )
    frequency_hz: float = Field(default=125.0, ge=50, le=500)
    upper_registers: bool = Field(
        default=False, description="use RTDE registers 24 to 47; below 5.23 only"
    )
    no_ext_ft: bool = Field(
        default=False, description="leave the external force input to others"
    )
    dh_calibration: str = Field(
        default="",
        description="file with the factory-calibrated kinematics of this very robot; "
        "checked against the controller's own pose",
    )

    @field_validator("model")
    @classmethod
    def _of_the_family(cls, name: str) -> str:
        if not name.startswith("ur"):
            raise ValueError(f"{name!r} is no Universal Robots arm")
        try:
            return arm_model(name).name
        except Exception as error:
            raise ValueError(str(error)) from error

    @property
    def arm(self) -> ArmModel:
        """Nominal kinematics of this model."""
        return arm_model(self.model)

    @property
    def speed_rad_s(self) -> float:
        """Ceiling for the leading axis, whichever that is."""
        own = float(self.arm.joint_speed.min())
        return min(math.radians(self.joint_speed_deg_s), own, _FASTEST_RAD_S)

    @property
    def acceleration_rad_s2(self) -> float:
        """Ceiling for the leading axis."""
        return math.radians(self.joint_acceleration_deg_s2)

    @property
    def stop_rad_s2(self) -> float:
        """How hard it brakes when it is stopped."""
        return math.radians(self.stop_deceleration_deg_s2)

    @property
    def tcp_m_rad(self) -> list[float]:
        """The tool point as the controller wants it."""
        turn = [math.radians(value) for value in self.tcp_rotation_deg]
        return [value / 1000 for value in self.tcp_mm] + turn

    @property
    def payload_cog_m(self) -> list[float]:
        """The centre of gravity as the controller wants it.

        All zeros would mean to the control program: leave the one that is set.
        """
        if not any(self.payload_cog_mm):
            return [0.0, 0.0, _NEXT_TO_NOTHING_M]
        return [value / 1000 for value in self.payload_cog_mm]
