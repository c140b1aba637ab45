"""GenICam behind one small protocol, spoken by two libraries."""

from drivers._genicam.backend import (
    Backend,
    BackendLost,
    BackendRefused,
    Delivery,
    FoundBy,
    Health,
    Identity,
    StreamSettings,
    Value,
)
from drivers._genicam.choose import (
    BACKENDS,
    BackendName,
    backend_for,
    installed_backends,
)
from drivers._genicam.host import (
    buffer_finding,
    found_cameras,
    library_finding,
    packet_findings,
)
from drivers._genicam.session import Session, SessionSettings

__all__ = [
    "BACKENDS",
    "Backend",
    "BackendLost",
    "BackendName",
    "BackendRefused",
    "Delivery",
    "FoundBy",
    "Health",
    "Identity",
    "Session",
    "SessionSettings",
    "StreamSettings",
    "Value",
    "backend_for",
    "buffer_finding",
    "found_cameras",
    "installed_backends",
    "library_finding",
    "packet_findings",
]
