"""What a picture is expected to show: edges, rims and corners in ideal pixels.

Built from plan and CAD alone (``expect_view``); the verifier compares a picture to it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.imaging.measure_plane import ImagePlane

Role: TypeAlias = Literal["feature", "neighbour", "auxiliary"]


@dataclass(frozen=True)
class ViewTolerance:
    """How far pose and focus may be off, from the plan.

    Attributes:
        position_mm: shift of the camera against the part.
        angle_deg: turn of the camera.
        d_mm: error of the image distance.
    """

    position_mm: float = 0.5
    angle_deg: float = 0.1
    d_mm: float = 0.02


@dataclass(frozen=True)
class Requirement:
    """The smallest detail that must be resolved, onto how many pixels."""

    detail_mm: float
    pixels: float = 1.0


@dataclass(frozen=True, eq=False)
class ExpectedEdge:
    """One straight piece of an edge that is measured.

    Attributes:
        name: for reports.
        feature: id of the feature it is (part of), or "".
        role: feature, neighbour of a feature's end, or auxiliary.
        start_px, end_px: (2,) ideal px; the piece that is measured: what is predicted
            visible, of a feature what has one and the same background.
        start_mm, end_mm: (3,) the same in the camera frame.
        start_neighbours, end_neighbours: numbers (in the expectation) of the edges that
            cross this one at its ends; empty where it ends without a corner.
        blur_px: predicted blur diameter (root mean square along the piece).
        visible: (S,) predicted visibility at S even places along the piece.
        contrast: predicted |step| over the brighter grey, nan when no light is known.
        requirement: of a feature's edge.
        detail_px: image of the required detail, pixels, at its worst place.
        open_ends: an end is marked by nothing: only the place across is asked.
        whole: the whole edge of a feature that is measured on a piece of it.
        crowded: another line runs so close beside it that they cannot be told apart.
    """

    name: str
    feature: str
    role: Role
    start_px: FloatArray
    end_px: FloatArray
    start_mm: FloatArray
    end_mm: FloatArray
    blur_px: float
    visible: BoolArray
    start_neighbours: tuple[int, ...] = ()
    end_neighbours: tuple[int, ...] = ()
    contrast: float = float("nan")
    requirement: Requirement | None = None
    detail_px: float = float("nan")
    open_ends: bool = False
    whole: ExpectedEdge | None = None
    crowded: bool = False

    @property
    def asked(self) -> ExpectedEdge:
        """The edge whose ends are asked for."""
        return self.whole or self

    @property
    def length_px(self) -> float:
        """Predicted length in the picture, row pitches."""
        return float(np.linalg.norm(self.end_px - self.start_px))

    @property
    def direction(self) -> FloatArray:
        """Unit vector (2,) from start to end."""
        return np.asarray((self.end_px - self.start_px) / max(self.length_px, 1e-12))

    @property
    def normal(self) -> FloatArray:
        """Unit vector (2,) across."""
        along = self.direction
        return np.array([-along[1], along[0]])

    @property
    def depth_mm(self) -> float:
        """Mean distance from the pupil plane."""
        return float(self.start_mm[2] + self.end_mm[2]) / 2

    def depth_mm_at(self, share: FloatArray) -> FloatArray:
        """Distance from the pupil plane at shares (n,) of its way in the picture.

        There 1/z is linear.
        """
        inverse = (1 - share) / self.start_mm[2] + share / self.end_mm[2]
        return np.asarray(1 / inverse)


@dataclass(frozen=True, eq=False)
class ExpectedRim:
    """A circular rim.

    Attributes:
        feature: its id.
        points_px: (n, 2) closed polyline, ideal px.
        centre_mm, axis, radius_mm: the circle in the camera frame.
        axes_px: (major, minor) full axes of the predicted ellipse.
        blur_px: predicted blur diameter.
        visible: (n,) predicted visibility of the points.
        contrast: (n,) predicted |step| over the brighter grey at the points, nan when
            no light is known.
        own: numbers of the CAD edges that make up the rim.
        even: (n,) where the step is the same a little farther along and across; empty
            for everywhere.
        crowded: another line runs so close beside it that they cannot be told apart.
    """

    feature: str
    points_px: FloatArray
    centre_mm: FloatArray
    axis: FloatArray
    radius_mm: float
    axes_px: tuple[float, float]
    blur_px: float
    visible: BoolArray
    contrast: FloatArray
    own: IntArray
    requirement: Requirement | None = None
    detail_px: float = float("nan")
    even: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))
    crowded: bool = False


@dataclass(frozen=True, eq=False)
class ExpectedPoint:
    """A point feature and the numbers of the edges that meet in it."""

    feature: str
    point_px: FloatArray
    point_mm: FloatArray
    neighbours: tuple[int, ...]
    blur_px: float


@dataclass(frozen=True, eq=False)
class DrawnEdges:
    """Every line the picture is predicted to show: for masks and registration.

    Attributes:
        start_px, end_px: (k, 2) visible pieces, ideal px.
        blur_px: (k,) blur diameters.
        edge: (k,) number of the CAD edge the piece is from.
        start_mm, end_mm: (k, 3) the ends in the camera frame.
    """

    start_px: FloatArray
    end_px: FloatArray
    blur_px: FloatArray
    edge: IntArray
    start_mm: FloatArray
    end_mm: FloatArray


@dataclass(frozen=True, eq=False)
class ViewExpectation:
    """All that one picture is compared to.

    Attributes:
        plane: lens setting and sensor.
        c_px: largest acceptable blur circle, row pitches.
        tolerance: of pose and focus.
        edges: feature edges first, then neighbours, then auxiliary ones.
        rims, points: holes and point features.
        drawn: all predicted lines.
        notes: what of the features is not measured.
    """

    plane: ImagePlane
    c_px: float
    tolerance: ViewTolerance
    edges: tuple[ExpectedEdge, ...]
    drawn: DrawnEdges
    rims: tuple[ExpectedRim, ...] = ()
    points: tuple[ExpectedPoint, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def feature_edges(self) -> tuple[ExpectedEdge, ...]:
        """Only the edges of features."""
        return tuple(edge for edge in self.edges if edge.role == "feature")
