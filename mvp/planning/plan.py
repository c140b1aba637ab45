"""The plan as data: ``mvp-cell/plan/1``, what plan.json holds."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from mvp.fileedge import FileModel

PLAN_SCHEMA: Literal["mvp-cell/plan/1"] = "mvp-cell/plan/1"

Vector: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = Annotated[
    list[Annotated[list[float], Field(min_length=4, max_length=4)]],
    Field(min_length=4, max_length=4),
]


class FileStamp(FileModel):
    """A file and the SHA-256 of its bytes.

    ``file`` is relative to the cell's folder when it lies inside it, else absolute.
    """

    file: str
    sha256: str


class CellStamp(FileModel):
    """Which cell the plan is for."""

    name: str
    sha256: str
    simulated: bool


class LensSteps(FileModel):
    """Motor steps that will be commanded."""

    zoom: int
    focus: int
    iris: int


class Margin(FileModel):
    """Worst signed slack of one requirement at one view.

    ``value`` is in ``unit`` and None when ``unbounded``; ``normalised`` is in standard
    deviations under the cell's errors: as the calibrations know them, else as stated.
    """

    value: float | None
    unit: str
    normalised: float | None
    unbounded: bool = False
    row: str = ""


class Tolerance(FileModel):
    """How far everything may be off at once with every requirement still kept.

    ``scale`` multiplies the box (position ball, angle, d, with f and a intervals) that
    was certified; ``*_alone`` are the values when only that one is off.
    """

    position_mm: float
    angle_deg: float
    d_mm: float
    method: str
    scale: float | None = None
    position_alone_mm: float | None = None
    angle_alone_deg: float | None = None
    d_alone_mm: float | None = None
    f_mm: float | None = None
    a_mm: float | None = None


class ErrorSpread(FileModel):
    """How far a view will be off, one standard deviation of each lens value.

    ``position_mm`` and ``angle_deg``: root mean square of the camera's distance from,
    and turn against, its plan as seen from the part; ``*_95``: exceeded once in twenty.
    ``sources``: calibrations whose covariances say so; what they leave open, and all
    of it when there are none, is the cell's stated uncertainty.
    """

    position_mm: float
    position_95_mm: float
    angle_deg: float
    angle_95_deg: float
    f_mm: float
    d_mm: float
    a_mm: float
    sources: list[str] = Field(default_factory=list)


class KeptProbability(FileModel):
    """The probability that a view keeps its requirements, to first order in its errors.

    ``each``: by requirement; what only hangs on commanded joints and motor steps is
    certain. ``together``: of all at once. ``weakest``: the least probable one.
    """

    each: dict[str, float]
    together: float
    weakest: str
    spread: ErrorSpread


class PlannedView(FileModel):
    """One view: where the camera goes, how the lens is set, and how safe that is.

    ``contrast``: by feature, step over the brighter grey that the faintest of its lines
    is predicted to show; empty when the cell says nothing about its light.
    ``failure_probability``: share of drawn errors that break a true margin.
    """

    id: str
    features: list[str]
    part_from_camera: Matrix
    base_from_tool: Matrix
    position_mm: Vector
    view_direction: Vector
    roll_rad: float
    f_mm: float
    d_mm: float
    a_mm: float
    pupil_offset_mm: float
    lens_steps: LensSteps
    joints_rad: list[float]
    exposure_s: float
    margins: dict[str, Margin]
    binding: str
    tolerance: Tolerance
    failure_probability: float | None = None
    probability: KeptProbability | None = None
    sensitivity: dict[str, float] = Field(default_factory=dict)
    extension_tube_mm: float | None = None
    contrast: dict[str, float] = Field(default_factory=dict)
    notes: list[str] = Field(default_factory=list)


class NotCovered(FileModel):
    """A feature no view covers, why, and what would change that."""

    feature: str
    reason: str
    nearest: dict[str, float | str | list[float]] = Field(default_factory=dict)
    fix: str


class Timing(FileModel):
    """Wall-clock seconds of the stages of planning."""

    load: float = 0.0
    visibility: float = 0.0
    optimise: float = 0.0
    total: float = 0.0


class Plan(FileModel):
    """Everything a run needs, and nothing that changes while it runs."""

    schema_: Literal["mvp-cell/plan/1"] = Field(default=PLAN_SCHEMA, alias="schema")
    status: Literal["admissible", "partial", "infeasible"]
    seed: int
    part: FileStamp
    task: FileStamp
    cell: CellStamp
    views: list[PlannedView]
    not_covered: list[NotCovered] = Field(default_factory=list)
    notes: list[str] = Field(default_factory=list)
    timing_s: Timing = Field(default_factory=Timing)
