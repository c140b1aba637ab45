"""What ``cell.toml`` may say. Shape only; each driver checks its own keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from mvp.calibrated import LensGrid, TargetPrint
from mvp.cell.light_config import LightConfig
from mvp.cell.values import (
    Name,
    NotNegative,
    Point,
    Positive,
    check_corners,
)
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from mvp.devices import Role


class DriverRef(BaseModel):
    """A device: its driver, and keys that only the driver understands."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)

    driver: str = Field(min_length=1, description="a key of `mvp-cell drivers`")

    @property
    def options(self) -> dict[str, object]:
        """The driver's own keys."""
        return dict(self.model_extra or {})


class WorldRef(BaseModel):
    """The truth behind a simulated cell; further keys are the world's own."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)

    kind: str = Field(min_length=1)
    clock_speed: float = Field(default=1.0, gt=0, le=1000)
    truth: str | None = Field(
        default=None,
        min_length=1,
        description="folder beside the cell file with camera.json, lens_table.json, "
        "hand_eye.json and part_pose.json as they truly are; left out, what the cell "
        "believes is true",
    )

    @property
    def options(self) -> dict[str, object]:
        """The world's own keys."""
        return dict(self.model_extra or {})


class SimulatorRef(BaseModel):
    """A simulated far end; further keys are the simulator's own."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)

    kind: str = Field(min_length=1)

    @property
    def options(self) -> dict[str, object]:
        """The simulator's own keys."""
        return dict(self.model_extra or {})


class Simulators(FileModel):
    """Far ends of the wires, started with the cell; a device needs its real driver."""

    arm: SimulatorRef | None = None
    lens: SimulatorRef | None = None
    camera: SimulatorRef | None = None

    @property
    def by_role(self) -> dict[Role, SimulatorRef]:
        """Those that there are."""
        found: dict[Role, SimulatorRef | None] = {
            "arm": self.arm,
            "lens": self.lens,
            "camera": self.camera,
        }
        return {role: one for role, one in found.items() if one is not None}


class MotionConfig(FileModel):
    """How carefully a run begins."""

    start_speed_fraction: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.25,
        description="of full speed, until the first view is reached; virtual cells "
        "move at full speed",
    )


class ToolBody(FileModel):
    """A capsule fixed to the flange, in the tool frame."""

    name: Name
    from_mm: Point
    to_mm: Point
    radius_mm: Positive


class KinematicsConfig(FileModel):
    """Which arm it is, and what it carries."""

    model: str = Field(min_length=1)
    joint_margin_deg: NotNegative = 3.0
    home_joints_deg: list[float] = Field(
        default_factory=list,
        description="deg for turning axes, mm for sliding axes",
    )
    clearance_mm: NotNegative = 5.0
    singularity_margin: NotNegative = Field(
        default=0.0,
        description="smallest singular value of the arm's Jacobian, lengths over 500 mm; "
        "0 asks nothing, 0.02 keeps some degrees away",
    )
    dh_calibration: str | None = Field(
        default=None,
        description="factory calibration of this very robot: calibration.conf of its "
        "controller, the yaml file of the ROS driver, or a TOML file with [dh]",
    )
    tool_bodies: list[ToolBody] = Field(default_factory=list)


class CalibrationFiles(FileModel):
    """Files of ``mvp-cell calibrate``, relative to the cell's folder."""

    camera: str
    lens_table: str
    hand_eye: str
    part_pose: str


class OpticsConfig(FileModel):
    """What counts as sharp, and what is in the drawer."""

    blur_circle_um: Positive
    extension_tubes_mm: list[Positive] = Field(default_factory=list)
    mounted_tube_mm: NotNegative = 0.0
    wavelength_nm: Positive = 550.0


class UncertaintyConfig(FileModel):
    """One standard deviation each.

    ``robot_position_mm`` and ``robot_angle_deg``: how far the flange may be off the pose
    that the arm reports, for each axis, from one place to another (not the repeatability
    of one place, which is several times smaller); calibrations weigh the arm by it.
    """

    position_mm: Positive = 1.0
    angle_deg: Positive = 0.3
    f_mm: Positive = 0.0125
    d_mm: Positive = 0.01
    a_mm: Positive = 0.008
    robot_position_mm: Positive = 0.1
    robot_angle_deg: Positive = 0.02


class TargetConfig(TargetPrint):
    """The printed calibration target, and roughly where it lies.

    Target frame: x right, y down, z into the board for somebody who looks at it; a
    ChArUco board's origin is its outer corner, that of the others their first point.
    ``position_mm`` and ``rotation_deg`` (a rotation vector) place it in the base frame,
    with one standard deviation for each axis. ``square_sigma_mm``: of a square as
    measured with a caliper; left out, 0.2 % of it, which is what printers reach.
    ``flat_sigma_mm``: how far the middle may lie off the plane of the ends (glass 0.01 to
    0.05); left out, 0.5 % of its length, which is what a print on something nearly flat
    reaches. Camera and lens wizards find the rest in the pictures.
    """

    square_sigma_mm: Positive | None = None
    position_mm: Point
    rotation_deg: Point
    position_sigma_mm: Positive = 5.0
    angle_sigma_deg: Positive = 2.0
    flat_sigma_mm: Positive | None = None


class PartPlacement(FileModel):
    """How far a part may lie from where ``part_pose`` says; ``run --locate`` finds it.

    Clear ways and views are sought for the expected place first; a part that lies
    farther off was put down wrongly, or is another one.
    """

    within_mm: Positive = 10.0
    within_deg: Positive = 5.0


class ConditionsConfig(FileModel):
    """What surrounds the cell, as far as no device tells."""

    temperature_c: float | None = Field(
        default=None,
        ge=-60,
        le=100,
        description="calibrations hold at a temperature; unknown, a change goes unseen",
    )


class BoxConfig(FileModel):
    """An axis-aligned box in the base frame."""

    low_mm: Point
    high_mm: Point

    @model_validator(mode="after")
    def _not_inside_out(self) -> Self:
        check_corners(self.low_mm, self.high_mm, "box")
        return self


class FixtureConfig(FileModel):
    """A body that stands in the cell: a CAD file or a box, in the base frame."""

    name: Name
    file: str | None = None
    units: Literal["mm", "in", "m"] | None = None
    low_mm: Point | None = None
    high_mm: Point | None = None

    @model_validator(mode="after")
    def _file_or_box(self) -> Self:
        box = self.low_mm is not None and self.high_mm is not None
        if (self.file is not None) == box:
            raise ValueError(
                f'fixture "{self.name}" needs either file or low_mm and high_mm'
            )
        if self.low_mm is not None and self.high_mm is not None:
            check_corners(self.low_mm, self.high_mm, f'fixture "{self.name}"')
        return self


class KeepOut(FileModel):
    """A box, base frame, that nothing of arm or camera may enter."""

    name: Name
    low_mm: Point
    high_mm: Point

    @model_validator(mode="after")
    def _not_inside_out(self) -> Self:
        check_corners(self.low_mm, self.high_mm, f'keep-out "{self.name}"')
        return self


class SettleConfig(FileModel):
    """How long to wait after arm and lens report that they stand still."""

    arm_s: NotNegative = Field(default=0.2, le=60)
    lens_s: NotNegative = Field(default=0.1, le=60)
    compare_frames: bool = Field(
        default=True,
        description="compare two frames of every view: is it still after that time?",
    )


class CellConfig(FileModel):
    """The whole of ``cell.toml``."""

    schema_version: Literal[1]
    name: Name
    description: str = ""
    default_task: str
    simulated: bool = False
    kinematics: KinematicsConfig
    arm: DriverRef
    lens: DriverRef
    camera: DriverRef
    calibration: CalibrationFiles
    optics: OpticsConfig
    uncertainty: UncertaintyConfig = Field(default_factory=UncertaintyConfig)
    part_placement: PartPlacement = Field(default_factory=PartPlacement)
    conditions: ConditionsConfig = Field(default_factory=ConditionsConfig)
    target: TargetConfig | None = Field(
        default=None, description="what `mvp-cell calibrate` looks at"
    )
    lens_calibration: LensGrid = Field(
        default_factory=LensGrid,
        description="at how many settings `mvp-cell calibrate lens` measures",
    )
    workspace: BoxConfig
    settle: SettleConfig = Field(default_factory=SettleConfig)
    motion: MotionConfig = Field(default_factory=MotionConfig)
    light: LightConfig | None = Field(
        default=None,
        description="left out: nothing is known of the light, contrast is not predicted",
    )
    fixtures: list[FixtureConfig] = Field(default_factory=list)
    keep_outs: list[KeepOut] = Field(default_factory=list)
    world: WorldRef | None = None
    simulators: Simulators = Field(default_factory=Simulators)

    @model_validator(mode="after")
    def _names_and_world(self) -> Self:
        names = [f.name for f in self.fixtures] + [k.name for k in self.keep_outs]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ValueError(f'two fixtures or keep-outs are called "{twice[0]}"')
        if self.world is not None and not self.simulated:
            raise ValueError(
                "[world] is the truth of a simulated cell, but simulated is false"
            )
        self._check_simulators()
        return self

    def _check_simulators(self) -> None:
        stood_for = self.simulators.by_role
        if stood_for and (self.world is None or not self.simulated):
            raise ValueError(
                "[simulators] need simulated = true and a [world] that they move in"
            )
        if stood_for and len(stood_for) < 3:
            raise ValueError(
                "[simulators] stand for arm, lens and camera, or for none of them; here "
                f"only for {', '.join(stood_for)}"
            )
        if stood_for and self.world is not None and self.world.clock_speed != 1.0:
            raise ValueError("real drivers need a world with clock_speed = 1.0")
