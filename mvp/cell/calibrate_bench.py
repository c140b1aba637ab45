"""The cell as a calibration wizard sees it: stand, way, move, lens, picture.

Every motion goes along a way that was checked against part, fixtures, keep-outs, the
arm itself and the target, from where the arm stands at that moment.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.arrival import arrival_tolerance
from mvp.cell.calibrate_target import target_corners_mm, target_obstacle
from mvp.cell.calibrated_devices import require_size
from mvp.cell.fresh_frame import fresh_frame
from mvp.cell.lens_validity import require_held
from mvp.cell.locate_sights import TaskSights
from mvp.cell.standstill import UnderWay
from mvp.devices import DrivesStraight
from mvp.errors import DeviceFault, InfeasibleError, MotionStopped
from mvp.geometry import Pose
from mvp.kinematics import (
    NoPath,
    Placement,
    Unreachable,
    find_path,
    realisations,
)
from mvp.wizard import Refusal, Shot, Stand, Way

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.engine import CellDevices
    from mvp.cell.plan_job import Setting
    from mvp.devices import ArmState, Frame, Lens, LensState
    from mvp.geometry import FloatArray, TriangleMesh
    from mvp.kinematics import ArmModel, CellBodies
    from mvp.wizard import SessionFacts

_ARM_SPARE_S = 15.0
_LENS_TIMEOUT_S = 120.0
_PICTURE_SPARE_S = 30.0  # a camera that is simulated draws for seconds
_FIRST_GUESS_S = 0.01
_METERING_FRAMES = 8
_BRIGHT_PERCENTILE = 99.5
_WANTED_LEVEL, _GOOD_LEVELS = 0.8, (0.6, 0.92)
_SATURATED_LEVEL = 0.985
_DARK_LEVEL = 0.05


class CellBench:
    """See ``mvp.wizard.Bench``.

    Attributes:
        devices: opened; the arm knows where it is.
        under_way: the motion that was commanded last and is not confirmed.

    Args:
        setting: the cell with its bodies.
        devices: as the attribute.
        facts: of the session.
        start_speed: share of full speed until the first place is reached.
    """

    def __init__(
        self,
        setting: Setting,
        devices: CellDevices,
        facts: SessionFacts,
        *,
        start_speed: float,
    ) -> None:
        self.devices = devices
        self.under_way = UnderWay()
        self._setting = setting
        self._facts = facts
        self._speed = start_speed
        self._stopped = threading.Event()
        self._arrived = arrival_tolerance(setting.cell.arm.joint_units)
        self._ways: dict[bytes, Way] = {}
        self._exposure_s = _FIRST_GUESS_S
        self._asked_joints: FloatArray | None = None
        self._asked_steps: dict[str, int] | None = None
        self._engaged_steps: dict[str, int] | None = None
        self._standing_s = {"arm": 0.0, "lens": 0.0}

    @property
    def facts(self) -> SessionFacts:
        """What is known and believed before the first picture."""
        return self._facts

    @property
    def arm(self) -> ArmModel:
        """Kinematics."""
        return self._setting.cell.arm

    @property
    def part(self) -> TriangleMesh:
        """The task's part, part frame."""
        return self._setting.scene.scene.part

    @cached_property
    def sights(self) -> TaskSights:
        """The task's part as it can be looked at; see ``Bench``."""
        return TaskSights(self._setting, self._facts)

    def rng(self, number: int) -> np.random.Generator:
        """Randomness of the session's seed and a number."""
        return np.random.default_rng([self._facts.seed, number])

    def stop(self) -> list[Exception]:
        """Stop all devices and refuse every further motion; from any thread."""
        self._stopped.set()
        return self.devices.stop()

    # ------------------------------------------------------------ where to

    @cached_property
    def _bodies(self) -> CellBodies:
        """Arm, part, fixtures, keep-outs and the target's board."""
        bodies = self._setting.arm.bodies
        board = target_obstacle(self._facts)
        return replace(bodies, obstacles=(*bodies.obstacles, *board))

    def standing(self) -> Stand:
        """Where the arm stands now."""
        return _stand(self.devices.arm.state())

    def joints_for(self, base_from_camera: Pose, *, d_mm: float) -> Stand | Refusal:
        """Where the arm must stand for a camera pose; see ``Bench``."""
        asked = Pose(
            "part", "camera", base_from_camera.rotation, base_from_camera.translation_mm
        )
        if not self._in_workspace(asked.translation_mm):
            return Refusal("the camera would leave the workspace")
        free_roll = self.arm.dictates_roll  # then it gives the roll that it can
        found = realisations(self._placement(d_mm), asked, free_roll=free_roll)
        if isinstance(found, Unreachable):
            return Refusal(found.reason)
        return Stand(found[0].joints, found[0].base_from_tool)

    def _placement(self, d_mm: float) -> Placement:
        """In base axes: the part frame of ``Placement`` is the base here."""
        cell = self._setting.cell
        return Placement(
            self._bodies,
            Pose.identity("base", "part"),
            self._facts.tool_from_camera(d_mm),
            cell.joint_margin,
            clearance_mm=self._setting.arm.clearance_mm,
            reference=np.asarray(self.devices.arm.state().joints, np.float64),
            targets_part_mm=self._looked_at_mm(),
            singularity_margin=cell.config.kinematics.singularity_margin,
        )

    def _looked_at_mm(self) -> FloatArray:
        """What the arm must not hide, base frame: the part's features or the target."""
        if self._facts.key != "part":
            return target_corners_mm(self._facts)
        features = self._setting.scene.scene.features
        points = np.concatenate([f.key_points_mm for f in features])
        return self._facts.base_from_part.apply(points)

    def _in_workspace(self, point_mm: FloatArray) -> bool:
        low, high = self._facts.workspace_low_mm, self._facts.workspace_high_mm
        return bool(((point_mm >= low) & (point_mm <= high)).all())

    def way_to(self, joints: FloatArray) -> Way | Refusal:
        """A clear way there from where the arm stands now; see ``Bench``."""
        here = np.asarray(self.devices.arm.state().joints, np.float64)
        goal = np.asarray(joints, np.float64)
        key = here.tobytes() + goal.tobytes()
        if key not in self._ways:
            path = find_path(
                self._bodies,
                here,
                goal,
                home=np.asarray(self._setting.cell.home_joints, np.float64),
                required_mm=self._setting.arm.clearance_mm,
            )
            if isinstance(path, NoPath):
                return Refusal(path.reason)
            self._ways = {key: self._timed(path.waypoints)}
        return self._ways[key]

    def _timed(self, waypoints: FloatArray) -> Way:
        legs = zip(waypoints[:-1].tolist(), waypoints[1:].tolist(), strict=True)
        arm, speed = self.devices.arm, self._speed
        seconds = sum(arm.duration_s(a, b, speed_fraction=speed) for a, b in legs)
        return Way(waypoints[1:], float(seconds))

    # ------------------------------------------------------------ motion

    def move(self, joints: FloatArray) -> Stand:
        """Move there along a clear way and let the arm settle; see ``Bench``."""
        way = self.way_to(joints)
        if isinstance(way, Refusal):
            raise InfeasibleError(
                f"the arm cannot go there: {way.reason}",
                hint="move the arm by hand to a free place, or give it more room",
                where="arm",
            )
        arm = self.devices.arm
        state = arm.state()
        for target in way.waypoints.tolist():
            self._go_on("arm")
            expected_s = arm.duration_s(
                state.joints, target, speed_fraction=self._speed
            )
            timeout_s = 2 * expected_s + _ARM_SPARE_S
            with self.under_way.moving("the arm on its way", timeout_s):
                state = arm.move_joints(
                    target, speed_fraction=self._speed, timeout_s=timeout_s
                )
        self._asked_joints = np.asarray(joints, np.float64)
        self._check_arm(state)
        self._speed = 1.0
        self._settle("arm", self._setting.cell.config.settle.arm_s)
        return _stand(state)

    @property
    def drives_straight(self) -> bool:
        """The lens can be driven without a run-up."""
        return isinstance(self.devices.lens, DrivesStraight)

    def set_lens(
        self, *, zoom: int, focus: int, iris: int, straight: bool = False
    ) -> None:
        """Set the lens and let it settle; see ``Bench``."""
        lens = self.devices.lens
        wanted = {"zoom": zoom, "focus": focus, "iris": iris}
        if not straight:
            require_held(self._facts, wanted)
        self._go_on("lens")
        state = lens.state()
        if not state.homed:
            with self.under_way.moving("the lens, homing", _LENS_TIMEOUT_S):
                lens.home(timeout_s=_LENS_TIMEOUT_S)
        elif not straight and state.steps() == wanted == self._engaged_steps:
            return
        self._go_on("lens")
        lens.check_steps(zoom=zoom, focus=focus, iris=iris)
        move = _straight_move(lens) if straight else lens.move_steps
        with self.under_way.moving("the lens", _LENS_TIMEOUT_S):
            state = move(zoom=zoom, focus=focus, iris=iris, timeout_s=_LENS_TIMEOUT_S)
        self._asked_steps = wanted
        self._engaged_steps = None if straight else wanted
        self._check_lens(state)
        self._settle("lens", self._setting.cell.config.settle.lens_s)

    def _go_on(self, device: str) -> None:
        if self._stopped.is_set():
            raise MotionStopped("stopped before it moved", device=device)

    def _settle(self, device: str, seconds: float) -> None:
        self._standing_s[device] = self.devices.clock.now_s()
        if self.devices.clock.wait(self._stopped, seconds):
            raise MotionStopped("stopped while settling", device=device)

    def _check_arm(self, state: ArmState) -> None:
        name = self.devices.arm.name
        if state.fault:
            raise DeviceFault(
                state.fault,
                device=name,
                hint="see to it; `mvp-cell recover CELL` walks the way back",
            )
        asked = state.joints if self._asked_joints is None else self._asked_joints
        off = np.abs(np.subtract(state.joints, asked))
        if not state.standing or (off > self._arrived).any():
            raise DeviceFault(
                f"does not stand where it was sent: off by {off.max():.4f} rad (or mm)",
                device=name,
                hint="look for a protective stop or a collision before going on",
            )

    def _check_lens(self, state: LensState) -> None:
        asked = self._asked_steps or state.steps()
        if not state.standing or state.steps() != asked:
            raise DeviceFault(
                f"stands at {state.steps()}, not at {asked}",
                device=self.devices.lens.name,
                hint="home the lens with `mvp-cell home CELL` and look for a slipping "
                "gear",
            )

    # ------------------------------------------------------------ pictures

    def shoot(self, exposure_s: float | None = None) -> Shot:
        """One picture with everything standing; see ``Bench``."""
        if exposure_s is not None:
            return self._shot(self._frame(exposure_s))
        low, high = self.devices.camera.exposure_range_s()
        for _ in range(_METERING_FRAMES):
            asked_s = float(np.clip(self._exposure_s, low, high))
            frame = self._frame(asked_s)
            level = float(
                np.percentile(frame.pixels[::2, ::2], _BRIGHT_PERCENTILE)
                / frame.full_scale
            )
            if _GOOD_LEVELS[0] <= level <= _GOOD_LEVELS[1]:
                return self._shot(frame)
            self._exposure_s = float(np.clip(asked_s * _factor(level), low, high))
            if self._exposure_s == asked_s and level >= _DARK_LEVEL:
                if level < _SATURATED_LEVEL:
                    return self._shot(frame)
                break
        raise DeviceFault(
            f"no exposure between {low:g} and {high:g} s suits the light",
            device=self.devices.camera.name,
            hint="change the light, or the iris of the lens",
        )

    def _frame(self, exposure_s: float) -> Frame:
        """One frame whose exposure begins after now."""
        self._go_on("camera")
        camera = self.devices.camera
        frame = fresh_frame(
            camera,
            self.devices.clock,
            exposure_s=exposure_s,
            spare_s=_PICTURE_SPARE_S,
        )
        require_size(frame, self._facts.camera, camera.name)
        return frame

    def _shot(self, frame: Frame) -> Shot:
        """The frame with what stood still, looked at once more."""
        arm, lens = self.devices.arm.state(), self.devices.lens.state()
        self._check_arm(arm)
        self._check_lens(lens)
        stand = _stand(arm)
        return Shot(
            frame.pixels,
            frame.full_scale,
            frame.exposure_s,
            frame.gain,
            stand.joints,
            stand.base_from_tool,
            lens.steps(),
            {
                "arm_standing": self._standing_s["arm"],
                "lens_standing": self._standing_s["lens"],
                "exposure_start": frame.exposure_start_s,
                "received": frame.received_s,
            },
            settled=arm.standing and lens.standing,
            frame_id=frame.frame_id,
        )


def _straight_move(lens: Lens) -> Callable[..., LensState]:
    """How a lens is driven without a run-up.

    Raises:
        DeviceFault: it cannot be.
    """
    if not isinstance(lens, DrivesStraight):
        raise DeviceFault(
            "cannot be driven without a run-up",
            device=lens.name,
            hint="its driver must offer move_steps_straight",
        )
    return lens.move_steps_straight


def _factor(level: float) -> float:
    """On the exposure; a saturated picture tells only that it is too bright."""
    if level >= _SATURATED_LEVEL:
        return 0.25
    return float(np.clip(_WANTED_LEVEL / max(level, 1e-3), 0.1, 20.0))


def _stand(state: ArmState) -> Stand:
    tool = Pose.from_matrix("base", "tool", np.asarray(state.base_from_tool))
    return Stand(np.asarray(state.joints, np.float64), tool)
