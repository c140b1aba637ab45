"""What a task file may say: the part, the features and what must be seen of them."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Discriminator, Field, Tag, model_validator

from mvp.cell.values import FixedOrRange, Name, Point, Positive
from mvp.fileedge import FileModel

_SHORTEST_MM = 1e-6


class PartRef(FileModel):
    """The CAD file, relative to the task file.

    ``pose`` names a part-pose calibration of this part; the cell's own is used without.
    """

    file: str = Field(min_length=1)
    units: Literal["mm", "in", "m"] | None = None
    pose: str | None = None


class Resolution(FileModel):
    """The smallest detail that must be resolved, onto how many pixels."""

    detail_mm: Positive
    pixels: Positive = 1.0


class LensBounds(FileModel):
    """Fixed values, or ranges to plan within. A missing one is the lens' own range.

    a stays fixed unless a range is given: while exposure and diffraction are not
    margins, a free aperture would always close completely.
    """

    f_mm: FixedOrRange | None = None
    d_mm: FixedOrRange | None = None
    a_mm: FixedOrRange | None = None


class ExposureConfig(FileModel):
    """A fixed exposure; without it one frame is metered at the first view."""

    exposure_s: Positive | None = Field(default=None, le=60)
    gain: Positive = 1.0


class _FeatureBase(FileModel):
    id: Name
    resolution: Resolution | None = None


class FeatureByReference(_FeatureBase):
    """A feature found in the CAD file, by an id of ``mvp-cell features``."""

    ref: str = Field(min_length=1)


class PointByCoordinates(_FeatureBase):
    """A point, part frame."""

    kind: Literal["point"]
    at_mm: Point


class EdgeByCoordinates(_FeatureBase):
    """A straight edge, part frame."""

    kind: Literal["edge"]
    from_mm: Point
    to_mm: Point

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if math.dist(self.from_mm, self.to_mm) < _SHORTEST_MM:
            raise ValueError(f'edge "{self.id}" has no length: from_mm equals to_mm')
        return self


class FaceByCoordinates(_FeatureBase):
    """A planar polygon with holes, part frame, counter-clockwise from outside."""

    kind: Literal["face"]
    corners_mm: list[Point] = Field(min_length=3)
    holes_mm: list[list[Point]] = Field(default_factory=list)


class HoleByCoordinates(_FeatureBase):
    """A round hole: its near rim, part frame; the axis points out of the part."""

    kind: Literal["hole"]
    centre_mm: Point
    axis: Point
    diameter_mm: Positive
    depth_mm: Positive | None = None

    @model_validator(mode="after")
    def _has_direction(self) -> Self:
        if math.hypot(*self.axis) < _SHORTEST_MM:
            raise ValueError(f'hole "{self.id}": axis has no length')
        return self


def _which(value: object) -> str | None:
    """The variant of a feature: by reference, or by its kind."""
    if isinstance(value, dict):
        return "ref" if "ref" in value and "kind" not in value else value.get("kind")
    return getattr(value, "kind", "ref")


FeatureConfig: TypeAlias = Annotated[
    Annotated[FeatureByReference, Tag("ref")]
    | Annotated[PointByCoordinates, Tag("point")]
    | Annotated[EdgeByCoordinates, Tag("edge")]
    | Annotated[FaceByCoordinates, Tag("face")]
    | Annotated[HoleByCoordinates, Tag("hole")],
    Discriminator(
        _which,
        custom_error_type="feature_kind",
        custom_error_message=(
            'a feature needs ref = "..." or kind = "point", "edge", "face" or "hole"'
        ),
    ),
]


class StartConfig(FileModel):
    """A viewpoint a person proposes: one more start, never the only one."""

    position_mm: Point
    look_at_mm: Point
    roll_deg: float = 0.0
    d_mm: Positive | None = None


class PlanningConfig(FileModel):
    """How views are chosen.

    ``max-min`` keeps every requirement as many standard deviations away from failing
    as possible; ``paper-1`` and ``paper-2`` are the weighted sums of the paper's
    experiments, for comparison.
    """

    field_of_view: Literal["circle", "rectangle"] = "circle"
    objective: Literal["max-min", "paper-1", "paper-2"] = "max-min"
    max_views: int = Field(default=6, ge=1, le=100)


class TaskConfig(FileModel):
    """The whole of a task file."""

    schema_version: Literal[1]
    name: Name
    description: str = ""
    part: PartRef
    resolution: Resolution
    lens: LensBounds = Field(default_factory=LensBounds)
    exposure: ExposureConfig = Field(default_factory=ExposureConfig)
    planning: PlanningConfig = Field(default_factory=PlanningConfig)
    features: list[FeatureConfig] = Field(min_length=1, max_length=500)
    starts: list[StartConfig] = Field(default_factory=list, max_length=100)
