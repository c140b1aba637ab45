"""Aravis' own GigE Vision camera, reached through ctypes, with pictures from us."""

from __future__ import annotations

import ctypes
import fcntl
import logging
import socket
import time
from pathlib import Path
from tempfile import gettempdir
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from io import BufferedWriter

_LOG = logging.getLogger(__name__)
_LIBRARY = "libaravis-0.8.so.0"
_GOBJECT = "libgobject-2.0.so.0"
_GVCP_PORT = 3956
_POLL_S = 0.1
_TRIGGER_HZ = 200.0
_SENSOR_MAX = 8192
# Registers of Aravis' simulated camera, from its GenICam description.
_WIDTH, _HEIGHT = 0x100, 0x104
_SENSOR_HEIGHT, _SENSOR_WIDTH = 0x118, 0x11C
_OFFSET_X, _OFFSET_Y = 0x130, 0x134

_Fill = ctypes.CFUNCTYPE(
    None,
    ctypes.c_void_p,
    ctypes.c_void_p,
    ctypes.c_uint32,
    ctypes.c_uint32,
    ctypes.c_uint32,
)


class CameraProblem(Exception):
    """The simulated camera cannot run; the text says why."""


class Region:
    """What part of the sensor a picture shows, px."""

    def __init__(self, width: int, height: int, x: int, y: int) -> None:
        self.width, self.height, self.x, self.y = width, height, x, y


def load_library() -> tuple[Any, Any]:
    """Aravis and GObject.

    Raises:
        CameraProblem: not installed.
    """
    try:
        arv, gobject = ctypes.CDLL(_LIBRARY), ctypes.CDLL(_GOBJECT)
    except OSError as error:
        raise CameraProblem(
            f"{error}; Debian has it in the package libaravis-0.8-0"
        ) from error
    pointer, word = ctypes.c_void_p, ctypes.c_uint32
    arv.arv_gv_fake_camera_new_full.restype = pointer
    arv.arv_gv_fake_camera_new_full.argtypes = [ctypes.c_char_p] * 3
    arv.arv_gv_fake_camera_is_running.argtypes = [pointer]
    arv.arv_gv_fake_camera_get_fake_camera.argtypes = [pointer]
    arv.arv_gv_fake_camera_get_fake_camera.restype = pointer
    arv.arv_fake_camera_set_fill_pattern.argtypes = [pointer, _Fill, pointer]
    arv.arv_fake_camera_write_register.argtypes = [pointer, word, word]
    arv.arv_fake_camera_read_register.argtypes = [
        pointer,
        word,
        ctypes.POINTER(ctypes.c_uint32),
    ]
    arv.arv_fake_camera_set_trigger_frequency.argtypes = [pointer, ctypes.c_double]
    arv.arv_fake_camera_get_payload.argtypes = [pointer]
    arv.arv_fake_camera_get_payload.restype = ctypes.c_size_t
    arv.arv_buffer_get_data.argtypes = [pointer, ctypes.POINTER(ctypes.c_size_t)]
    arv.arv_buffer_get_data.restype = pointer
    gobject.g_object_unref.argtypes = [pointer]
    return arv, gobject


class AddressLock:
    """One simulated camera per address: two would both answer, without an error.

    Args:
        host: IPv4 address of an interface.
        wait_s: how long another one may take to end.
    """

    def __init__(self, host: str, wait_s: float) -> None:
        self._host = host
        self._until_s = time.monotonic() + wait_s
        self._path = Path(gettempdir()) / f"mvp-cell-gige-{host}.lock"
        self._file: BufferedWriter | None = None

    def take(self) -> None:
        """Wait for the address.

        Raises:
            CameraProblem: it is still in use.
        """
        self._file = self._path.open("ab")
        while not (self._locked() and self._free()):
            if time.monotonic() > self._until_s:
                self.release()
                raise CameraProblem(f"another camera answers on {self._host}")
            time.sleep(_POLL_S)

    def release(self) -> None:
        """Let others have it; safe to repeat."""
        if self._file is not None:
            self._file.close()
        self._file = None

    def _locked(self) -> bool:
        if self._file is None:
            return False
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _free(self) -> bool:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind((self._host, _GVCP_PORT))
            except OSError:
                return False
        return True


class FakeCamera:
    """One camera on one address; it can die and come back.

    Args:
        host: IPv4 address of an interface.
        size: columns and rows of the sensor.
        paint: fills pictures; called in the camera's own thread, which answers no
            control packet meanwhile.
    """

    def __init__(
        self,
        host: str,
        serial: str,
        size: tuple[int, int],
        paint: Callable[[int, int, int, Region], bytes],
    ) -> None:
        self.host, self.serial = host, serial
        self._size = size
        self._paint = paint
        self._arv, self._gobject = load_library()
        self._fill = _Fill(self._on_fill)
        self._camera: int | None = None
        self._inner: int | None = None
        self._mute: socket.socket | None = None
        self._lost_per_thousand = 0.0

    @property
    def running(self) -> bool:
        """Whether there is a camera that answers."""
        return self._camera is not None

    def start(self) -> None:
        """Appear on the network.

        Raises:
            CameraProblem: no such interface, or a sensor larger than 8192 px.
        """
        self.kill()
        if max(self._size) > _SENSOR_MAX:
            raise CameraProblem(f"a sensor of {self._size} px is too large")
        arv = self._arv
        camera = arv.arv_gv_fake_camera_new_full(
            self.host.encode(), self.serial.encode(), None
        )
        if not arv.arv_gv_fake_camera_is_running(camera):
            self._gobject.g_object_unref(camera)
            raise CameraProblem(
                f"the camera does not start on {self.host}: no interface of this "
                "machine has that address (127.0.0.1 always works)"
            )
        self._camera = camera
        self._inner = inner = arv.arv_gv_fake_camera_get_fake_camera(camera)
        width, height = self._size
        for register, value in (
            (_SENSOR_WIDTH, width),
            (_SENSOR_HEIGHT, height),
            (_WIDTH, width),
            (_HEIGHT, height),
        ):
            arv.arv_fake_camera_write_register(inner, register, value)
        arv.arv_fake_camera_set_trigger_frequency(inner, _TRIGGER_HZ)
        arv.arv_fake_camera_set_fill_pattern(inner, self._fill, None)
        self.lose(self._lost_per_thousand)

    def kill(self) -> None:
        """Vanish: nobody listens on the port any more. Safe to repeat."""
        if self._mute is not None:
            self._mute.close()
            self._mute = None
        camera, self._camera, self._inner = self._camera, None, None
        if camera is not None:
            self._gobject.g_object_unref(camera)

    def silence(self) -> None:
        """Listen and never answer, as after a crash of the camera's firmware."""
        self.kill()
        self._mute = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._mute.bind((self.host, _GVCP_PORT))

    def lose(self, per_thousand: float) -> None:
        """Drop stream packets at random from now on.

        Raises:
            ValueError: not between 0 and 1000.
        """
        if not 0 <= per_thousand <= 1000:
            raise ValueError("packets are lost per thousand: 0 to 1000")
        self._lost_per_thousand = per_thousand
        if self._camera is not None:
            self._gobject.g_object_set(
                ctypes.c_void_p(self._camera),
                b"gvsp-lost-ratio",
                ctypes.c_double(per_thousand / 1000),
                None,
            )

    def _register(self, address: int) -> int:
        value = ctypes.c_uint32()
        self._arv.arv_fake_camera_read_register(
            self._inner, address, ctypes.byref(value)
        )
        return int(value.value)

    def _on_fill(
        self, buffer: int, _data: int | None, exposure_us: int, gain: int, code: int
    ) -> None:
        """Fill a picture; an error must not reach the library."""
        # The buffer counts what was received, which is nothing yet.
        place = self._arv.arv_buffer_get_data(buffer, None)
        room = int(self._arv.arv_fake_camera_get_payload(self._inner))
        region = Region(
            self._register(_WIDTH),
            self._register(_HEIGHT),
            self._register(_OFFSET_X),
            self._register(_OFFSET_Y),
        )
        try:
            pixels = self._paint(exposure_us, gain, code, region)
        except Exception:
            _LOG.exception("no picture for the simulated camera")
            pixels = b""
        ctypes.memmove(place, pixels, min(len(pixels), room))
