"""Device protocols, clocks and the registry of drivers."""

from mvp.devices.context import Clock, DeviceContext, RealClock, ScaledClock
from mvp.devices.protocols import (
    AXES,
    Arm,
    ArmState,
    Axis,
    Camera,
    Device,
    DeviceInfo,
    Frame,
    Lens,
    LensState,
    Role,
)

__all__ = [
    "AXES",
    "Arm",
    "ArmState",
    "Axis",
    "Camera",
    "Clock",
    "Device",
    "DeviceContext",
    "DeviceInfo",
    "Frame",
    "Lens",
    "LensState",
    "RealClock",
    "Role",
    "ScaledClock",
]
