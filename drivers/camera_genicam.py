"""GenICam cameras (GigE Vision, USB3 Vision): triggered by software, frame by frame."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, ClassVar, Self

from drivers._genicam import (
    BackendName,
    Session,
    SessionSettings,
    StreamSettings,
    backend_for,
    buffer_finding,
    found_cameras,
    library_finding,
    packet_findings,
)
from drivers._genicam.config import GenicamCameraConfig
from drivers._genicam.hopeless import Tries
from drivers._genicam.kernel import buffer_warning, rmem_max
from drivers._genicam.pixels import frames_between, grey_picture
from mvp.devices import (
    CameraFound,
    DeviceContext,
    DeviceInfo,
    Finding,
    Frame,
    Role,
    require_real_time,
)
from mvp.devices.link import Link
from mvp.errors import (
    ConnectError,
    DeviceFault,
    DeviceTimeout,
    MotionStopped,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers._genicam import Backend, Delivery, Value

_LOG = logging.getLogger(__name__)
_KEY = "genicam"
_BUFFER_BYTES = 16 << 20
_BYTES_PER_S = 100e6  # what Gigabit Ethernet carries of pictures
_TRIES = 3
_EARLY = "a frame that came before its exposure can have ended"
_SLICE_S = 0.05  # how soon a stop is noticed


class GenicamCamera:
    """One acquisition from ``open`` to ``close``; every picture has its own trigger."""

    role: ClassVar[Role] = "camera"
    Config = GenicamCameraConfig

    def __init__(
        self,
        config: GenicamCameraConfig,
        context: DeviceContext,
        name: str,
        *,
        new_backend: Callable[[BackendName], Backend] = backend_for,
    ) -> None:
        self.name = name
        self._new_backend = new_backend
        self._config = config
        require_real_time(context.clock, name)
        self._clock = context.clock
        self._link = Link(
            name, context.clock, connect=self._connect, disconnect=self._disconnect
        )
        self._session: Session | None = None
        self._warned = False
        self._pending = False
        self._last_id: int | None = None
        self._frames = 0
        self._transfer_s = 0.0

    @classmethod
    def from_config(
        cls, config: GenicamCameraConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the device; no I/O."""
        return cls(config, context, name)

    @classmethod
    def find_cameras(cls) -> tuple[CameraFound, ...]:
        """Cameras that answer, through every library that is installed; about 1-2 s."""
        return found_cameras(_KEY)

    @classmethod
    def check_host(cls, config: GenicamCameraConfig) -> tuple[Finding, ...]:
        """Library, socket buffers and packet size; opens nothing."""
        pixels = (config.width_px or 0) * (config.height_px or 0)
        frame_bytes = pixels * (1 if config.pixel_format == "Mono8" else 2)
        known = "address" in config.model_fields_set
        return (
            library_finding(config.backend),
            buffer_finding(frame_bytes or None),
            *packet_findings(config.address if known else "", config.packet_size),
        )

    def open(self) -> None:
        """Take control, prove every setting, start the stream.

        Raises:
            ConnectError: nobody answers, or another camera does.
            DeviceFault: a setting did not take.
            PluginError: no GenICam library is installed.
        """
        self._link.open()

    def close(self) -> None:
        """Give the camera back; safe to repeat."""
        self._link.interrupt()
        self._link.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def info(self) -> DeviceInfo:
        """Identity and versions; ``extra`` tells library, packets and buffers."""
        session = self._alive()
        who = session.identity
        if who is None:
            raise ConnectError("not connected", device=self.name)
        return DeviceInfo(
            self.name,
            _KEY,
            f"{who.vendor} {who.model}".strip(),
            who.serial,
            who.version,
            simulated=who.vendor == "Aravis" and who.model == "Fake",
            extra={
                "backend": f"{session.backend.name} {session.backend.version}",
                "address": self._config.address,
                "packet_size": str(self._config.packet_size),
                "receive_buffer": str(_BUFFER_BYTES),
                "net.core.rmem_max": str(rmem_max() or "unknown"),
                **{k: str(v) for k, v in session.backend.health().counts.items()},
            },
        )

    def stop(self) -> None:
        """Give up waiting for a frame, from any thread."""
        self._link.interrupt()

    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure."""
        return self._alive().exposure_range_s()

    def configure(self, *, exposure_s: float, gain: float = 1.0) -> None:
        """Set and read back.

        Raises:
            LimitError: outside the camera's range.
            DeviceFault: the value read back differs.
            LinkLost: the camera is gone.
        """
        self._alive().configure(exposure_s, gain)
        _LOG.debug("%s: exposes %.6f s, gain %.2f", self.name, exposure_s, gain)

    def capture(self, *, not_before_s: float, timeout_s: float) -> Frame:
        """Trigger one frame at or after ``not_before_s``.

        A frame with lost packets is thrown away and asked for again, twice at most.

        Raises:
            DeviceTimeout: no frame before the deadline.
            DeviceFault: three frames in a row were lost or had holes.
            LinkLost: the camera is gone; the next call tries to connect once.
            MotionStopped: ``stop`` was called while it waited.
        """
        self._link.require_open()
        with self._link.busy(self._clock.now_s) as began_s:
            session = self._alive()
            return self._capture(session, not_before_s, began_s + timeout_s)

    def _connect(self) -> None:
        if not self._warned:
            _LOG.warning("%s: this driver was not tried on hardware", self.name)
            self._warned = True
        session = self._session or self._new_session()
        session.connect()
        self._session = session
        self._pending, self._last_id = False, None
        payload_bytes = session.payload_bytes()
        self._transfer_s = payload_bytes / _BYTES_PER_S
        if warning := buffer_warning(payload_bytes, _BUFFER_BYTES):
            _LOG.warning("%s: %s", self.name, warning)

    def _disconnect(self) -> None:
        if self._session is not None:
            self._session.close()

    def _alive(self) -> Session:
        """The session; connected anew, once, when it had been lost."""
        self._link.require_open()
        session = self._session
        if session is None or not session.connected:
            _LOG.warning("%s: the camera was lost; connecting again", self.name)
            self._connect()
            session = self._session
        if session is None:
            raise ConnectError("not connected", device=self.name)
        return session

    def _new_session(self) -> Session:
        config = self._config
        asked: dict[str, Value | None] = {
            "PixelFormat": config.pixel_format,
            # Offsets last: they limit the size, and the size limits them.
            "Width": config.width_px,
            "Height": config.height_px,
            "OffsetX": config.offset_x_px,
            "OffsetY": config.offset_y_px,
        }
        fixed = {name: value for name, value in asked.items() if value is not None}
        settings = SessionSettings(
            config.address,
            config.serial,
            {**fixed, **config.features},
            StreamSettings(
                config.packet_size, _BUFFER_BYTES, config.buffers, config.packet_resend
            ),
            config.gain_db_per_raw,
            config.gain_floor,
        )
        return Session(self._new_backend(config.backend), settings, self.name)

    def _capture(self, session: Session, not_before_s: float, deadline: float) -> Frame:
        if not self._link.wait_until(min(not_before_s, deadline)):
            raise MotionStopped("stopped while waiting for a frame", device=self.name)
        if not_before_s > deadline:
            raise self._late()
        if self._pending:
            # An earlier trigger may still be answered, with a picture that is too old.
            self._rearm(session)
        tries = Tries(self._config.packet_size, self._config.address)
        start_s: float | None = None
        while tries.count < _TRIES:
            if start_s is None:
                # Before the trigger: no light can have been collected earlier.
                start_s = self._clock.now_s()
            if session.drain():
                delivery, problem = None, "frames that nobody triggered"
            else:
                delivery, problem = self._triggered(session, start_s, deadline)
            if delivery is not None and not problem:
                # A second trigger after an early frame may still be answered.
                self._pending = _EARLY in tries.problems
                return self._frame(session, delivery, start_s)
            tries.failed(problem, session.backend.health())
            _LOG.warning("%s: try %d: %s", self.name, tries.count, problem)
            if delivery is None:
                self._rearm(session)
            if problem != _EARLY:
                start_s = None
        raise tries.fault(self.name)

    def _rearm(self, session: Session) -> None:
        session.rearm()
        self._pending, self._last_id = False, None

    def _triggered(
        self, session: Session, start_s: float, deadline: float
    ) -> tuple[Delivery | None, str]:
        """Trigger, and what came of it: a delivery, and what is wrong, if anything."""
        self._pending = True
        session.trigger()
        delivery = self._wait(session, start_s, deadline)
        if delivery is None:
            return None, "no frame"
        if not delivery.complete:
            # This trigger was answered. The stream stays: libraries enlarge the buffer
            # of its socket with the first frame only, which may be lost for that.
            self._pending = False
            return delivery, delivery.status
        if self._clock.now_s() < start_s + session.exposure_s:
            return delivery, _EARLY
        return delivery, ""

    def _wait(
        self, session: Session, start_s: float, deadline: float
    ) -> Delivery | None:
        """What the trigger brought; None when nothing came in a camera's time."""
        config = self._config
        patience_s = session.exposure_s + config.readout_s + 2 * self._transfer_s
        until = start_s + patience_s + config.frame_slack_s
        while True:
            now_s = self._clock.now_s()
            if self._link.interrupted:
                raise MotionStopped("stopped while waiting", device=self.name)
            if now_s >= deadline:
                raise self._late()
            if now_s >= until:
                return None
            delivery = session.wait(min(_SLICE_S, until - now_s, deadline - now_s))
            if delivery is not None:
                return delivery

    def _frame(self, session: Session, delivery: Delivery, start_s: float) -> Frame:
        """The picture with everything that is known about its time."""
        received_s = self._clock.now_s()
        try:
            pixels, full_scale = grey_picture(
                delivery.data,
                width=delivery.width,
                height=delivery.height,
                pixel_code=delivery.pixel_code,
            )
        except ValueError as error:
            raise DeviceFault(str(error), device=self.name, code="format") from error
        advance = self._advance(delivery.frame_id)
        _LOG.debug(
            "%s: frame %d triggered at %.4f s, here at %.4f s, %d missed",
            self.name,
            delivery.frame_id,
            start_s,
            received_s,
            advance - 1,
        )
        return Frame(
            pixels=pixels,
            full_scale=full_scale,
            exposure_start_s=start_s,
            exposure_s=session.exposure_s,
            received_s=received_s,
            frame_id=self._frames,
            gain=session.gain,
            dropped=advance - 1,
            device_time_ns=delivery.timestamp_ns,
        )

    def _advance(self, camera_id: int) -> int:
        """Count the frame by the camera's own counter, which may wrap.

        Raises:
            DeviceFault: the counter stands: this frame is not the one triggered.
        """
        last, self._last_id = self._last_id, camera_id
        advance = 1 if last is None else frames_between(last, camera_id)
        if advance < 1:
            self._pending = True
            raise DeviceFault(
                f"frame {camera_id} came after frame {last}",
                device=self.name,
                code="frame-id",
                hint="another program may be triggering the camera",
            )
        self._frames += advance
        return advance

    def _late(self) -> DeviceTimeout:
        return DeviceTimeout(
            "no frame in time",
            device=self.name,
            hint="check cable, supply and trigger of the camera",
        )
