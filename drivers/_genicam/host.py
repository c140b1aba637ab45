"""What GenICam cameras need of this computer: a library, socket buffers, packet size."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

from drivers._genicam.choose import BACKENDS, backend_for, installed_backends
from drivers._genicam.kernel import rmem_max
from drivers._genicam.probe import is_ip_address
from mvp.devices import CameraFound, Finding

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers._genicam.choose import BackendName

_IP_MTU = 14  # of <linux/in.h>; the socket module does not name it
_PORT = 3956
_WANTED_BYTES = 16 << 20


def library_finding(name: BackendName) -> Finding:
    """Which library will be used, and why not the other ones.

    Raises:
        PluginError: none can be.
    """
    used = backend_for(name)
    others = [f"{k}: {why}" for k, why in installed_backends().items() if why]
    detail = f"{used.name} {used.version}"
    return Finding("library", "ok", "; ".join([detail, *others]))


def buffer_finding(frame_bytes: int | None) -> Finding:
    """Whether the kernel lets two pictures wait in a socket.

    Args:
        frame_bytes: size of one picture; None when the camera decides.
    """
    limit = rmem_max()
    need = _WANTED_BYTES if frame_bytes is None else 2 * frame_bytes
    what = "a GigE stream" if frame_bytes is None else "two pictures"
    if limit is None:
        return Finding("buffer", "ok", "the kernel does not say its net.core.rmem_max")
    said = f"net.core.rmem_max is {limit} bytes; {what} may want {need}"
    if limit >= need:
        return Finding("buffer", "ok", said)
    return Finding(
        "buffer",
        "warning",
        f"{said}: pictures may arrive with holes",
        f"`sudo sysctl -w net.core.rmem_max={_WANTED_BYTES}`, and the same in "
        "/etc/sysctl.d to keep it",
    )


def packet_findings(address: str, packet_size: int) -> Iterator[Finding]:
    """Whether packets fit through the interface that leads to the camera."""
    if not is_ip_address(address):
        return
    mtu = mtu_towards(address)
    if mtu is None:
        yield Finding(
            "packets",
            "warning",
            f"no route leads to {address}",
            "give an interface of this computer an address in the camera's network",
        )
    elif packet_size > mtu:
        yield Finding(
            "packets",
            "warning",
            f"packet_size {packet_size} does not fit the MTU of {mtu} towards {address}",
            f"raise the MTU of interface and switch, or set packet_size = {mtu}",
        )
    else:
        size = packet_size or "negotiated"
        yield Finding("packets", "ok", f"packet_size {size}, MTU {mtu}")


def mtu_towards(address: str) -> int | None:
    """MTU of the first hop; connecting a datagram socket sends nothing."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, _PORT))
            return probe.getsockopt(socket.IPPROTO_IP, _IP_MTU)
        except OSError:
            return None


def found_cameras(driver: str) -> tuple[CameraFound, ...]:
    """Cameras that answer, through every library that is installed; about 1-2 s.

    Args:
        driver: key of the driver that reaches them.
    """
    found: dict[tuple[str, str], CameraFound] = {}
    usable = [key for key, problem in installed_backends().items() if not problem]
    for name in (key for key in BACKENDS if key in usable):
        backend = backend_for("aravis" if name == "aravis" else "telegenicam")
        for one in backend.discover():
            who = one.identity
            found.setdefault(
                (who.serial, one.address),
                CameraFound(
                    driver,
                    one.address,
                    f"{who.vendor} {who.model}".strip(),
                    who.serial,
                    f"{one.transport} through {name}",
                ),
            )
    return tuple(sorted(found.values(), key=lambda camera: camera.address))
