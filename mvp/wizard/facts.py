"""What a session knows before its first picture; kept in ``session.json``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from pydantic import Field

from mvp.calibrated import (
    CameraCalibration,
    LensGrid,
    LensTableCalibration,
    MeasuredTarget,
    RigidCalibration,
    TargetPrint,
    TemperatureSource,
)
from mvp.fileedge import FileModel
from mvp.geometry import Pose
from mvp.kinematics import intrinsics_of, sensor_of, tool_from_camera_at
from mvp.optics import LensTable

if TYPE_CHECKING:
    from mvp.optics import Intrinsics, LensSetting, Sensor

FACTS_SCHEMA: Literal["mvp-cell/calibration-session/1"] = (
    "mvp-cell/calibration-session/1"
)


_BEFORE_LENS = ("camera", "lens")


class TargetFacts(TargetPrint):
    """The printed target, how well its size is known, and roughly where it lies.

    Target frame: x right, y down, z into the board for somebody who looks at it; a
    ChArUco board's origin is its outer corner, that of the others the first point.
    ``position_mm`` and ``rotation_deg`` (a rotation vector): ``base_from_target``, with
    one standard deviation for each axis. ``flat_sigma_mm``: of its middle off the plane of
    its ends; None: as a print on something nearly flat. ``measured``: with a caliper; the
    print is as much larger throughout. None: the size is that of ``[target]``.
    """

    square_sigma_mm: float = Field(gt=0)
    position_mm: tuple[float, float, float]
    rotation_deg: tuple[float, float, float]
    position_sigma_mm: float = Field(default=5.0, gt=0)
    angle_sigma_deg: float = Field(default=2.0, gt=0)
    flat_sigma_mm: float | None = Field(default=None, gt=0)
    measured: MeasuredTarget | None = None

    def sized(self, measured: MeasuredTarget | None) -> Self:
        """The same print as large as it was measured; another one is left as it is."""
        if measured is None or self.measured or not measured.is_of(self):
            return self
        larger = measured.square_mm / self.square_mm
        size = {
            name: value * larger
            for name in ("marker_mm", "disc_mm")
            if (value := getattr(self, name)) is not None
        }
        size["square_mm"] = measured.square_mm
        size["square_sigma_mm"] = measured.square_sigma_mm
        return self.model_copy(update={**size, "measured": measured})

    @property
    def base_from_target(self) -> Pose:
        """Roughly where it lies."""
        turn = np.radians(self.rotation_deg)
        return Pose.from_rotvec("base", "target", turn, np.asarray(self.position_mm))


class RobotNoiseFacts(FileModel):
    """How far off a reported pose of the flange may be: one sigma for each axis."""

    position_mm: float = Field(gt=0)
    angle_deg: float = Field(gt=0)


class SessionFacts(FileModel):
    """Everything about the cell that a calibration depends on beside its samples.

    The four calibrations are the present ones, as the cell's files have them: measured,
    or nominal values that may be wrong by some per cent, millimetres and degrees.

    ``serials``: of every device that answered, by role. ``working_mm``: distance at
    which errors are stated; None: where the lens is in focus. ``temperature_c``: None:
    not known; ``temperature_source``: who knew it. ``date``: UTC, when the session
    began. ``accepted_calibration``: why a person took the responsibility for poor
    calibrations that this one builds on.
    """

    schema_: Literal["mvp-cell/calibration-session/1"] = Field(
        default=FACTS_SCHEMA, alias="schema"
    )
    key: str
    cell: str
    simulated: bool
    date: str
    seed: int = 0
    serials: dict[str, str]
    arm_model: str
    camera: CameraCalibration
    lens_table: LensTableCalibration
    hand_eye: RigidCalibration
    part_pose: RigidCalibration
    robot: RobotNoiseFacts
    target: TargetFacts | None = None
    blur_circle_mm: float = Field(gt=0)
    wavelength_mm: float = Field(default=550e-6, gt=0)
    tube_mm: float = Field(default=0.0, ge=0)
    workspace_low_mm: tuple[float, float, float]
    workspace_high_mm: tuple[float, float, float]
    working_mm: float | None = Field(default=None, gt=0)
    temperature_c: float | None = None
    temperature_source: TemperatureSource | None = None
    accepted_calibration: str = ""
    lens_grid: LensGrid = LensGrid()

    @property
    def sensor(self) -> Sensor:
        """Size and pitch of the pixels."""
        return sensor_of(self.camera)

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera as it is believed to be, unless the zoom changes it."""
        return intrinsics_of(self.camera)

    def intrinsics_at(self, lens: LensSetting) -> Intrinsics:
        """The camera as it is believed to be, at a lens setting."""
        return self.intrinsics.at(lens.centre_px, lens.k1)

    @property
    def table(self) -> LensTable:
        """The lens as it is believed to be, with the tube that is mounted."""
        return LensTable.from_calibration(self.lens_table, tube_mm=self.tube_mm)

    @property
    def table_in_use(self) -> LensTable:
        """The same where it holds, for what is built on it.

        All of it for what is measured before it, and where a person took the
        responsibility.

        Raises:
            CalibrationError: it holds nowhere.
        """
        whole = self.key in _BEFORE_LENS or self.accepted_calibration
        return self.table.within(None if whole else self.lens_table.validity)

    def lens_at(self, steps: dict[str, int]) -> LensSetting:
        """f, d, a and e that the table tells for motor steps.

        Raises:
            InputError: outside of the table.
        """
        return self.table.setting(**steps)

    @property
    def base_from_part(self) -> Pose:
        """Where the part is believed to lie."""
        return Pose.from_matrix("base", "part", np.asarray(self.part_pose.matrix))

    def tool_from_camera(self, d_mm: float) -> Pose:
        """The hand-eye transform as it is believed to be, at a lens setting."""
        found = self.hand_eye
        return tool_from_camera_at(
            Pose.from_matrix("tool", "camera", np.asarray(found.matrix)),
            d_mm=d_mm,
            reference_d_mm=found.reference_d_mm,
        )
