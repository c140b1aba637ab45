"""Device protocols, clocks and the registry of drivers."""

from mvp.devices.context import Clock, DeviceContext, RealClock, ScaledClock
from mvp.devices.link import Link
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
from mvp.devices.registry import (
    DriverClass,
    DriverEntry,
    list_drivers,
    load_driver,
    load_world,
)
from mvp.devices.world import LampBelief, LightBelief, WorldBelief, WorldClass

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
    "DriverClass",
    "DriverEntry",
    "Frame",
    "LampBelief",
    "Lens",
    "LensState",
    "LightBelief",
    "Link",
    "RealClock",
    "Role",
    "ScaledClock",
    "WorldBelief",
    "WorldClass",
    "list_drivers",
    "load_driver",
    "load_world",
]
