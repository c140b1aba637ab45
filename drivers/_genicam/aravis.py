"""GigE Vision and USB3 Vision through Aravis and GObject introspection."""

from __future__ import annotations

from contextlib import contextmanager, suppress
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from drivers._genicam.backend import (
    BackendLost,
    BackendRefused,
    Delivery,
    FoundBy,
    Health,
    Identity,
)
from drivers._genicam.probe import is_ip_address

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers._genicam.backend import Kind, StreamSettings, Value

_API = "0.8"
_NEGOTIATE = 0
_USABLE = {"SUCCESS"}
# A frame with a hole is given up after this long, so that a retry comes soon.
_RETENTION_US = 400_000


def aravis_problem() -> str:
    """What is missing for Aravis; empty when nothing is."""
    if find_spec("gi") is None:
        return "the package PyGObject is missing"
    try:
        _library()
    except (ImportError, ValueError) as error:
        return f"Aravis cannot be used: {error}"
    return ""


def _library() -> Any:
    """The introspected library.

    Raises:
        ImportError, ValueError: PyGObject or the typelib is missing.
    """
    import_module("gi").require_version("Aravis", _API)
    return import_module("gi.repository.Aravis")


class AravisBackend:
    """``Backend`` over Aravis."""

    name = "aravis"

    def __init__(self) -> None:
        self._arv: Any = None
        self._camera: Any = None
        self._stream: Any = None
        self._lost = False

    @property
    def version(self) -> str:
        """Of the library's interface; 0.8.26 does not tell its own to bindings."""
        return _API

    def discover(self) -> tuple[FoundBy, ...]:
        """Cameras on every interface, loopback and USB included; takes 1 s."""
        arv = _library()
        arv.update_device_list()
        return tuple(_found(arv, index) for index in range(arv.get_n_devices()))

    def open(self, address: str) -> Identity:
        """Take control of a camera by IP address, serial number or name."""
        self._arv = arv = _library()
        self._lost = False
        with self._translated():
            self._camera = arv.Camera.new(self._address_of(address))
            self._camera.set_range_check_policy(arv.RangeCheckPolicy.ENABLE)
            device = self._camera.get_device()
            device.connect("control-lost", self._on_lost)
            if self._camera.is_gv_device():
                # Root would get a packet socket that nobody else has.
                self._camera.gv_set_stream_options(
                    arv.GvStreamOption.PACKET_SOCKET_DISABLED
                )
            return Identity(
                self._camera.get_vendor_name(),
                self._camera.get_model_name(),
                self._camera.get_device_serial_number() or "",
                self._text("DeviceFirmwareVersion") or self._text("DeviceVersion"),
                self._text("DeviceUserID"),
            )

    def has(self, feature: str) -> bool:
        """Whether the camera has a feature of this name."""
        with self._translated():
            return bool(self._open_camera.is_feature_available(feature))

    def get(self, feature: str, kind: Kind) -> Value:
        """Read from the camera; Aravis caches no register unless told to."""
        camera = self._open_camera
        with self._translated():
            if kind == "boolean":
                return bool(camera.get_boolean(feature))
            if kind == "integer":
                return int(camera.get_integer(feature))
            if kind == "float":
                return float(camera.get_float(feature))
            return str(camera.get_string(feature))

    def set(self, feature: str, value: Value) -> None:
        """Write by the type of the value."""
        camera = self._open_camera
        with self._translated():
            if isinstance(value, bool):
                camera.set_boolean(feature, value)
            elif isinstance(value, int):
                camera.set_integer(feature, value)
            elif isinstance(value, float):
                camera.set_float(feature, value)
            else:
                camera.set_string(feature, value)

    def bounds(self, feature: str, kind: Kind) -> tuple[float, float]:
        """Lowest and highest value of a number."""
        with self._translated():
            if kind == "integer":
                low, high = self._open_camera.get_integer_bounds(feature)
            else:
                low, high = self._open_camera.get_float_bounds(feature)
            return float(low), float(high)

    def choices(self, feature: str) -> tuple[str, ...]:
        """Entries of an enumeration."""
        with self._translated():
            return tuple(
                self._open_camera.dup_available_enumerations_as_strings(feature)
            )

    def arm(self, settings: StreamSettings) -> None:
        """Begin the one long acquisition."""
        camera = self._open_camera
        with self._translated():
            if camera.is_gv_device():
                self._set_packet_size(settings.packet_size)
            self._stream = stream = camera.create_stream(None, None)
            if camera.is_gv_device():
                self._tune(settings)
            payload = camera.get_payload()
            for _ in range(settings.buffers):
                stream.push_buffer(self._arv.Buffer.new_allocate(payload))
            camera.start_acquisition()

    def trigger(self) -> None:
        """Execute TriggerSoftware."""
        with self._translated():
            self._open_camera.execute_command("TriggerSoftware")

    def drain(self) -> int:
        """Throw waiting pictures away; how many there were."""
        stream, count = self._running, 0
        while (buffer := stream.try_pop_buffer()) is not None:
            stream.push_buffer(buffer)
            count += 1
        return count

    def wait(self, timeout_s: float) -> Delivery | None:
        """The next picture, or None when none came in time."""
        stream = self._running
        buffer = stream.timeout_pop_buffer(max(0, round(timeout_s * 1e6)))
        if buffer is None:
            if self._lost:
                raise BackendLost("control lost")
            return None
        try:
            return _delivery(buffer)
        finally:
            # A buffer that is not given back is gone: the stream would dry up.
            stream.push_buffer(buffer)

    def disarm(self) -> None:
        """End the acquisition; quiet when the camera is gone."""
        if self._stream is None:
            return
        self._stream = None
        if not self._lost:
            with suppress(BackendLost, BackendRefused), self._translated():
                self._camera.stop_acquisition()

    def health(self) -> Health:
        """Connection and counters."""
        if self._camera is None or self._lost:
            return Health(connected=False)
        if self._stream is None:
            return Health(connected=True)
        stream = self._stream
        names = [stream.get_info_name(index) for index in range(stream.get_n_infos())]
        counts = {
            str(name): int(stream.get_info_uint64_by_name(name))
            for name in names
            if stream.get_info_type(names.index(name)).name == "guint64"
        }
        return Health(True, counts, counts.get("n_transferred_bytes"))

    def close(self) -> None:
        """Give the camera back."""
        self.disarm()
        self._camera = None

    def _on_lost(self, _device: object) -> None:
        self._lost = True

    def _address_of(self, address: str) -> str:
        """Aravis' own name of the camera with this address, serial number or name."""
        if is_ip_address(address):
            return address
        arv = self._arv
        arv.update_device_list()
        found = [
            arv.get_device_id(index)
            for index in range(arv.get_n_devices())
            if address == arv.get_device_serial_nbr(index)
        ]
        if len(found) > 1:
            raise BackendLost(f"{len(found)} cameras have the serial number {address}")
        return str(found[0]) if found else address

    def _text(self, feature: str) -> str:
        """A text feature that not every camera has."""
        try:
            if self._camera.is_feature_available(feature):
                return str(self._camera.get_string(feature))
        except self._error_type():
            return ""
        return ""

    def _set_packet_size(self, packet_size: int) -> None:
        if packet_size == _NEGOTIATE:
            self._camera.gv_auto_packet_size()
        else:
            self._camera.gv_set_packet_size_adjustment(
                self._arv.GvPacketSizeAdjustment.NEVER
            )
            self._camera.gv_set_packet_size(packet_size)

    def _tune(self, settings: StreamSettings) -> None:
        """Fixed receive buffer: the automatic one loses most frames of a plain user."""
        arv, stream = self._arv, self._stream
        resend = arv.GvStreamPacketResend
        stream.set_property("socket-buffer", arv.GvStreamSocketBuffer.FIXED)
        stream.set_property("socket-buffer-size", settings.buffer_bytes)
        stream.set_property(
            "packet-resend", resend.ALWAYS if settings.resend else resend.NEVER
        )
        stream.set_property("frame-retention", _RETENTION_US)

    @property
    def _open_camera(self) -> Any:
        if self._camera is None or self._lost:
            raise BackendLost("control lost" if self._lost else "not open")
        return self._camera

    @property
    def _running(self) -> Any:
        if self._stream is None:
            raise BackendLost("no acquisition is running")
        return self._stream

    @staticmethod
    def _error_type() -> type[Exception]:
        error: type[Exception] = import_module("gi.repository.GLib").Error
        return error

    @contextmanager
    def _translated(self) -> Iterator[None]:
        """The library's errors as ours."""
        try:
            yield
        except self._error_type() as error:
            message = str(getattr(error, "message", error))
            if self._lost or self._is_silence(error):
                # Spare the time-outs of saying goodbye to nobody.
                self._lost = True
                raise BackendLost(message) from error
            raise BackendRefused(message) from error

    def _is_silence(self, error: Any) -> bool:
        """Whether nobody answered, as opposed to somebody saying no."""
        codes = self._arv.DeviceError
        quark = self._arv.device_error_quark()
        silent = (
            codes.TIMEOUT,
            codes.NOT_CONNECTED,
            codes.NOT_FOUND,
            codes.NOT_CONTROLLER,
        )
        return any(bool(error.matches(quark, code)) for code in silent)


def _found(arv: Any, index: int) -> FoundBy:
    """One line of the device list."""
    identity = Identity(
        arv.get_device_vendor(index) or "",
        arv.get_device_model(index) or "",
        arv.get_device_serial_nbr(index) or "",
        "",
    )
    protocol = arv.get_device_protocol(index) or ""
    address = arv.get_device_address(index) or ""
    # A USB camera has no address that another program could use but its number.
    reach = address if protocol == "GigEVision" else identity.serial
    return FoundBy(identity, reach, protocol)


def _delivery(buffer: Any) -> Delivery:
    status = str(buffer.get_status().value_nick).upper().replace("-", "_")
    complete = status in _USABLE
    return Delivery(
        complete=complete,
        status=status,
        frame_id=int(buffer.get_frame_id()),
        width=int(buffer.get_image_width()) if complete else 0,
        height=int(buffer.get_image_height()) if complete else 0,
        pixel_code=int(buffer.get_image_pixel_format()) if complete else 0,
        data=bytes(buffer.get_image_data()) if complete else b"",
        timestamp_ns=int(buffer.get_timestamp()),
    )
