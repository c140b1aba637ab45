"""Aravis' own GigE Vision camera, reached through ctypes, with pictures from us."""

from __future__ import annotations

import ctypes
import logging
import socket
import threading
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Any

from drivers.simulators.gige.address import (
    BIRTHPLACE,
    GVCP_PORT,
    AddressLock,
    CameraProblem,
    move_sockets,
    open_sockets,
)
from drivers.simulators.gige.trigger import TriggerWatch, description_file

if TYPE_CHECKING:
    from collections.abc import Callable

_LOG = logging.getLogger(__name__)
_LIBRARY = "libaravis-0.8.so.0"
_GOBJECT = "libgobject-2.0.so.0"
# Aravis looks for triggers this often, and busily through the last millisecond of each
# wait: a picture is up to 20 ms later, and a processor is not kept busy by a fifth.
_TRIGGER_HZ = 50.0
_SENSOR_MAX = 8192
_CURRENT_IP = 0x24
# Registers of Aravis' simulated camera, from its GenICam description.
_WIDTH, _HEIGHT = 0x100, 0x104
_SENSOR_HEIGHT, _SENSOR_WIDTH = 0x118, 0x11C
_OFFSET_X, _OFFSET_Y = 0x130, 0x134
_GAIN_RAW, _EXPOSURE_US, _PIXEL_FORMAT = 0x110, 0x120, 0x128

_Fill = ctypes.CFUNCTYPE(
    None,
    ctypes.c_void_p,
    ctypes.c_void_p,
    ctypes.c_uint32,
    ctypes.c_uint32,
    ctypes.c_uint32,
)


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
    arv.arv_fake_camera_new.argtypes = [ctypes.c_char_p]
    arv.arv_fake_camera_new.restype = pointer
    arv.arv_fake_camera_get_genicam_xml.argtypes = [
        pointer,
        ctypes.POINTER(ctypes.c_size_t),
    ]
    arv.arv_fake_camera_get_genicam_xml.restype = pointer
    arv.arv_fake_camera_get_acquisition_status.argtypes = [pointer]
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


class FakeCamera:
    """One camera on one address; it can die and come back.

    Aravis' camera is born on 127.0.0.1, since it only takes addresses that an interface
    has. On any other loopback address its sockets are exchanged for ours.

    Args:
        host: loopback address.
        size: columns and rows of the sensor.
        paint: fills pictures; called beside the control channel for a software trigger,
            and in the camera's own thread, which then answers nothing, when it runs free.
    """

    def __init__(
        self,
        host: str,
        serial: str,
        size: tuple[int, int],
        paint: Callable[[int, int, int, Region], bytes],
        *,
        wait_s: float,
    ) -> None:
        self.host, self.serial = host, serial
        self._size = size
        self._paint = paint
        self._arv, self._gobject = load_library()
        self._fill = _Fill(self._on_fill)
        self._alive = threading.RLock()  # held while the camera is touched or ended
        self._camera: int | None = None
        self._inner: int | None = None
        self._births = 0
        self._triggers = TriggerWatch(
            self._register,
            self._write,
            self._streams,
            self._painted,
            lambda: self._births,
        )
        self._mute: socket.socket | None = None
        self._lost_per_thousand = 0.0
        self._lock = AddressLock(BIRTHPLACE, wait_s)

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
        self._lock.take()
        try:
            self._be_born()
        finally:
            if self.host != BIRTHPLACE or self._camera is None:
                self._lock.release()
        arv, inner = self._arv, self._inner
        width, height = self._size
        for register, value in (
            (_SENSOR_WIDTH, width),
            (_SENSOR_HEIGHT, height),
            (_WIDTH, width),
            (_HEIGHT, height),
        ):
            self._write(register, value)
        arv.arv_fake_camera_set_trigger_frequency(inner, _TRIGGER_HZ)
        arv.arv_fake_camera_set_fill_pattern(inner, self._fill, None)
        self.lose(self._lost_per_thousand)
        self._births += 1
        self._triggers.start()

    def _be_born(self) -> None:
        """Make the library's camera, and take it to its address."""
        arv, before = self._arv, open_sockets()
        description = description_file(arv, self._gobject)
        try:
            camera = arv.arv_gv_fake_camera_new_full(
                BIRTHPLACE.encode(), self.serial.encode(), bytes(description)
            )
        finally:
            description.unlink()
        if not arv.arv_gv_fake_camera_is_running(camera):
            self._gobject.g_object_unref(camera)
            raise CameraProblem(f"Aravis' camera does not start on {BIRTHPLACE}")
        self._camera = camera
        self._inner = inner = arv.arv_gv_fake_camera_get_fake_camera(camera)
        if self.host != BIRTHPLACE:
            try:
                move_sockets(open_sockets() - before, self.host)
            except OSError as error:
                self.kill()
                raise CameraProblem(
                    f"another camera answers on {self.host}: {error}"
                ) from error
            arv.arv_fake_camera_write_register(
                inner, _CURRENT_IP, int(IPv4Address(self.host))
            )

    def kill(self) -> None:
        """Vanish: nobody listens on the port any more. Safe to repeat."""
        if self._mute is not None:
            self._mute.close()
            self._mute = None
        with self._alive:
            camera, self._camera, self._inner = self._camera, None, None
        if camera is not None:
            self._gobject.g_object_unref(camera)
        self._lock.release()

    def silence(self) -> None:
        """Listen and never answer, as after a crash of the camera's firmware."""
        self.kill()
        self._mute = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._mute.bind((self.host, GVCP_PORT))

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

    def end(self) -> None:
        """Vanish for good."""
        self._triggers.end()
        self.kill()

    def _register(self, address: int) -> int:
        """What a register holds; 0 while there is no camera."""
        value = ctypes.c_uint32()
        with self._alive:
            if self._inner is not None:
                self._arv.arv_fake_camera_read_register(
                    self._inner, address, ctypes.byref(value)
                )
        return int(value.value)

    def _write(self, address: int, value: int) -> None:
        with self._alive:
            if self._inner is not None:
                self._arv.arv_fake_camera_write_register(self._inner, address, value)

    def _streams(self) -> bool:
        """Whether a client has started the acquisition."""
        with self._alive:
            return self._inner is not None and bool(
                self._arv.arv_fake_camera_get_acquisition_status(self._inner)
            )

    def _painted(self) -> bytes:
        """A picture with the settings of now; an error gives an empty one."""
        region = Region(
            self._register(_WIDTH),
            self._register(_HEIGHT),
            self._register(_OFFSET_X),
            self._register(_OFFSET_Y),
        )
        exposure_us, gain = self._register(_EXPOSURE_US), self._register(_GAIN_RAW)
        try:
            return self._paint(exposure_us, gain, self._register(_PIXEL_FORMAT), region)
        except Exception:
            _LOG.exception("no picture for the simulated camera")
            return b""

    def _on_fill(
        self, buffer: int, _data: int | None, _exposure: int, _gain: int, _code: int
    ) -> None:
        """Fill a picture, in Aravis' thread; an error must not reach the library."""
        # The buffer counts what was received, which is nothing yet.
        place = self._arv.arv_buffer_get_data(buffer, None)
        with self._alive:
            if self._inner is None:
                return
            room = int(self._arv.arv_fake_camera_get_payload(self._inner))
        pixels = self._triggers.take()
        if pixels is None:
            pixels = self._painted()
        ctypes.memmove(place, pixels, min(len(pixels), room))
