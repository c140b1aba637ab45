"""One picture whose exposure begins after it was asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.errors import DeviceFault

if TYPE_CHECKING:
    from mvp.devices import Camera, Clock, Frame

_SPARE_S = 10.0


def fresh_frame(
    camera: Camera,
    clock: Clock,
    *,
    exposure_s: float,
    gain: float = 1.0,
    spare_s: float = _SPARE_S,
) -> Frame:
    """Set the exposure and take one frame that begins after now.

    Args:
        camera: open; nobody else uses it meanwhile.
        clock: the devices' own.
        exposure_s: inside the camera's range.
        gain: factor.
        spare_s: waited beside a few exposures, for what camera and line need.

    Raises:
        DeviceFault: the frame says that it began earlier, or a setting did not take.
        DeviceTimeout, LinkLost, MotionStopped: see ``Camera.capture``.
    """
    camera.configure(exposure_s=exposure_s, gain=gain)
    not_before_s = clock.now_s()
    frame = camera.capture(
        not_before_s=not_before_s, timeout_s=4 * exposure_s + spare_s
    )
    if frame.exposure_start_s < not_before_s:
        raise DeviceFault(
            "the frame's exposure began before it was asked for",
            device=camera.name,
            hint="the camera's time stamps cannot be trusted; use its software trigger",
        )
    return frame
