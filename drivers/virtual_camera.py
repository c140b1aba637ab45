"""A simulated free-running camera: a frame queue, honest time stamps, real waiting."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, ClassVar, Self

from pydantic import Field

from drivers.virtual_link import identity, require_reachable
from drivers.virtual_world import VirtualWorld, world_of
from mvp.devices import DeviceContext, DeviceInfo, Frame, Link, Role
from mvp.errors import DeviceFault, DeviceTimeout, LimitError, MotionStopped
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Iterator

_LOG = logging.getLogger(__name__)
_SAME = 1e-6  # of the exposure: read back as it was set
_FULL_SCALE = 255


class VirtualCameraConfig(FileModel):
    """Keys of ``[camera]`` for the virtual camera."""

    period_s: float = Field(default=0.05, gt=0, description="free-running frame period")
    readout_s: float = Field(default=0.015, ge=0)
    exposure_min_s: float = Field(default=20e-6, gt=0)
    exposure_max_s: float = Field(default=2.0, gt=0)
    gain_max: float = Field(default=16.0, ge=1)
    serial: str = "V-CAM-1"


class VirtualCamera:
    """The camera of a virtual world; exposes frame after frame from ``open`` on."""

    role: ClassVar[Role] = "camera"
    Config = VirtualCameraConfig

    def __init__(
        self, config: VirtualCameraConfig, world: VirtualWorld, name: str
    ) -> None:
        self.name = name
        self._config = config
        self._world = world
        self._clock = world.clock
        self._link = Link(
            name, world.clock, connect=self._connect, disconnect=self.stop
        )
        self._exposure_s = max(0.01, config.exposure_min_s)
        self._gain = 1.0
        self._began_s = 0.0
        self._first_id = 0
        self._last_id = -1
        self._delivered = 0

    @classmethod
    def from_config(
        cls, config: VirtualCameraConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build the device; no I/O.

        Raises:
            ConfigError: the cell has no virtual world.
        """
        return cls(config, world_of(context, name), name)

    def open(self) -> None:
        """Connect and start the free run.

        Raises:
            ConnectError: it has been made unreachable.
        """
        self._link.open()

    def close(self) -> None:
        """Disconnect; safe to repeat."""
        self._link.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def info(self) -> DeviceInfo:
        """Identity and versions."""
        camera = self._world.belief.camera
        return identity(
            self.name,
            driver="virtual-camera",
            model=f"virtual {camera.width_px} x {camera.height_px}",
            serial=self._config.serial,
        )

    def stop(self) -> None:
        """Give up waiting for a frame, from any thread."""
        self._link.interrupt()

    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure."""
        return self._config.exposure_min_s, self._config.exposure_max_s

    def configure(self, *, exposure_s: float, gain: float = 1.0) -> None:
        """Set and read back; the free run starts anew.

        Raises:
            LimitError: outside the camera's range.
            DeviceFault: the value read back differs.
        """
        self._link.require_open()
        low, high = self.exposure_range_s()
        if not low <= exposure_s <= high:
            raise LimitError(
                f"exposure {exposure_s:.6f} s is outside {low:.6f} .. {high:.6f} s",
                device=self.name,
                hint="change the light, the iris or the task's exposure",
            )
        if not 1 <= gain <= self._config.gain_max:
            raise LimitError(
                f"gain {gain:.2f} is outside 1 .. {self._config.gain_max:.2f}",
                device=self.name,
            )
        read_back_s = exposure_s * self._world.faults.camera.read_back_factor
        if abs(read_back_s - exposure_s) > _SAME * exposure_s:
            raise DeviceFault(
                f"exposure reads back as {read_back_s:.6f} s instead of "
                f"{exposure_s:.6f} s",
                device=self.name,
                code="read-back",
                hint="another program may be using the camera",
            )
        self._exposure_s, self._gain = exposure_s, gain
        _LOG.debug("%s: exposes %.6f s, gain %.2f", self.name, exposure_s, gain)
        self._restart()

    def capture(self, *, not_before_s: float, timeout_s: float) -> Frame:
        """One frame whose exposure began at or after ``not_before_s``.

        Raises:
            DeviceTimeout: no such frame in time.
            DeviceFault: another capture is in progress.
            MotionStopped: ``stop`` was called while it waited.
        """
        self._link.require_open()
        with self._link.busy(self._clock.now_s) as began_s:
            return self._next_frame(not_before_s, began_s, timeout_s)

    @property
    def _period_s(self) -> float:
        return max(self._config.period_s, self._exposure_s + self._config.readout_s)

    def _connect(self) -> None:
        require_reachable(
            self._world.faults.camera, self.name, look_at="check cable and supply"
        )
        self._restart()

    def _restart(self) -> None:
        """Begin exposing frame after frame with the present settings."""
        self._first_id = self._last_id + 1
        self._began_s = self._clock.now_s()

    def _start_s(self, frame_id: int) -> float:
        """When the exposure of a frame begins."""
        return self._began_s + (frame_id - self._first_id) * self._period_s

    def _queue(self, not_before_s: float, now_s: float) -> Iterator[int]:
        """Ids of the frames as the device delivers them: old ones may come first."""
        faults = self._world.faults.camera
        since = max(not_before_s, now_s - self._period_s) - self._began_s
        fresh = self._first_id + max(0, math.ceil(since / self._period_s))
        fresh = max(fresh, self._last_id + 1)
        yield from range(max(self._first_id, fresh - faults.stale_frames), fresh)
        while True:
            yield fresh
            fresh += 1

    def _next_frame(self, not_before_s: float, now_s: float, timeout_s: float) -> Frame:
        """Which one it is, and whether in time, follows from when it was asked for.

        Not from when this was reckoned: on a busy computer and by a fast clock seconds
        lie between the two.
        """
        faults = self._world.faults.camera
        deadline = now_s + timeout_s
        dropped = 0
        for frame_id in self._queue(not_before_s, now_s):
            start = self._start_s(frame_id)
            received = start + self._exposure_s + self._config.readout_s
            dead = faults.dead_after_frames
            if dead is not None and self._delivered >= dead:
                received = math.inf
            self._wait_until(received, deadline)
            lost = faults.drop_every and frame_id % faults.drop_every == 0
            if lost:
                dropped += 1
            elif start >= not_before_s:
                return self._frame(frame_id, start, dropped)
        raise DeviceTimeout("no frame", device=self.name)

    def _wait_until(self, moment: float, deadline: float) -> None:
        """Wait for a moment, unless the deadline or ``stop`` comes first."""
        if not self._link.wait_until(min(moment, deadline)):
            raise MotionStopped("stopped while waiting for a frame", device=self.name)
        if moment > deadline:
            raise DeviceTimeout(
                "no frame in time",
                device=self.name,
                hint="check cable, supply and trigger of the camera",
            )

    def _frame(self, frame_id: int, start_s: float, dropped: int) -> Frame:
        """Expose the frame; the light was collected when the fault says it was."""
        faults = self._world.faults.camera
        pixels = self._world.frame(
            start_s - faults.stamp_ahead_s,
            self._exposure_s * faults.exposure_factor,
            gain=self._gain,
            index=self._delivered,
        )
        self._last_id = frame_id
        self._delivered += 1
        _LOG.debug(
            "%s: frame %d began at %.4f s, %d dropped before it",
            self.name,
            frame_id,
            start_s,
            dropped,
        )
        return Frame(
            pixels=pixels,
            full_scale=_FULL_SCALE,
            exposure_start_s=start_s,
            exposure_s=self._exposure_s,
            received_s=self._clock.now_s(),
            frame_id=frame_id,
            gain=self._gain,
            dropped=dropped,
        )
