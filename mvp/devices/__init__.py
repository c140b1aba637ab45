"""Device protocols, clocks and the registry of drivers."""

from mvp.devices.cameras import CameraFound
from mvp.devices.command_slot import Accept, Ask, Take
from mvp.devices.context import (
    Clock,
    DeviceContext,
    RealClock,
    ScaledClock,
    require_real_time,
)
from mvp.devices.doubts import HasDoubts, cannot_stop
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
    Approaching,
    Arm,
    ArmState,
    Axis,
    Camera,
    DeclaresAxes,
    Device,
    DeviceInfo,
    DrivesStraight,
    Exclusive,
    Frame,
    Homable,
    Homing,
    Lens,
    LensState,
    Recoverable,
    RecoveryStep,
    Role,
    Side,
    Thermometer,
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
from mvp.devices.resources import host_resource, link_resource
from mvp.devices.serial_line import SerialTransport, TcpTransport
from mvp.devices.session import Session
from mvp.devices.simulator import Simulator, SimulatorClass
from mvp.devices.transport import Transport, TransportConfig, recorded_link
from mvp.devices.world import (
    DrawsAhead,
    LampBelief,
    LightBelief,
    WorldBelief,
    WorldClass,
)

__all__ = [
    "AXES",
    "Accept",
    "Approaching",
    "Arm",
    "ArmState",
    "Ask",
    "Axis",
    "Camera",
    "CameraFound",
    "Clock",
    "DeclaresAxes",
    "DelimiterFramer",
    "Device",
    "DeviceContext",
    "DeviceInfo",
    "DrawsAhead",
    "DriverClass",
    "DriverEntry",
    "DrivesStraight",
    "EchoStripper",
    "Exclusive",
    "Finding",
    "Frame",
    "Framer",
    "HasDoubts",
    "Homable",
    "Homing",
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
    "Side",
    "Simulator",
    "SimulatorClass",
    "Take",
    "TcpTransport",
    "Thermometer",
    "Traffic",
    "Transport",
    "TransportConfig",
    "WorldBelief",
    "WorldClass",
    "camera_search",
    "cannot_stop",
    "dumping_faults",
    "host_findings",
    "host_resource",
    "libraries_of",
    "link_resource",
    "list_drivers",
    "list_ports",
    "load_driver",
    "load_simulator",
    "load_world",
    "port_findings",
    "recorded_link",
    "require_real_time",
    "text",
    "usb_ids_of",
]
