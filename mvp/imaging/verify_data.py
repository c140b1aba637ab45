"""What a verification says: frozen data that turns into JSON.

Lengths and offsets are in row pitches of the undistorted picture; None stands for
"not measured".
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Literal, TypeAlias

Verdict: TypeAlias = Literal["pass", "fail", "not measurable"]
Cause: TypeAlias = Literal[
    "overexposed",
    "underexposed",
    "motion",
    "defocus",
    "zoom",
    "misalignment",
    "occlusion",
    "low contrast",
    "resolution",
    "shape",
    "no end found",
]
Json: TypeAlias = "dict[str, Json] | list[Json] | str | float | int | bool | None"


@dataclass(frozen=True)
class Blur:
    """Blur diameter, px: measured with its 95 % interval, predicted, acceptable.

    ``square_px2`` is the fitted b^2, which may be slightly negative near zero.
    ``weighed_px2`` is the predicted b^2 where the edge is strong: a fit weighs the
    places along an edge by the square of the step.
    """

    measured_px: float | None
    low_px: float | None
    high_px: float | None
    predicted_px: float
    c_px: float
    square_px2: float | None = None
    square_sd_px2: float | None = None
    weighed_px2: float | None = None


@dataclass(frozen=True)
class EdgeReport:
    """One feature edge.

    Attributes:
        feature: id of the feature.
        name: of the edge (a face has several).
        predicted_px: predicted length.
        measured_px: distance of the two ends found in the picture.
        measured_sd_px: its standard deviation.
        start_px, end_px: raw column and row of both ends.
        predicted_start_px, predicted_end_px: where the plan expects them.
        offset_px: lateral offset from the plan at the middle; before registration.
        offset_after_px: what is left after the registration.
        offset_sd_px: its standard deviation.
        allowed_offset_px: what the plan's tolerance explains.
        visible_fraction: share of the edge that shows the step.
        saturated: share of clipped pixels along the edge.
        step: difference of the grey levels, share of full scale.
        snr: step over the noise of a pixel.
        predicted_contrast: step over brighter grey by the light model.
        detail_px: image of the required detail, as measured.
        required_px: what was promised for it.
        blur: of this edge.
        notes: what could not be measured, and why.
        length_asked: its ends are marked, so that its length must be measured.
        crowded: another line runs too close beside it to tell them apart.
    """

    feature: str
    name: str
    predicted_px: float
    measured_px: float | None
    measured_sd_px: float | None
    start_px: tuple[float, float] | None
    end_px: tuple[float, float] | None
    predicted_start_px: tuple[float, float]
    predicted_end_px: tuple[float, float]
    offset_px: float | None
    offset_after_px: float | None
    offset_sd_px: float | None
    allowed_offset_px: float
    visible_fraction: float
    saturated: float
    step: float | None
    snr: float
    predicted_contrast: float | None
    detail_px: float | None
    required_px: float | None
    blur: Blur
    notes: tuple[str, ...] = ()
    length_asked: bool = True
    crowded: bool = False


@dataclass(frozen=True)
class HoleReport:
    """The rim of one hole: full axes of its ellipse, px; outlines in raw pixels."""

    feature: str
    predicted_axes_px: tuple[float, float]
    measured_axes_px: tuple[float, float] | None
    axes_sd_px: tuple[float, float] | None
    predicted_px: float
    measured_px: float | None
    offset_px: float | None
    offset_after_px: float | None
    allowed_offset_px: float
    visible_fraction: float
    saturated: float
    step: float | None
    snr: float
    predicted_contrast: float | None
    detail_px: float | None
    required_px: float | None
    predicted_rim_px: tuple[tuple[float, float], ...]
    rim_px: tuple[tuple[float, float], ...]
    blur: Blur
    notes: tuple[str, ...] = ()
    crowded: bool = False


@dataclass(frozen=True)
class PointReport:
    """One point feature: raw column and row, expected and found."""

    feature: str
    predicted_px: tuple[float, float]
    measured_px: tuple[float, float] | None
    measured_sd_px: float | None
    offset_px: float | None
    allowed_offset_px: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Registration:
    """How the whole picture lies against the plan.

    Attributes:
        shift_px, roll_deg, scale: similarity from plan to picture.
        residual_px: root mean square of what it leaves.
        found_before: share of the expected edge length found where it was expected.
        found_after: the same after registration.
        searched: a search over shift, roll and scale was needed.
        match, match_unmoved: correlation score at the best place and at the plan's.
        position_mm: motion of the part along the planned camera's axes, and
        angle_deg: its turn about them, that explain the edge offsets best.
        pose_residual_px: root mean square of what such a motion leaves.
    """

    shift_px: tuple[float, float]
    roll_deg: float
    scale: float
    residual_px: float | None
    found_before: float
    found_after: float
    searched: bool
    match: float | None = None
    match_unmoved: float | None = None
    position_mm: tuple[float, float, float] | None = None
    angle_deg: tuple[float, float, float] | None = None
    pose_residual_px: float | None = None


@dataclass(frozen=True)
class BlurReport:
    """Blur of the whole picture.

    Attributes:
        measured_px, predicted_px, c_px: root mean square over the feature edges.
        low_px, high_px: 95 % interval of the measured one.
        excess_px2: b^2 beyond prediction, the same in all directions, over all edges.
        directional_px2: b^2 along one direction only.
        direction_deg: that direction in the picture, 0 = along rows.
    """

    measured_px: float | None
    low_px: float | None
    high_px: float | None
    predicted_px: float | None
    c_px: float
    excess_px2: float | None = None
    directional_px2: float | None = None
    direction_deg: float | None = None


@dataclass(frozen=True)
class Exposure:
    """Grey levels in the band of the features, shares of full scale."""

    level_95: float
    saturated: float


@dataclass(frozen=True)
class ViewVerification:
    """The verdict about one picture and all it rests on.

    Attributes:
        verdict: a pass means that the promise was measured and kept.
        cause: the most likely single fault, None for a pass.
        explanation: one sentence for people.
        check_first: what to look at first.
        notes: what is not measured at all, and what is remarkable about a pass.
        edges, holes, points: one entry per feature edge, rim and point.
    """

    verdict: Verdict
    cause: Cause | None
    explanation: str
    check_first: str
    notes: tuple[str, ...]
    edges: tuple[EdgeReport, ...]
    holes: tuple[HoleReport, ...]
    points: tuple[PointReport, ...]
    blur: BlurReport
    exposure: Exposure
    registration: Registration | None

    @property
    def passed(self) -> bool:
        """Whether the promise was measured and kept."""
        return self.verdict == "pass"

    def to_json(self) -> dict[str, Json]:
        """Plain dictionaries, lists, numbers and strings; nan becomes None."""
        value = _plain(asdict(self))
        return value if isinstance(value, dict) else {}


def _plain(value: object) -> Json:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool | str | int) or value is None:
        return value
    number = float(value)  # type: ignore[arg-type]
    return round(number, 6) if math.isfinite(number) else None
