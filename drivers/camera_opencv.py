"""Cameras that OpenCV reads: USB (V4L2), network streams, films and picture folders."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, ClassVar, Self

from pydantic import Field

from drivers._opencv import (
    Exposure,
    FixedExposure,
    HttpExposure,
    Reader,
    Replay,
    SourceSettings,
    V4l2Exposure,
    kind_of,
    open_source,
    v4l2_devices,
)
from drivers._opencv.grey import as_grey
from mvp.devices import DeviceContext, DeviceInfo, Frame, Role, require_real_time
from mvp.devices.cameras import CameraFound
from mvp.devices.link import Link
from mvp.errors import ConnectError, DeviceFault, DeviceTimeout, LinkLost, MotionStopped
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from drivers._opencv import Kind, OpenedSource

_LOG = logging.getLogger(__name__)
_KEY = "opencv"
_POLL_S = 0.005
_PERIODS_LATE = 2  # how old a frame of an unknown source may be when it arrives


class OpencvCameraConfig(FileModel):
    """Keys of ``[camera]`` for what OpenCV reads."""

    source: str = Field(
        min_length=1,
        description="/dev/v4l/by-id/..., a name in that folder, rtsp:// or http:// URL, "
        "film, or folder of pictures",
    )
    width_px: int | None = Field(default=None, ge=1)
    height_px: int | None = Field(default=None, ge=1)
    fps: float | None = Field(
        default=None,
        gt=0,
        description="nominal frame rate, set on USB cameras; 1 / period_s when missing",
    )
    fourcc: str = Field(default="", pattern="^(....)?$", description="USB only")
    period_s: float = Field(
        default=0.1,
        gt=0,
        description="longest time between two frames; two of them, and the exposure, "
        "are how old a frame may be when it arrives",
    )
    fixed_exposure_s: float = Field(
        default=0.01, gt=0, description="of sources whose exposure cannot be set"
    )
    exposure_min_s: float = Field(default=1e-4, gt=0)
    exposure_max_s: float = Field(default=0.5, gt=0)
    control_url: str = Field(
        default="", description="sets {exposure_us} and {gain}, answers with JSON"
    )
    allow_auto_exposure: bool = False
    settle_frames: int = Field(
        default=2, ge=2, description="discarded after a change of exposure"
    )
    gamma: float = Field(
        default=1.0, gt=0, description="exponent that makes grey linear in light"
    )
    loop: bool = Field(default=False, description="films and folders: start anew")
    serial: str = Field(default="", description="what to call it in records")
    open_timeout_s: float = Field(default=5.0, gt=0)
    read_timeout_s: float = Field(default=2.0, gt=0)


class OpencvCamera:
    """Frames that are stamped as they arrive and never handed out too old."""

    role: ClassVar[Role] = "camera"
    Config = OpencvCameraConfig

    def __init__(
        self, config: OpencvCameraConfig, context: DeviceContext, name: str
    ) -> None:
        require_real_time(context.clock, name)
        self.name = name
        self._config = config
        self._clock = context.clock
        self._kind: Kind = kind_of(config.source, context.folder)
        self._path = context.folder / config.source
        self._link = Link(
            name, context.clock, connect=self._connect, disconnect=self._disconnect
        )
        self._opened: OpenedSource | None = None
        self._reader: Reader | None = None
        self._replay: Replay | None = None
        self._control: Exposure | None = None
        self._asked: tuple[float, float] | None = None
        self._exposure_s, self._gain = config.fixed_exposure_s, 1.0
        self._changed_s = 0.0
        self._frames = 0
        self._warned = False

    @classmethod
    def from_config(
        cls, config: OpencvCameraConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the device; no I/O."""
        return cls(config, context, name)

    @classmethod
    def find_cameras(cls) -> tuple[CameraFound, ...]:
        """USB cameras by the names that the kernel gives them; opens none."""
        return tuple(
            CameraFound(
                _KEY,
                str(path),
                path.name.removeprefix("usb-").removesuffix("-video-index0"),
                "",
                f"V4L2, {path.resolve()}",
            )
            for path in v4l2_devices()
        )

    def open(self) -> None:
        """Open the source and see a first picture.

        Raises:
            ConnectError: it does not open, or shows nothing.
            DeviceFault: a setting did not take, or automatic exposure stays on.
        """
        self._link.open()

    def close(self) -> None:
        """Release the source; safe to repeat."""
        self._link.interrupt()
        self._link.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def info(self) -> DeviceInfo:
        """What is open; sources do not tell a serial number of their own."""
        import cv2

        self._link.require_open()
        opened = self._opened
        size = f" {opened.width_px} x {opened.height_px}" if opened else ""
        return DeviceInfo(
            self.name,
            _KEY,
            f"{self._kind}{size}",
            self._config.serial or self._config.source,
            f"OpenCV {cv2.__version__}",
            simulated=self._is_replay,
            extra={
                "source": self._config.source,
                "backend": opened.backend if opened else "replay",
                "period_s": f"{self._config.period_s:g}",
            },
        )

    def stop(self) -> None:
        """Give up waiting for a frame, from any thread."""
        self._link.interrupt()

    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure; equal where it cannot be set."""
        return self._exposure_control().limits_s()

    def configure(self, *, exposure_s: float, gain: float = 1.0) -> None:
        """Set and read back; frames from before the change are not handed out.

        Raises:
            LimitError: out of range, or cannot be set on this source.
            DeviceFault: the value read back differs.
        """
        self._exposure_s, self._gain = self._exposure_control().apply(exposure_s, gain)
        if self._asked != (exposure_s, gain):
            self._changed_s = self._clock.now_s()
        self._asked = (exposure_s, gain)

    def capture(self, *, not_before_s: float, timeout_s: float) -> Frame:
        """The first frame whose exposure cannot have begun before ``not_before_s``.

        Raises:
            DeviceTimeout: no such frame in time.
            DeviceFault: a film or a folder has come to its end.
            LinkLost: the source is gone; the next call tries to open it once.
            MotionStopped: ``stop`` was called while it waited.
        """
        self._link.require_open()
        with self._link.busy(self._clock.now_s) as began_s:
            deadline = began_s + timeout_s
            if self._replay is not None:
                return self._next_replayed(self._replay, not_before_s, deadline)
            return self._next_live(not_before_s, deadline)

    @property
    def _is_replay(self) -> bool:
        return self._kind in ("file", "folder")

    def _connect(self) -> None:
        if not self._warned and not self._is_replay:
            _LOG.warning("%s: this driver was not tried on hardware", self.name)
            self._warned = True
        if self._is_replay:
            replay = Replay(self._path, loop=self._config.loop, device=self.name)
            replay.open()
            self._replay = replay
            self._control = FixedExposure(self._config.fixed_exposure_s, self.name)
            return
        self._connect_live()

    def _connect_live(self) -> None:
        config = self._config
        opened = open_source(
            SourceSettings(
                config.source,
                self._kind,
                config.width_px,
                config.height_px,
                config.fps,
                config.fourcc,
                config.open_timeout_s,
                config.read_timeout_s,
            ),
            device=self.name,
        )
        try:
            self._control = self._control_of(opened)
            if self._asked is not None:
                self._exposure_s, self._gain = self._control.apply(*self._asked)
                self._changed_s = self._clock.now_s()
        except BaseException:
            opened.capture.release()
            raise
        self._opened = opened
        shortest_s = 1 / config.fps if config.fps else config.period_s
        self._reader = Reader(
            opened.capture, self._clock, period_s=shortest_s, name=self.name
        )
        self._reader.start()

    def _control_of(self, opened: OpenedSource) -> Exposure:
        """How exposure is set on this source; automatic exposure is off afterwards."""
        config = self._config
        limits_s = (config.exposure_min_s, config.exposure_max_s)
        if self._kind == "v4l2":
            control = V4l2Exposure(
                opened.capture, limits_s, config.allow_auto_exposure, self.name
            )
            control.switch_off_automatic()
            return control
        if config.control_url:
            return HttpExposure(
                config.control_url, limits_s, config.read_timeout_s, self.name
            )
        _LOG.warning(
            "%s: nothing is known of this stream's exposure; it is taken to be fixed "
            "at %g s",
            self.name,
            config.fixed_exposure_s,
        )
        return FixedExposure(config.fixed_exposure_s, self.name)

    def _disconnect(self) -> None:
        reader, self._reader = self._reader, None
        replay, self._replay = self._replay, None
        self._opened, self._control = None, None
        if reader is not None:
            reader.stop()
        if replay is not None:
            replay.close()

    def _exposure_control(self) -> Exposure:
        self._link.require_open()
        self._alive()
        if self._control is None:
            raise ConnectError("not connected", device=self.name)
        return self._control

    def _alive(self) -> None:
        """Open the source again, once, when it has been lost."""
        if self._is_replay or (self._reader is not None and not self._reader.lost):
            return
        _LOG.warning("%s: the source was lost; opening it again", self.name)
        self._disconnect()
        self._connect()

    def _next_live(self, not_before_s: float, deadline: float) -> Frame:
        self._alive()
        reader = self._reader
        if reader is None:
            raise ConnectError("not connected", device=self.name)
        settled_s = self._changed_s + self._config.settle_frames * self._config.period_s
        behind_s = _PERIODS_LATE * self._config.period_s + self._exposure_s
        reader.want(max(not_before_s, settled_s) + behind_s)
        try:
            while (reading := reader.take()) is None:
                if reader.lost:
                    raise self._lost()
                self._wait(deadline)
        finally:
            reader.forget()
        start_s = reading.arrived_after_s - behind_s
        # Rounding must not turn "at or after" into "before".
        start_s = max(start_s, not_before_s)
        dropped = 0
        return self._frame(reading.picture, start_s, reading.received_s, dropped)

    def _next_replayed(
        self, replay: Replay, not_before_s: float, deadline: float
    ) -> Frame:
        """The next picture; its exposure is said to begin when it is asked for."""
        while self._clock.now_s() < not_before_s:
            self._wait(deadline, until=not_before_s)
        start_s = self._clock.now_s()
        while self._clock.now_s() < start_s + self._exposure_s:
            self._wait(deadline, until=start_s + self._exposure_s)
        picture = replay.next()
        if picture is None:
            raise DeviceFault(
                f"{self._config.source} has come to its end",
                device=self.name,
                code="end",
                hint="loop = true starts anew after the last picture",
            )
        return self._frame(picture, start_s, self._clock.now_s(), 0)

    def _wait(self, deadline: float, until: float | None = None) -> None:
        """Sleep a little, or until a moment; notice deadline and ``stop``."""
        now_s = self._clock.now_s()
        if now_s >= deadline:
            raise DeviceTimeout(
                "no frame in time",
                device=self.name,
                hint="check the source, and period_s: the reader must be able to keep "
                "the queue empty",
            )
        moment_s = now_s + _POLL_S if until is None else until
        if not self._link.wait_until(min(moment_s, deadline)):
            raise MotionStopped("stopped while waiting for a frame", device=self.name)

    def _frame(
        self,
        picture: NDArray[np.uint8] | NDArray[np.uint16],
        start_s: float,
        received_s: float,
        dropped: int,
    ) -> Frame:
        grey, full_scale = as_grey(picture, self._config.gamma)
        self._frames += 1
        _LOG.debug(
            "%s: frame %d began at %.4f s or later, here at %.4f s",
            self.name,
            self._frames,
            start_s,
            received_s,
        )
        return Frame(
            pixels=grey,
            full_scale=full_scale,
            exposure_start_s=start_s,
            exposure_s=self._exposure_s,
            received_s=received_s,
            frame_id=self._frames,
            gain=self._gain,
            dropped=dropped,
        )

    def _lost(self) -> LinkLost:
        return LinkLost(
            f"{self._config.source} delivers no more pictures",
            device=self.name,
            hint="check power, cable and network of the camera",
        )
