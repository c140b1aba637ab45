"""Device protocols, clocks and the registry of drivers."""

from mvp.devices.cameras import CameraFound
from mvp.devices.command_slot import Accept, Ask, Take
from mvp.devices.context import Clock, DeviceContext, RealClock, ScaledClock
from mvp.devices.findings import (
    Finding,
    camera_search,
    host_findings,
    libraries_of,
    usb_ids_of,
)
from mvp.devices.framing import (
    DelimiterFramer,
    EchoStripper,
    Framer,
    LengthFramer,
    LineFramer,
    text,
)
from mvp.devices.link import Link
from mvp.devices.port_findings import port_findings
from mvp.devices.ports import PortFound, list_ports
from mvp.devices.protocols import (
    AXES,
    Arm,
    ArmState,
    Axis,
    Camera,
    Device,
    DeviceInfo,
    Frame,
    Homable,
    Lens,
    LensState,
    Recoverable,
    RecoveryStep,
    Role,
)
from mvp.devices.recording import (
    RecordingTransport,
    ReplayTransport,
    Traffic,
    dumping_faults,
)
from mvp.devices.registry import (
    DriverClass,
    DriverEntry,
    list_drivers,
    load_driver,
    load_simulator,
    load_world,
)
from mvp.devices.serial_line import SerialTransport, TcpTransport
from mvp.devices.session import Session
from mvp.devices.simulator import Simulator, SimulatorClass
from mvp.devices.transport import Transport, TransportConfig, recorded_link
from mvp.devices.world import LampBelief, LightBelief, WorldBelief, WorldClass

__all__ = [
    "AXES",
    "Accept",
    "Arm",
    "ArmState",
    "Ask",
    "Axis",
    "Camera",
    "CameraFound",
    "Clock",
    "DelimiterFramer",
    "Device",
    "DeviceContext",
    "DeviceInfo",
    "DriverClass",
    "DriverEntry",
    "EchoStripper",
    "Finding",
    "Frame",
    "Framer",
    "Homable",
    "LampBelief",
    "LengthFramer",
    "Lens",
    "LensState",
    "LightBelief",
    "LineFramer",
    "Link",
    "PortFound",
    "RealClock",
    "RecordingTransport",
    "Recoverable",
    "RecoveryStep",
    "ReplayTransport",
    "Role",
    "ScaledClock",
    "SerialTransport",
    "Session",
    "Simulator",
    "SimulatorClass",
    "Take",
    "TcpTransport",
    "Traffic",
    "Transport",
    "TransportConfig",
    "WorldBelief",
    "WorldClass",
    "camera_search",
    "dumping_faults",
    "host_findings",
    "libraries_of",
    "list_drivers",
    "list_ports",
    "load_driver",
    "load_simulator",
    "load_world",
    "port_findings",
    "recorded_link",
    "text",
    "usb_ids_of",
]
