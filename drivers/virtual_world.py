"""The one owner of truth of a simulated cell.

Bodies, light, camera, lens, hand-eye, part pose, and the history of arm and lens. Drivers
tell it what their motors do and ask it for pictures; planner and wizards never see it.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from drivers.virtual_arm_truth import ringing, still_rings, true_flange, true_joints
from drivers.virtual_bodies import true_bodies, true_target
from drivers.virtual_lens_truth import LensTruth
from drivers.virtual_light import true_light
from drivers.virtual_motion import History, StraightMove
from drivers.virtual_sensor import smear_instants, true_hand_eye, true_intrinsics
from drivers.virtual_settings import Faults, VectorOrLength, WorldErrors, WorldSettings
from drivers.virtual_tracks import Track
from mvp.errors import ConfigError
from mvp.geometry import FloatArray, Pose, unit
from mvp.imaging import (
    LensState,
    RenderBody,
    RenderedImage,
    RenderScene,
    SensorNoise,
    expose,
    render,
    render_moving,
)
from mvp.kinematics import arm_model

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from mvp.devices import Axis, Clock, DeviceContext, WorldBelief
    from mvp.imaging import Illumination
    from mvp.optics import Intrinsics, LensSetting

_KEPT_PICTURES = 2


@dataclass(frozen=True, eq=False)
class WorldState:
    """Everything that moves, at one moment.

    Attributes:
        t_s: the moment, on the world's clock.
        joints: (dof,) true joints.
        base_from_camera: true entrance pupil.
        lens: true lens setting.
    """

    t_s: float
    joints: FloatArray
    base_from_camera: Pose
    lens: LensSetting


class VirtualWorld:
    """Truth of a virtual cell; safe to use from several threads."""

    Config = WorldSettings

    def __init__(
        self, settings: WorldSettings, belief: WorldBelief, *, clock: Clock
    ) -> None:
        self.clock = clock
        self.model = arm_model(belief.arm_model)
        self.belief = belief
        self._settings = settings
        self._lock = threading.RLock()
        self._errors = settings.errors
        self._faults = settings.faults
        self._targets = tuple(true_target(target) for target in settings.targets)
        self._scene: RenderScene | None = None
        self._pictures: dict[bytes, RenderedImage] = {}
        self.arm = History(np.array(belief.start_joints, dtype=np.float64))
        self._arm_track: Track | None = None
        tube = belief.mounted_tube_mm if settings.tube_mm is None else settings.tube_mm
        self.lens = LensTruth.of(belief.lens_table, tube_mm=tube)
        if len(self.arm.first) != self.model.dof:
            raise ConfigError(
                f"{belief.arm_model} has {self.model.dof} axes, "
                f"home_joints_deg has {len(self.arm.first)}",
                hint="give one value per axis in [kinematics] home_joints_deg",
            )

    @classmethod
    def from_config(
        cls, config: WorldSettings, belief: WorldBelief, *, clock: Clock
    ) -> Self:
        """Build the truth of a cell from its description and the configured errors."""
        return cls(config, belief, clock=clock)

    # What can be changed while it runs (tests, demonstrations).

    @property
    def faults(self) -> Faults:
        """What is made to go wrong now."""
        with self._lock:
            return self._faults

    def inject(self, faults: Faults) -> None:
        """Make things go wrong from now on, instead of what did before."""
        with self._lock:
            self._faults = faults
            self._forget()

    def change_truth(self, errors: WorldErrors) -> None:
        """Give the truth other errors."""
        with self._lock:
            self._errors = errors
            self._forget()

    def place_targets(self, targets: tuple[RenderBody, ...]) -> None:
        """Put these targets (base frame) into the scene, in place of the others."""
        with self._lock:
            self._targets = targets
            self._forget()

    def mount_tube(self, tube_mm: float) -> None:
        """Put an extension tube of this length behind the lens; 0 takes it off."""
        with self._lock:
            self.lens.mount_tube(tube_mm)

    def _forget(self) -> None:
        self._scene = None
        self._pictures.clear()

    # Motion of the arm; the lens has its own truth.

    def begin_arm(
        self, target: FloatArray, *, speed_fraction: float, t_s: float
    ) -> float:
        """Start a straight joint motion; returns when it will end, s."""
        with self._lock:
            move = StraightMove.limited(
                self.arm.at(t_s),
                np.asarray(target, dtype=np.float64),
                speed=self.model.joint_speed * speed_fraction,
                acceleration=self.model.joint_acceleration,
            )
            self.arm.begin(move, t_s)
            self._interrupt(t_s)
            return self.arm.end_s

    def _interrupt(self, t_s: float) -> None:
        """Cut the motion short where a fault says so."""
        faults = self._faults.arm
        for after in (faults.protective_stop_after_s, faults.stall_after_s):
            if after is not None:
                self.arm.halt(t_s + after)

    def stop_arm(self, t_s: float) -> float:
        """Brake now; returns when it stands, s."""
        with self._lock:
            self.arm.halt(t_s)
            return self.arm.end_s

    def report_arm(self, t_s: float, joints: Sequence[float]) -> None:
        """Take over where a simulator says that its arm is: (dof,) rad or mm."""
        place = np.asarray(joints, dtype=np.float64)
        if place.shape != (self.model.dof,) or not np.isfinite(place).all():
            raise ValueError(f"{self.model.name} has {self.model.dof} finite joints")
        with self._lock:
            if self._arm_track is None:
                self._arm_track = Track(self.arm.first)
            self._arm_track.report(t_s, place)

    def report_lens(self, t_s: float, steps: Mapping[str, float]) -> None:
        """Take over where a simulator says that its motors are, steps."""
        with self._lock:
            self.lens.report(t_s, steps)

    @property
    def _arm_history(self) -> History | Track:
        return self._arm_track or self.arm

    def arm_end_s(self) -> float:
        """When the last motion of the arm ends or ended, s."""
        with self._lock:
            return self._arm_history.end_s

    def arm_joints(self, t_s: float) -> FloatArray:
        """What the encoders say at a moment (dof,)."""
        with self._lock:
            return self._arm_history.at(t_s)

    def arm_standing(self, t_s: float) -> bool:
        """Whether the arm stands still at a moment."""
        with self._lock:
            return t_s >= self._arm_history.end_s

    def begin_lens(
        self,
        points: dict[Axis, tuple[float, ...]],
        rates: dict[Axis, float],
        t_s: float,
    ) -> float:
        """Drive the motors through points; returns when the last one stands, s."""
        with self._lock:
            return self.lens.begin(points, rates, t_s, self._faults.lens)

    def stop_lens(self, t_s: float) -> None:
        """Stop the motors dead."""
        with self._lock:
            self.lens.halt(t_s)

    def lens_motors(self, t_s: float) -> dict[Axis, float]:
        """Where the motors are at a moment, steps."""
        with self._lock:
            return self.lens.motors(t_s)

    def lens_standing(self, t_s: float) -> bool:
        """Whether all motors stand still at a moment."""
        with self._lock:
            return t_s >= self.lens.end_s

    # Truth at a moment.

    def state(self, t_s: float) -> WorldState:
        """Where everything is at a moment, also in the past."""
        with self._lock:
            errors, seed = self._errors, self._settings.seed
            faults = self._faults
            joints = true_joints(self.model, self._arm_history.at(t_s), errors)
            lens = self.lens.setting(t_s, errors, faults.lens)
            swing = ringing(faults.arm, t_s - self._arm_history.end_s)
        tool = true_flange(self.model, joints, errors, seed) @ swing
        camera = tool @ self.tool_from_camera(lens.d_mm, lens.f_mm)
        return WorldState(t_s, joints, camera, lens)

    def tool_from_camera(self, d_mm: float, f_mm: float | None = None) -> Pose:
        """The true hand-eye transform at d; without f the pupil follows d alone."""
        errors = self._errors
        moved = true_hand_eye(self.belief, self.lens.table, d_mm, f_mm)
        return moved @ self._small("camera", errors.hand_eye_deg, errors.hand_eye_mm)

    @property
    def base_from_part(self) -> Pose:
        """Where the part truly lies."""
        errors = self._errors
        moved = self._small("part", errors.part_deg, errors.part_mm)
        return self.belief.base_from_part @ moved

    def _small(self, frame: str, turn: VectorOrLength, shift: VectorOrLength) -> Pose:
        """A configured error; a length alone points where the seed says."""
        directions = np.random.default_rng(self._settings.seed).normal(size=(2, 3))
        turn_deg, shift_mm = (
            unit(way) * value if isinstance(value, float) else np.array(value)
            for way, value in zip(directions, (turn, shift), strict=True)
        )
        return Pose.from_rotvec(frame, frame, np.radians(turn_deg), shift_mm)

    @property
    def temperature_c(self) -> float | None:
        """How warm the lens is; None where nobody says."""
        return self._settings.temperature_c

    @property
    def intrinsics(self) -> Intrinsics:
        """The true sensor, principal point and distortion, unless the zoom changes it."""
        return self._intrinsics_at(None)

    def _intrinsics_at(self, lens: LensSetting | None) -> Intrinsics:
        return true_intrinsics(self.belief.camera, self._errors, lens)

    @property
    def light(self) -> Illumination:
        """Lamps that travel with the camera, and the ambient part."""
        errors = self._errors
        moved = self._small("camera", 0.0, errors.lamps_mm).translation_mm
        return true_light(self.belief.light, self._settings.light, errors, moved)

    def bodies(self) -> tuple[RenderBody, ...]:
        """Everything that can be seen, with its albedo."""
        with self._lock:
            errors, faults, targets = self._errors, self._faults, self._targets
        own = true_bodies(
            self.belief, self.base_from_part, self._settings, errors, faults.occluders
        )
        return (*own, *targets)

    def frame_size(self) -> tuple[int, int]:
        """Columns and rows of a picture."""
        return self.belief.camera.width_px, self.belief.camera.height_px

    def draw_ahead(self) -> None:
        """Make ready what is otherwise made with the first picture."""
        self._ready_scene().make_ready()

    def frame(
        self, start_s: float, exposure_s: float, *, gain: float = 1.0, index: int = 0
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """What the sensor delivers for an exposure; the noise depends on the index.

        Motion during the exposure smears the picture.
        """
        picture = self.picture(start_s, exposure_s)
        sensor = self._settings.sensor
        noise = SensorNoise(
            sensor.full_well_e / gain,
            sensor.read_noise_e,
            full_wells_per_s=sensor.full_wells_per_s * gain,
        )
        # A print's border may be drawn a little below black.
        picture = replace(picture, grey=np.maximum(picture.grey, 0))
        rng = np.random.default_rng([self._settings.seed, index])
        return expose(
            picture, exposure_s, sensor=noise, rng=rng if sensor.noise else None
        )

    def picture(self, start_s: float, exposure_s: float) -> RenderedImage:
        """The light on the sensor, averaged over the exposure."""
        end_s = start_s + exposure_s
        with self._lock:
            moving = self._arm_history.moving_between(start_s, end_s)
            moving |= self.lens.moving_between(start_s, end_s)
            moving |= still_rings(self._faults.arm, end_s - self._arm_history.end_s)
        if not moving:
            return self._render(self.state(start_s))
        count = self._instants(self.state(start_s), self.state(end_s))
        shares = (np.arange(count) + 0.5) / count
        states = [self.state(start_s + share * exposure_s) for share in shares]
        lenses = [state.lens for state in states]
        return render_moving(
            self._ready_scene(),
            [state.base_from_camera for state in states],
            lens=[LensState(one.d_mm, one.f_mm, one.a_mm, one.e_mm) for one in lenses],
            intrinsics=self._intrinsics_at(lenses[0]),
            light=self.light,
        )

    def _instants(self, first: WorldState, last: WorldState) -> int:
        """How many still pictures make a smooth smear."""
        return smear_instants(
            (first.base_from_camera, last.base_from_camera),
            self.base_from_part.apply(self.belief.part.bounds.centre_mm),
            scale_px=first.lens.d_mm / self.intrinsics.sensor.pitch_x_mm,
            most=self._settings.smear_instants,
        )

    def _ready_scene(self) -> RenderScene:
        with self._lock:
            if self._scene is None:
                self._scene = RenderScene(self.bodies())
            return self._scene

    def _render(self, state: WorldState) -> RenderedImage:
        """One still picture; the last few are kept."""
        lens = state.lens
        intrinsics = self._intrinsics_at(lens)
        key = np.concatenate(
            [
                state.base_from_camera.matrix.ravel(),
                [lens.d_mm, lens.f_mm, lens.a_mm, lens.e_mm, intrinsics.k1],
                [intrinsics.centre_x_px, intrinsics.centre_y_px],
            ]
        ).tobytes()
        with self._lock:
            if key in self._pictures:
                return self._pictures[key]
            picture = render(
                self._ready_scene(),
                state.base_from_camera,
                d_mm=lens.d_mm,
                f_mm=lens.f_mm,
                a_mm=lens.a_mm,
                e_mm=lens.e_mm,
                intrinsics=intrinsics,
                light=self.light,
            )
            while len(self._pictures) >= _KEPT_PICTURES:
                self._pictures.pop(next(iter(self._pictures)))
            self._pictures[key] = picture
            return picture


def world_of(context: DeviceContext, name: str) -> VirtualWorld:
    """The virtual world of a context.

    Raises:
        ConfigError: the cell has no virtual world.
    """
    if not isinstance(context.world, VirtualWorld):
        raise ConfigError(
            f"{name}: a virtual device needs a virtual world",
            hint='add [world] with kind = "virtual" and simulated = true to the cell',
            where=name,
        )
    return context.world
