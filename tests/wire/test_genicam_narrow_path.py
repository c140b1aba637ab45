"""Pictures in packets that the path does not carry: what is said about it.

The path is made narrow where it ends: a packet filter on the receiving socket lets
leader and trailer of a picture through and drops every packet with pixels.
"""

from __future__ import annotations

import ctypes
import os
import socket
import struct
import time
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

from drivers._genicam import Backend, BackendName, StreamSettings, backend_for
from drivers.camera_genicam import GenicamCamera
from mvp.devices import DeviceContext
from mvp.errors import DeviceFault
from mvp.testing import refuses

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.conftest import GvCamera

_ATTACH_FILTER = 26  # SO_ATTACH_FILTER; the socket module does not name it
_UDP_HEADER = 8
_LOAD_LENGTH, _JUMP_IF_GREATER, _RETURN = 0x80, 0x25, 0x06
_EVERYTHING = 0xFFFF_FFFF


def udp_sockets() -> set[int]:
    """Descriptors of this process that are datagram sockets."""
    found = set()
    for handle in map(int, os.listdir("/proc/self/fd")):
        with suppress(OSError):
            target = os.readlink(f"/proc/self/fd/{handle}")
            if target.startswith("socket:") and is_udp(handle):
                found.add(handle)
    return found


def is_udp(handle: int) -> bool:
    with socket.socket(fileno=os.dup(handle)) as line:
        return line.family == socket.AF_INET and line.type == socket.SOCK_DGRAM


def make_narrow(handle: int, most_bytes: int) -> None:
    """Let only datagrams of at most so many bytes through."""
    steps = [
        (_LOAD_LENGTH, 0, 0, 0),
        (_JUMP_IF_GREATER, 0, 1, most_bytes + _UDP_HEADER),
        (_RETURN, 0, 0, 0),
        (_RETURN, 0, 0, _EVERYTHING),
    ]
    code = ctypes.create_string_buffer(
        b"".join(struct.pack("HBBI", *step) for step in steps)
    )
    program = struct.pack("@HP", len(steps), ctypes.addressof(code))
    with socket.socket(fileno=os.dup(handle)) as line:
        line.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, program)


def narrowed(name: BackendName, most_bytes: int) -> Backend:
    """A library whose every stream comes along a narrow path."""
    backend = backend_for(name)
    arm = backend.arm

    def arm_narrow(settings: StreamSettings) -> None:
        before = udp_sockets()
        arm(settings)
        for handle in udp_sockets() - before:
            make_narrow(handle, most_bytes)

    backend.arm = arm_narrow  # type: ignore[method-assign]
    return backend


@pytest.fixture
def camera(gv_camera: GvCamera, genicam_backend: str) -> Callable[[int], GenicamCamera]:
    def build(packet_size: int) -> GenicamCamera:
        config = GenicamCamera.Config.model_validate(
            {
                "address": gv_camera.host,
                "backend": genicam_backend,
                "packet_size": packet_size,
                "width_px": 320,
                "height_px": 240,
            }
        )
        return GenicamCamera(
            config,
            DeviceContext(),
            "camera",
            new_backend=lambda name: narrowed(name, 1500),
        )

    return build


def test_packets_that_do_not_fit_are_named_as_the_likely_cause(
    camera: Callable[[int], GenicamCamera], genicam_backend: str
) -> None:
    with camera(8000) as wide:
        wide.configure(exposure_s=0.01)
        error = refuses(
            DeviceFault,
            lambda: wide.capture(not_before_s=time.monotonic(), timeout_s=30),
        )
    assert "of 8000 bytes" in error.message
    assert "fit through the network" in error.message
    assert "packet_size = 1400" in error.hint
    assert "MTU" in error.hint
    if genicam_backend == "aravis":  # which counts what arrives of lost pictures, too
        assert error.code == "packet-size"
        assert "none with pixels" in error.message


def test_packets_that_fit_come_through_the_same_path(
    camera: Callable[[int], GenicamCamera],
) -> None:
    with camera(1400) as narrow:
        narrow.configure(exposure_s=0.01)
        frame = narrow.capture(not_before_s=time.monotonic(), timeout_s=30)
    assert frame.pixels.shape == (240, 320)
