"""Results of a calibration as data: what was found, how well, when and on what.

The planner and the run read these; only ``calibration`` fits them. Files are JSON.
"""

from __future__ import annotations

from typing import Literal, Self, TypeAlias

from pydantic import Field, model_validator

from mvp.calibrated.zoom_table import ZoomTable
from mvp.fileedge import FileModel

TemperatureSource: TypeAlias = Literal["device", "cell-file", "operator", "unknown"]


class Provenance(FileModel):
    """Where a result comes from and what it may be used for.

    ``origin``: measured on the device; or taken from its data sheet, or imported without
    a word of which device it is. ``serial_numbers``: of every device that took part, by
    its role in the cell. ``built_on``: hashes of the calibrations that it was computed
    with, by name (``inputs_sha256``); empty: it does not say. ``temperature_source``: who
    knew ``temperature_c``; None: it does not say.
    """

    date: str
    device_serial: str
    method: str
    simulated: bool = False
    input_sha256: str = ""
    temperature_c: float | None = None
    temperature_source: TemperatureSource | None = None
    origin: Literal["measured", "nominal"] = "measured"
    serial_numbers: dict[str, str] = Field(default_factory=dict)
    built_on: dict[str, str] = Field(default_factory=dict)


class Validity(FileModel):
    """Under which conditions a result holds; None: not limited."""

    temperature_min_c: float | None = None
    temperature_max_c: float | None = None
    approach: Literal["from_below", "from_above"] | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        low, high = self.temperature_min_c, self.temperature_max_c
        if low is not None and high is not None and low > high:
            raise ValueError("temperature_min_c is above temperature_max_c")
        return self


class NamedCovariance(FileModel):
    """A covariance with the names (with units) of its rows and columns."""

    parameters: list[str]
    matrix: list[list[float]]

    @model_validator(mode="after")
    def _square(self) -> Self:
        size = len(self.parameters)
        if len(self.matrix) != size or any(len(row) != size for row in self.matrix):
            raise ValueError(f"the matrix must be {size} x {size}, as the parameters")
        return self


class VerdictCause(FileModel):
    """One thing that speaks against a result, and what to do about it."""

    code: str
    grade: Literal["marginal", "no-go"]
    message: str
    action: str


class ViewResidual(FileModel):
    """What one view (or pose, or node) leaves unexplained."""

    name: str
    rms_px: float | None = None
    rms_mm: float | None = None


class Quality(FileModel):
    """How good it is: residual, error at the working distance, and a verdict.

    ``condition``: ratio of the best to the worst determined combination of parameters,
    after scaling; ``weakest_direction`` names the worst one with its standard deviation.
    ``chi_square_probability``: of residuals as large as these if the model and the
    assumed noise are right. ``out_of_sample``: RMS error on data that took no part.
    """

    verdict: Literal["go", "marginal", "no-go"]
    rms_px: float | None = None
    rms_mm: float | None = None
    error_95_mm: float | None = None
    reasons: list[str] = Field(default_factory=list)
    causes: list[VerdictCause] = Field(default_factory=list)
    next_action: str = ""
    condition: float | None = None
    weakest_direction: str = ""
    chi_square: float | None = None
    degrees_of_freedom: int | None = None
    chi_square_probability: float | None = None
    out_of_sample_px: float | None = None
    out_of_sample_mm: float | None = None
    views: list[ViewResidual] = Field(default_factory=list)


class CameraCalibration(FileModel):
    """Sensor, principal point and distortion (OpenCV's order and meaning).

    ``reference_fx_px`` and ``reference_fy_px``: principal distance at the lens setting of
    the pictures, over the pixel pitches; the covariance includes them.
    """

    schema_: Literal["mvp-cell/camera/1"] = Field(alias="schema")
    provenance: Provenance
    quality: Quality
    width_px: int = Field(gt=1)
    height_px: int = Field(gt=1)
    pitch_x_um: float = Field(gt=0)
    pitch_y_um: float = Field(gt=0)
    centre_x_px: float
    centre_y_px: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    standard_deviation: dict[str, float] = Field(default_factory=dict)
    reference_fx_px: float | None = Field(default=None, gt=0)
    reference_fy_px: float | None = Field(default=None, gt=0)
    covariance: NamedCovariance | None = None
    validity: Validity = Validity()


class AxisTable(FileModel):
    """One motor axis: steps against a physical value, both strictly monotonic.

    Two or more; a zoom may have one, of a lens without zoom or measured at that alone.
    ``approach`` is the side from which every node was reached; ``backlash_steps`` the
    measured width; ``repeatability_steps`` one standard deviation.
    """

    steps: list[int] = Field(min_length=1)
    values_mm: list[float] = Field(min_length=1)
    approach: Literal["from_below", "from_above"] = "from_below"
    backlash_steps: int = Field(default=0, ge=0)
    repeatability_steps: float = Field(default=0.0, ge=0)


class LensNodeResult(FileModel):
    """A lens at one zoom and focus: what varies with both.

    ``k1`` in OpenCV's meaning, for principal distance ``f_cal_mm`` = d - e m.
    """

    zoom: int
    focus: int
    f_cal_mm: float = Field(gt=0)
    d_mm: float = Field(gt=0)
    d_standard_deviation_mm: float = Field(ge=0)
    centre_x_px: float
    centre_y_px: float
    k1: float = 0.0


class AchievableZoom(FileModel):
    """What focus reaches at one zoom.

    Sharp distances from the entrance pupil; a missing far one is infinity.
    """

    zoom: int
    f_mm: float = Field(gt=0)
    d_low_mm: float = Field(gt=0)
    d_high_mm: float = Field(gt=0)
    sharp_near_mm: float
    sharp_far_mm: float | None = None


class AchievableSet(FileModel):
    """All settings that the motors reach, and how finely; without an extension tube.

    For people and other programs: the planner works the same out of the tables, where
    they hold, with the tube that is mounted (``mvp.optics.achievable_set``).
    ``*_per_step_mm``: the largest change of f, x = d - f and a by one whole step.
    """

    zooms: list[AchievableZoom] = Field(min_length=1)
    a_low_mm: float = Field(gt=0)
    a_high_mm: float = Field(gt=0)
    f_per_step_mm: float = Field(ge=0)
    x_per_step_mm: float = Field(gt=0)
    a_per_step_mm: float = Field(gt=0)


class LensValidity(Validity):
    """Where a lens table holds. No temperatures: it was not known."""

    temperature_source: TemperatureSource = "unknown"
    zoom_steps: tuple[int, int]
    focus_steps: tuple[int, int]
    iris_steps: tuple[int, int]


class LensTableCalibration(FileModel):
    """Motor steps to f, d, a and the pupil offset e.

    f depends on zoom alone, a on iris alone. The focus axis gives the extension
    x = d - f (mm); for a parfocal zoom x is the same at every zoom. ``by_zoom``: what
    else the zoom changes; without it nothing. The planner reads these tables; ``nodes``
    keeps what was measured at each zoom and focus.
    """

    schema_: Literal["mvp-cell/lens-table/1"] = Field(alias="schema")
    provenance: Provenance
    quality: Quality
    zoom_f_mm: AxisTable
    focus_extension_mm: AxisTable
    iris_a_mm: AxisTable
    pupil_offset_mm: float = 0.0
    d_standard_deviation_mm: float = Field(default=0.0, ge=0)
    f_standard_deviation_mm: float = Field(default=0.0, ge=0)
    a_standard_deviation_mm: float = Field(default=0.0, ge=0)
    covariance: NamedCovariance | None = None
    pupil_offset_standard_deviation_mm: float = Field(default=0.0, ge=0)
    by_zoom: ZoomTable | None = None
    nodes: list[LensNodeResult] = Field(default_factory=list)
    achievable: AchievableSet | None = None
    validity: LensValidity | None = None


class RigidCalibration(FileModel):
    """A rigid transform ``target_from_source`` with its 6 x 6 covariance.

    Covariance order: translation (mm), then rotation vector (rad), in the target frame.
    ``reference_d_mm`` and ``reference_f_mm``: the lens setting a hand-eye result belongs
    to; the entrance pupil moves along the optical axis with d (towards the object as d
    grows), and ``mvp.cell`` applies that shift.

    ``by_hand_eye``: of a part that was located through a hand-eye transform, the change
    of the part's pose (6 x 6, same order) for an error of that transform;
    ``hand_eye_sha256``: which one it was (``content_sha256``). The two errors partly
    cancel when the same transform takes the camera to a view of the part.
    """

    schema_: Literal["mvp-cell/hand-eye/1", "mvp-cell/part-pose/1"] = Field(
        alias="schema"
    )
    provenance: Provenance
    quality: Quality
    target: str
    source: str
    matrix: list[list[float]]
    covariance: list[list[float]] | None = None
    reference_d_mm: float | None = None
    reference_f_mm: float | None = None
    by_hand_eye: list[list[float]] | None = None
    hand_eye_sha256: str = ""
    validity: Validity = Validity()
