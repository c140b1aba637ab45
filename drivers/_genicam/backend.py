"""What a GenICam library must be able to do, whichever one it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, Protocol, TypeAlias

Value: TypeAlias = bool | int | float | str
Kind: TypeAlias = Literal["boolean", "integer", "float", "enum"]


class BackendLost(Exception):
    """The camera stopped answering, or another program took the control from us."""


class BackendRefused(Exception):
    """The camera or the library said no; the text says why."""


@dataclass(frozen=True)
class Identity:
    """Who answered."""

    vendor: str
    model: str
    serial: str
    version: str
    user_name: str = ""


@dataclass(frozen=True)
class FoundBy:
    """One camera that a library discovered, with the address that reaches it."""

    identity: Identity
    address: str
    transport: str


@dataclass(frozen=True)
class StreamSettings:
    """How pictures travel.

    Attributes:
        packet_size: bytes of one packet with its headers; 0 leaves it to the library.
        buffer_bytes: asked of the kernel for the receiving socket.
        buffers: pictures that may wait.
        resend: ask again for lost packets.
    """

    packet_size: int
    buffer_bytes: int
    buffers: int
    resend: bool


@dataclass(frozen=True)
class Delivery:
    """One picture as the library hands it out.

    Attributes:
        complete: every packet arrived; otherwise the pixels are worthless.
        status: the library's word for how it ended.
        pixel_code: the 32 bits that name the pixel format.
        data: pixels, row by row.
        timestamp_ns: the camera's own clock.
    """

    complete: bool
    status: str
    frame_id: int
    width: int
    height: int
    pixel_code: int
    data: bytes
    timestamp_ns: int


@dataclass(frozen=True)
class Health:
    """Whether the camera is still there, and what the library counted.

    Attributes:
        counts: since the stream began, in the library's own words.
        arrived_bytes: of pictures, whole or not, since the stream began; None where the
            library does not count them.
    """

    connected: bool
    counts: dict[str, int] = field(default_factory=dict)
    arrived_bytes: int | None = None


class Backend(Protocol):
    """One library. Every method may raise ``BackendLost`` or ``BackendRefused``."""

    name: str

    @property
    def version(self) -> str:
        """Of the library, as far as it tells."""
        ...

    def discover(self) -> tuple[FoundBy, ...]:
        """Cameras that answer within about a second."""
        ...

    def open(self, address: str) -> Identity:
        """Take control of a camera.

        Args:
            address: IP address, serial number or user-defined name.
        """
        ...

    def has(self, feature: str) -> bool:
        """Whether the camera has a feature of this name."""
        ...

    def get(self, feature: str, kind: Kind) -> Value:
        """Read from the camera, past any cache."""
        ...

    def set(self, feature: str, value: Value) -> None:
        """Write; the type of the value says what kind of feature it is."""
        ...

    def bounds(self, feature: str, kind: Kind) -> tuple[float, float]:
        """Lowest and highest value of a number."""
        ...

    def choices(self, feature: str) -> tuple[str, ...]:
        """Entries of an enumeration."""
        ...

    def arm(self, settings: StreamSettings) -> None:
        """Begin the one long acquisition; the camera then waits for triggers."""
        ...

    def trigger(self) -> None:
        """Execute TriggerSoftware."""
        ...

    def drain(self) -> int:
        """Throw waiting pictures away; how many there were."""
        ...

    def wait(self, timeout_s: float) -> Delivery | None:
        """The next picture, or None when none came in time."""
        ...

    def disarm(self) -> None:
        """End the acquisition; safe to repeat, and after a loss."""
        ...

    def health(self) -> Health:
        """Connection and counters; never blocks."""
        ...

    def close(self) -> None:
        """Give the camera back; safe to repeat, and after a loss."""
        ...
