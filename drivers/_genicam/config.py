"""Keys of ``[camera]`` for GenICam cameras."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from drivers._genicam.choose import BackendName
from mvp.fileedge import FileModel


class GenicamCameraConfig(FileModel):
    """Keys of ``[camera]`` for GenICam cameras."""

    address: str = Field(
        min_length=1, description="IP address, serial number or user-defined name"
    )
    serial: str = Field(default="", description="refuse any other camera")
    backend: BackendName = "auto"
    pixel_format: Literal["Mono8", "Mono10", "Mono12", "Mono14", "Mono16"] = "Mono8"
    width_px: int | None = Field(default=None, ge=1)
    height_px: int | None = Field(default=None, ge=1)
    offset_x_px: int | None = Field(default=None, ge=0)
    offset_y_px: int | None = Field(default=None, ge=0)
    packet_size: int = Field(
        default=1400,
        ge=0,
        le=65535,
        description="bytes; up to the MTU of the whole path; 0 lets the library try",
    )
    packet_resend: bool = True
    buffers: int = Field(default=4, ge=2, le=64)
    readout_s: float = Field(default=0.05, ge=0)
    frame_slack_s: float = Field(
        default=0.5, gt=0, description="beyond exposure, readout and transfer"
    )
    gain_db_per_raw: float | None = Field(default=None, gt=0)
    gain_floor: float = Field(default=0.0, description="dB or raw that is a gain of 1")
    features: dict[str, bool | int | float | str] = Field(
        default={}, description="more features by GenICam name, set and read back"
    )
