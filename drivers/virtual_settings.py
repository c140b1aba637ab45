"""What ``[world]`` of a virtual cell may say: errors of the truth, light, faults."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from mvp.calibrated import TargetPrint
from mvp.fileedge import FileModel

Vector: TypeAlias = tuple[float, float, float]
VectorOrLength: TypeAlias = Vector | float
Positive: TypeAlias = Annotated[float, Field(gt=0)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0)]
AxisName: TypeAlias = Literal["zoom", "focus", "iris"]


class MovedVertex(FileModel):
    """A corner of the true part that is not where CAD says."""

    at_mm: Vector
    by_mm: Vector


class WorldErrors(FileModel):
    """Truth minus belief. All zero: calibration is perfect.

    ``hand_eye_*`` in the camera frame, ``part_*`` in the part frame: a shift or rotation
    vector (deg), or its length alone, when the world's seed chooses the direction;
    ``part_scale`` about the part's origin; fractions of f and a; ``focus_d_mm`` added
    to d; ``lamps_mm`` moves all lamps but a ring on the lens, in the camera frame;
    ``light_fraction`` dims or raises all light; ``ambient`` is added. ``arm_mm`` and
    ``arm_deg``: how far the flange is off what the arm reports, one standard deviation
    for each axis; it changes smoothly with the joints and is the same whenever the arm
    comes back.
    """

    hand_eye_mm: VectorOrLength = 0.0
    hand_eye_deg: VectorOrLength = 0.0
    part_mm: VectorOrLength = 0.0
    part_deg: VectorOrLength = 0.0
    lamps_mm: VectorOrLength = 0.0
    light_fraction: float = Field(default=0.0, gt=-1, lt=10)
    ambient: float = 0.0
    part_scale: Positive = 1.0
    moved_vertices: list[MovedVertex] = Field(default_factory=list)
    arm_joints_deg: list[float] = Field(default_factory=list)
    arm_mm: NotNegative = 0.0
    arm_deg: NotNegative = 0.0
    focus_d_mm: float = 0.0
    zoom_fraction: float = Field(default=0.0, gt=-0.5, lt=0.5)
    a_fraction: float = Field(default=0.0, gt=-0.9, lt=4.0)
    pupil_offset_mm: float = 0.0
    centre_px: tuple[float, float] = (0.0, 0.0)
    k1: float = 0.0


class LampSettings(FileModel):
    """A lamp that travels with the camera; the origin stands for the ring light."""

    position_mm: Vector
    strength: NotNegative


class LightSettings(FileModel):
    """True light, whatever the cell believes; a ring and one oblique lamp."""

    ambient: NotNegative = 0.05
    lamps: list[LampSettings] = Field(
        default_factory=lambda: [
            LampSettings(position_mm=(0.0, 0.0, 0.0), strength=0.3),
            LampSettings(position_mm=(-150.0, -110.0, 20.0), strength=0.6),
        ]
    )
    gloss: NotNegative = 0.1


class SensorSettings(FileModel):
    """How light becomes grey."""

    noise: bool = True
    full_well_e: Positive = 10_000.0
    read_noise_e: NotNegative = 8.0
    full_wells_per_s: Positive = 16_000.0


class Occluder(FileModel):
    """A box that nobody knows of, in the part frame."""

    name: str = "stray box"
    low_mm: Vector
    high_mm: Vector
    albedo: float = Field(default=0.3, ge=0, le=1)


class ArmFaults(FileModel):
    """Times count from the start of a motion.

    ``ring_mm``: how far the flange swings, unseen by the encoders, from the moment they
    stand; it dies away in ``ring_decay_s`` to 37 %. Up to then the arm is stiff.
    """

    unreachable: bool = False
    ring_mm: NotNegative = 0.0
    ring_hz: Positive = 7.0
    ring_decay_s: Positive = 0.5
    protective_stop_after_s: float | None = Field(default=None, ge=0)
    stall_after_s: float | None = Field(default=None, ge=0)


class LensFaults(FileModel):
    """``lost_steps``: the axis stands that far from its counter, unnoticed."""

    unreachable: bool = False
    stall: AxisName | None = None
    loses_home: bool = False
    lost_steps: dict[AxisName, int] = Field(default_factory=dict)
    backlash_steps: dict[AxisName, NotNegative] = Field(default_factory=dict)


class CameraFaults(FileModel):
    """``stale_frames``: old frames that wait in the queue at every capture.

    ``stamp_ahead_s``: time stamps that lie, later than the light was collected.
    ``exposure_factor``: exposes so many times longer than it says.
    ``read_back_factor``: says so many times the exposure asked for.
    """

    unreachable: bool = False
    dead_after_frames: int | None = Field(default=None, ge=0)
    drop_every: int | None = Field(default=None, ge=1)
    stale_frames: int = Field(default=0, ge=0)
    stamp_ahead_s: NotNegative = 0.0
    exposure_factor: Positive = 1.0
    read_back_factor: Positive = 1.0


class Faults(FileModel):
    """Everything that can be made to go wrong."""

    arm: ArmFaults = Field(default_factory=ArmFaults)
    lens: LensFaults = Field(default_factory=LensFaults)
    camera: CameraFaults = Field(default_factory=CameraFaults)
    occluders: list[Occluder] = Field(default_factory=list)


class TargetSettings(TargetPrint):
    """A printed target that truly lies in the cell; the pose is ``base_from_target``.

    Target frame: x right, y down, z into the board for somebody who looks at it; a
    ChArUco board's origin is its outer corner, that of the others their first point.
    ``rotation_deg`` is a rotation vector.
    """

    position_mm: Vector
    rotation_deg: Vector


class WorldSettings(FileModel):
    """The keys of ``[world]`` beside ``kind``, ``clock_speed`` and ``truth``.

    ``tube_mm``: the extension tube that is truly on the lens; left out, the one that
    the cell names. ``smear_instants``: most still pictures that make up one picture
    taken in motion; fewer are faster and coarser. ``light``: left out, the light that the cell states in its own
    ``[light]``, or the default where it states none; ``errors`` change it.
    ``temperature_c``: of the lens; left out, its driver cannot tell.
    """

    seed: int = Field(default=1, ge=0)
    part_albedo: float = Field(default=0.8, gt=0, le=1)
    fixture_albedo: float = Field(default=0.4, gt=0, le=1)
    tube_mm: NotNegative | None = None
    smear_instants: int = Field(default=41, ge=1, le=1000)
    errors: WorldErrors = Field(default_factory=WorldErrors)
    light: LightSettings | None = None
    sensor: SensorSettings = Field(default_factory=SensorSettings)
    faults: Faults = Field(default_factory=Faults)
    targets: list[TargetSettings] = Field(default_factory=list)
    temperature_c: float | None = None
