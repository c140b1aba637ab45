"""GigE Vision through the wheel ``telegenicam`` (imported as ``telegenic``)."""

from __future__ import annotations

from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

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

    import telegenic

    from drivers._genicam.backend import Kind, StreamSettings, Value

_SEARCH_S = 1.0
_NEGOTIATE = 0
_COUNTED = (
    "completed_frames",
    "failed_frames",
    "timed_out_frames",
    "missing_packets",
    "resent_packets",
    "socket_drops",
    "frames_dropped",
)


class TelegenicamBackend:
    """``Backend`` over telegenicam: GigE Vision only."""

    name = "telegenicam"

    def __init__(self) -> None:
        self._camera: telegenic.Camera | None = None
        self._stream: telegenic.Acquisition | None = None

    @property
    def version(self) -> str:
        """Of the wheel."""
        try:
            return version("telegenicam")
        except PackageNotFoundError:
            return "not installed"

    def discover(self) -> tuple[FoundBy, ...]:
        """Cameras on every network adapter but the loopback one."""
        import telegenic

        try:
            found = telegenic.discover(_SEARCH_S)
        except telegenic.CameraError:
            # That no adapter is up is its word for "nothing found".
            return ()
        return tuple(FoundBy(_identity(one), one.ip, "GigEVision") for one in found)

    def open(self, address: str) -> Identity:
        """Take control of a camera by IP address, serial number or name."""
        import telegenic

        self._camera = telegenic.Camera(self._ip_of(address))
        with _translated():
            self._camera.connect()
            return _identity(self._camera.device_info())

    def has(self, feature: str) -> bool:
        """Whether the camera has a feature of this name."""
        with _translated():
            return self._open_camera.has_feature(feature)

    def get(self, feature: str, kind: Kind) -> Value:
        """Read from the camera, past the library's cache."""
        camera = self._open_camera
        with _translated():
            camera.invalidate_caches()
            if kind == "boolean":
                return camera.get_boolean(feature)
            if kind == "integer":
                return camera.get_integer(feature)
            if kind == "float":
                return camera.get_float(feature)
            return camera.get_enum(feature)

    def set(self, feature: str, value: Value) -> None:
        """Write by the type of the value."""
        camera = self._open_camera
        with _translated():
            if isinstance(value, bool):
                camera.set_boolean(feature, value)
            elif isinstance(value, int):
                camera.set_integer(feature, value)
            elif isinstance(value, float):
                camera.set_float(feature, value)
            else:
                camera.set_enum(feature, value)

    def bounds(self, feature: str, kind: Kind) -> tuple[float, float]:
        """Lowest and highest value of a number."""
        with _translated():
            if kind == "integer":
                return self._open_camera.integer_bounds(feature)
            return self._open_camera.float_bounds(feature)

    def choices(self, feature: str) -> tuple[str, ...]:
        """Entries of an enumeration."""
        with _translated():
            return tuple(self._open_camera.enum_entries(feature))

    def arm(self, settings: StreamSettings) -> None:
        """Begin the one long acquisition."""
        size = settings.packet_size
        with _translated():
            self._stream = self._open_camera.start_acquisition(
                n_buffers=settings.buffers,
                packet_size=None if size == _NEGOTIATE else size,
                resend=settings.resend,
                stream_socket={"recv_buffer": settings.buffer_bytes},
            )

    def trigger(self) -> None:
        """Execute TriggerSoftware."""
        with _translated():
            self._open_camera.execute("TriggerSoftware")

    def drain(self) -> int:
        """Throw waiting pictures away; how many there were."""
        with _translated():
            return len(self._running.recv_all())

    def wait(self, timeout_s: float) -> Delivery | None:
        """The next picture, or None when none came in time."""
        with _translated():
            frame = self._running.wait_for(timeout_s)
        if frame is None:
            if not self._open_camera.is_connected():
                raise BackendLost("device control was lost")
            return None
        return Delivery(
            complete=frame.is_complete,
            status=str(frame.status).rpartition(".")[2],
            frame_id=frame.frame_id,
            width=frame.width,
            height=frame.height,
            pixel_code=frame.pixel_format_code,
            data=frame.data() if frame.is_complete else b"",
            timestamp_ns=frame.timestamp_ns,
        )

    def disarm(self) -> None:
        """End the acquisition; quiet when the camera is gone."""
        stream, self._stream = self._stream, None
        if stream is not None:
            with suppress(BackendLost, BackendRefused), _translated():
                stream.stop()

    def health(self) -> Health:
        """Connection and counters."""
        if self._camera is None or not self._camera.is_connected():
            return Health(connected=False)
        if self._stream is None:
            return Health(connected=True)
        stats = self._stream.stats()
        return Health(True, {name: int(getattr(stats, name)) for name in _COUNTED})

    def close(self) -> None:
        """Give the camera back."""
        self.disarm()
        camera, self._camera = self._camera, None
        if camera is not None:
            with suppress(BackendLost, BackendRefused), _translated():
                camera.disconnect()

    @property
    def _open_camera(self) -> telegenic.Camera:
        if self._camera is None:
            raise BackendLost("not open")
        return self._camera

    @property
    def _running(self) -> telegenic.Acquisition:
        if self._stream is None:
            raise BackendLost("no acquisition is running")
        return self._stream

    def _ip_of(self, address: str) -> str:
        """Look a serial number or a name up on the network."""
        if is_ip_address(address):
            return address
        found = [
            one
            for one in self.discover()
            if address in (one.identity.serial, one.identity.user_name)
        ]
        if len(found) != 1:
            how_many = "no camera" if not found else f"{len(found)} cameras"
            raise BackendLost(
                f"{how_many} with serial number or name {address!r} answered; "
                "telegenicam does not search the loopback interface"
            )
        return found[0].address


def _identity(info: telegenic.DeviceInfo) -> Identity:
    return Identity(
        info.manufacturer,
        info.model,
        info.serial,
        info.device_version,
        info.user_defined_name,
    )


@contextmanager
def _translated() -> Iterator[None]:
    """The library's errors as ours."""
    import telegenic

    try:
        yield
    except telegenic.CameraError as error:
        raise BackendLost(str(error)) from error
    except (telegenic.GenicamError, ValueError) as error:
        raise BackendRefused(str(error)) from error
