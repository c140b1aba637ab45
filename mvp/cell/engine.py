"""Executes one view on real or virtual devices: move, set lens, settle, capture.

The picture's exposure begins after arm and lens have confirmed that they stand still
and the settling times have passed; this is checked again on the frame itself.
"""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

import numpy as np

from mvp.cell.calibrated_devices import require_size
from mvp.cell.fresh_frame import fresh_frame
from mvp.cell.records import Captured, CaptureTimes, Reached, Verified
from mvp.cell.standstill import until
from mvp.cell.stopping import stop_all
from mvp.errors import DeviceFault, MotionStopped

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from mvp.calibrated import CameraCalibration
    from mvp.cell.records import Stillness
    from mvp.cell.stillness import StillCheck
    from mvp.devices import (
        Arm,
        ArmState,
        Camera,
        Clock,
        Device,
        Frame,
        Lens,
        LensState,
    )
    from mvp.geometry import FloatArray
    from mvp.planning.plan import PlannedView

_LOG = logging.getLogger(__name__)
_ARM_SPARE_S = 15.0
_LENS_TIMEOUT_S = 120.0
_STOP_S = 5.0

ExposureSource: TypeAlias = Literal["task", "metered"]


@dataclass(frozen=True)
class Exposure:
    """How long, how amplified, and who said so."""

    exposure_s: float
    gain: float
    source: ExposureSource


class ExposureRule(Protocol):
    """Chooses the exposure of a view; may take metering frames."""

    def __call__(
        self, view: PlannedView, shoot: Callable[[float, float], Frame]
    ) -> Exposure:
        """``shoot(exposure_s, gain)`` takes one frame with everything standing."""
        ...


class PictureStore(Protocol):
    """Keeps a picture; it is on disk when this returns."""

    def __call__(self, view_id: str, frame: Frame) -> tuple[str, str]:
        """Name inside the run folder, and SHA-256 of the file."""
        ...


class Verifier(Protocol):
    """Measures in a picture whether the promise was kept."""

    def __call__(self, view: PlannedView, captured: Captured) -> Verified:
        """From picture, plan and record only."""
        ...


@dataclass(frozen=True, eq=False)
class CellDevices:
    """The three devices and their clock.

    Attributes:
        simulated_roles: devices whose far end is a simulator of this cell.
        dumps: folder of the bytes that were written down after a fault.
    """

    arm: Arm
    lens: Lens
    camera: Camera
    clock: Clock
    simulated_roles: frozenset[str] = frozenset()
    dumps: Path | None = None

    @property
    def by_role(self) -> dict[str, Device]:
        """All three."""
        return {"arm": self.arm, "lens": self.lens, "camera": self.camera}

    def stop(self) -> list[Exception]:
        """Stop all three at once, from any thread; returns what failed, within 5 s.

        One that hangs keeps no other one waiting; it may still come to its end later.
        """
        return stop_all((self.arm, self.lens, self.camera), within_s=_STOP_S)


class CellEngine:
    """The engine of a cell; see ``mvp.cell.runner.Engine`` for its promises.

    Args:
        devices: opened devices.
        arrived: how far from a view each axis may stand, (dof,) rad or mm.
        settle_s: waits after arm and after lens.
        start_speed: share of full speed on the way to the first view.
        preflight: everything that must hold before the first motion.
        route: clear waypoints (k, dof) from where the arm stands to a view.
        calibrated: the camera's mode; None: any picture will do.
        still: compares two frames of every view; None: one is believed.
    """

    def __init__(
        self,
        devices: CellDevices,
        *,
        arrived: FloatArray,
        settle_s: tuple[float, float],
        start_speed: float = 1.0,
        preflight: Callable[[], None],
        route: Callable[[Sequence[float], PlannedView], Iterable[Sequence[float]]],
        exposure: ExposureRule,
        store: PictureStore,
        verifier: Verifier,
        calibrated: CameraCalibration | None = None,
        still: StillCheck | None = None,
    ) -> None:
        self._devices = devices
        self._arrived = arrived
        self._settle_s = settle_s
        self._speed = start_speed
        self._preflight = preflight
        self._route = route
        self._exposure = exposure
        self._store = store
        self._verifier = verifier
        self._calibrated = calibrated
        self._still = still
        self._frame: Frame | None = None
        self._stopped = threading.Event()
        self._stop_lock = threading.Lock()
        self._motion = ""
        self._arm_standing_s = 0.0
        self._lens_standing_s = 0.0

    def prepare(self) -> None:
        """Check everything; moves nothing."""
        self._preflight()
        _LOG.info("run: all checks before the first motion passed")

    def move(self, view: PlannedView) -> None:
        """Drive the arm to the view along the checked path and let it settle.

        Raises:
            DeviceError: refused, failed, stopped, or not where it was sent.
        """
        arm = self._devices.arm
        state = arm.state()
        for target in self._route(state.joints, view):
            expected_s = arm.duration_s(
                state.joints, target, speed_fraction=self._speed
            )
            timeout_s = 2 * expected_s + _ARM_SPARE_S
            self._motion = until(f"the arm on its way to {view.id}", timeout_s)
            _LOG.info(
                "%s: towards %s, asked %s, should take %.2f s",
                arm.name,
                view.id,
                _rounded(target),
                expected_s,
            )
            if self._stopped.is_set():
                raise MotionStopped("stopped before it moved", device=arm.name)
            state = arm.move_joints(
                target, speed_fraction=self._speed, timeout_s=timeout_s
            )
        self._check_arm(view, state)
        self._speed = 1.0
        _LOG.info(
            "%s: stands at %s, reached %s", arm.name, view.id, _rounded(state.joints)
        )
        self._motion = ""
        self._arm_standing_s = self._devices.clock.now_s()
        self._wait(self._settle_s[0], "arm")

    def adjust(self, view: PlannedView) -> None:
        """Set zoom, focus and iris, arriving from one side, and let them settle.

        Raises:
            DeviceError: refused, failed, stopped, or not where it was sent.
        """
        lens = self._devices.lens
        self._motion = until("the lens", 2 * _LENS_TIMEOUT_S)  # homing first
        if not lens.state().homed:
            _LOG.info("%s: homing", lens.name)
            lens.home(timeout_s=_LENS_TIMEOUT_S)
        steps = view.lens_steps
        _LOG.info("%s: towards %s, asked %s", lens.name, view.id, steps.model_dump())
        state = lens.move_steps(
            zoom=steps.zoom,
            focus=steps.focus,
            iris=steps.iris,
            timeout_s=_LENS_TIMEOUT_S,
        )
        self._check_lens(view, state)
        _LOG.info("%s: stands at %s, reached %s", lens.name, view.id, state.steps())
        self._motion = ""
        self._lens_standing_s = self._devices.clock.now_s()
        self._wait(self._settle_s[1], "lens")

    def capture(self, view: PlannedView) -> Captured:
        """Choose the exposure, take the picture, and put it on disk.

        Raises:
            DeviceError: no valid frame, or something moved meanwhile.
            OutputError: the disk does not take the picture.
        """
        self._frame = None
        exposure = self._exposure(view, self._shoot)
        metered = self._frame
        not_before_s = self._devices.clock.now_s()
        frame = self._shoot(exposure.exposure_s, exposure.gain)
        stillness = self._stillness(metered, frame)
        arm, lens = self._devices.arm.state(), self._devices.lens.state()
        self._check_arm(view, arm)
        self._check_lens(view, lens)
        if self._still is not None and stillness is not None:
            self._still.require(stillness, view=view.id, arm=self._devices.arm.name)
        image, sha256 = self._store(view.id, frame)
        self._log_kept(view, image, frame, exposure)
        return Captured(
            view=view.id,
            image=image,
            sha256=sha256,
            full_scale=frame.full_scale,
            exposure_s=frame.exposure_s,
            gain=frame.gain,
            exposure_source=exposure.source,
            frame_id=frame.frame_id,
            dropped=frame.dropped,
            device_time_ns=frame.device_time_ns,
            asked_joints=list(view.joints_rad),
            asked_lens_steps=view.lens_steps.model_dump(),
            reached=_reached(arm, lens),
            times=CaptureTimes(
                arm_standing_s=self._arm_standing_s,
                lens_standing_s=self._lens_standing_s,
                not_before_s=not_before_s,
                exposure_start_s=frame.exposure_start_s,
                received_s=frame.received_s,
            ),
            stillness=stillness,
        )

    def _log_kept(
        self, view: PlannedView, image: str, frame: Frame, exposure: Exposure
    ) -> None:
        _LOG.info(
            "%s: %s kept as %s, frame %d, exposure %.6f s (%s), gain %.2f, begun "
            "%.4f s after all stood",
            self._devices.camera.name,
            view.id,
            image,
            frame.frame_id,
            frame.exposure_s,
            exposure.source,
            frame.gain,
            frame.exposure_start_s - max(self._arm_standing_s, self._lens_standing_s),
        )

    def verify(self, view: PlannedView, captured: Captured) -> Verified:
        """Measure in the picture; never raises for a poor picture."""
        verified = self._verifier(view, captured)
        _LOG.info("%s: %s%s", view.id, verified.verdict, _because(verified))
        return verified

    def stop(self) -> Sequence[Exception]:
        """Stop all three devices, from any thread; every path is tried."""
        with self._stop_lock:
            first = not self._stopped.is_set()
            self._stopped.set()
        if first:
            _LOG.warning("stopping arm, lens and camera")
        return self._devices.stop()

    def may_still_move(self) -> str:
        """The motion that was under way, or nothing."""
        return self._motion

    def _shoot(self, exposure_s: float, gain: float) -> Frame:
        """One frame whose exposure begins after now."""
        camera = self._devices.camera
        frame = fresh_frame(
            camera, self._devices.clock, exposure_s=exposure_s, gain=gain
        )
        if self._calibrated is not None:
            require_size(frame, self._calibrated, camera.name)
        self._frame = frame
        return frame

    def _stillness(self, metered: Frame | None, frame: Frame) -> Stillness | None:
        """The picture beside another one: the last that metered, else one more."""
        if self._still is None:
            return None
        if metered is None or not self._still.comparable(metered, frame):
            metered = self._shoot(frame.exposure_s, frame.gain)
        return self._still.of(frame, metered, standing_s=self._arm_standing_s)

    def _wait(self, seconds: float, device: str) -> None:
        if self._devices.clock.wait(self._stopped, seconds):
            raise MotionStopped("stopped while settling", device=device)

    def _check_arm(self, view: PlannedView, state: ArmState) -> None:
        if state.fault:
            raise DeviceFault(
                f"{state.fault}, at {view.id}",
                device=self._devices.arm.name,
                hint="see to it; `mvp-cell recover CELL` walks the way back",
            )
        off = np.abs(np.subtract(state.joints, view.joints_rad))
        if not state.standing or (off > self._arrived).any():
            worst = float(off[int(np.argmax(off / self._arrived))])
            raise DeviceFault(
                f"does not stand at {view.id}: off by {worst:.4f} rad (or mm) on one axis"
                f"{'' if state.standing else ', still moving'}",
                device=self._devices.arm.name,
                hint="look for a protective stop or a collision before going on",
            )

    def _check_lens(self, view: PlannedView, state: LensState) -> None:
        asked, reached = view.lens_steps.model_dump(), state.steps()
        off = {a: reached[a] - asked[a] for a in asked if reached[a] != asked[a]}
        if not state.standing or off:
            raise DeviceFault(
                f"does not stand at {view.id}: off by {off or 0} steps"
                f"{'' if state.standing else ', still moving'}",
                device=self._devices.lens.name,
                hint="home the lens with `mvp-cell home CELL` and look for a slipping "
                "gear",
            )


def _rounded(joints: Sequence[float]) -> list[float]:
    """Joints for a log line, to 1e-5 rad or mm."""
    return [round(float(j), 5) for j in joints]


def _because(verified: Verified) -> str:
    return f", because {verified.cause}" if verified.cause else ""


def _reached(arm: ArmState, lens: LensState) -> Reached:
    return Reached(
        joints=[float(j) for j in arm.joints],
        base_from_tool=np.asarray(arm.base_from_tool, np.float64).tolist(),
        lens_steps=lens.steps(),
        position_is_estimated=lens.position_is_estimated,
    )
