"""The pictures of a report as data: numbers, and how they are read (stands below)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray

GRID_ROWS, GRID_COLUMNS = 6, 8


@dataclass(frozen=True, eq=False)
class ResidualField:
    """What is left between prediction and picture, all views in one.

    Attributes:
        pixels: (m, 2), where points were found.
        errors_px: (m, 2), predicted less found.
        size_px: columns and rows of the picture.
        sigma_px: noise of a coordinate that was assumed or found.
    """

    pixels: FloatArray
    errors_px: FloatArray
    size_px: tuple[int, int]
    sigma_px: float

    title = "Residuals over the picture"
    how_to_read = (
        "Left: where each point was found; the arrow, much enlarged, is how far the "
        "prediction is from it. Right: the size of the residual in each field of the "
        "picture (px, one coordinate), with the mean arrow of the field. White fields "
        "hold no point."
    )

    @property
    def good(self) -> str:
        """What a good one looks like."""
        return (
            "Good: arrows point everywhere, and no field stands out. Arrows that point "
            "the same way over a region mean that the model of the lens does not fit "
            f"there. The noise of a coordinate is {self.sigma_px:.3g} px."
        )


@dataclass(frozen=True, eq=False)
class Coverage:
    """Which parts of the picture held points.

    Attributes:
        counts: (GRID_ROWS, GRID_COLUMNS), points in each field.
        size_px: columns and rows of the picture.
        good: what a good one looks like.
    """

    counts: IntArray
    size_px: tuple[int, int]
    good: str = (
        "Good: no field is empty, the border ring included. Where there was no point, "
        "the calibration is a guess."
    )

    title = "Coverage of the picture"
    how_to_read = (
        "How many points fell into each field. The dashed frame separates the border "
        "ring, where the distortion of a lens is largest."
    )

    @classmethod
    def of(
        cls, pixels: FloatArray, size_px: tuple[int, int], good: str = ""
    ) -> Coverage:
        """Count points (m, 2); ``good`` where another coverage is good."""
        edges = [np.linspace(-0.5, s - 0.5, n + 1) for s, n in zip(
            size_px, (GRID_COLUMNS, GRID_ROWS), strict=True
        )]  # fmt: skip
        counts, _, _ = np.histogram2d(pixels[:, 1], pixels[:, 0], bins=edges[::-1])
        found = cls(counts.astype(np.int64), size_px)
        return replace(found, good=good) if good else found


@dataclass(frozen=True, eq=False)
class Tilts:
    """How the target was tilted against the sensor.

    Attributes:
        about_x_deg: (views,), tilt about the picture's x axis.
        about_y_deg: (views,).
        names: of the views.
    """

    about_x_deg: FloatArray
    about_y_deg: FloatArray
    names: tuple[str, ...]

    title = "Tilt of the target"
    how_to_read = (
        "One dot for each view: its tilt about the two axes of the picture. The middle "
        "is a target squarely faced. The green ring is 25 to 45 deg."
    )
    good = (
        "Good: dots all around, several of them in the green ring. Dots in the middle "
        "alone leave focal length and distance undecided, and the residual never shows "
        "it."
    )


@dataclass(frozen=True, eq=False)
class WorkMap:
    """One sigma of a point on the work, by its place in the picture.

    Attributes:
        pixels: (rows, columns, 2).
        sigma_mm: (rows, columns).
        distance_mm: of the work.
    """

    pixels: FloatArray
    sigma_mm: FloatArray
    distance_mm: float

    title = "How far off a point may be"

    @property
    def how_to_read(self) -> str:
        """In words."""
        without = (
            " What a small motion of the camera imitates is not counted: hand-eye and "
            "part pose absorb it."
        )
        return (
            "One standard deviation, in mm on a plane at "
            f"{self.distance_mm:.0f} mm, that this calibration adds at each place of the "
            f"picture.{without}"
        )

    good = (
        "Good: small against what has to be measured, also in the corners. Larger in "
        "one corner: take views with the target there."
    )


@dataclass(frozen=True, eq=False)
class ViewBars:
    """One bar for each view (or feature, or node).

    Attributes:
        what: the figure in words.
        unit: of the figure.
        names: of the views.
        values: (n,).
        limit: beyond it a view is suspicious; None: three times the median.
        advice: what to do with a long bar.
    """

    what: str
    unit: str
    names: tuple[str, ...]
    values: FloatArray
    limit: float | None = None
    advice: str = "look at its picture; remove it or take it again"

    @property
    def title(self) -> str:
        """The figure."""
        return f"{self.what[0].upper()}{self.what[1:]}"

    @property
    def bound(self) -> float:
        """Where the tick stands."""
        if self.limit is not None:
            return self.limit
        return 3 * float(np.median(self.values)) if len(self.values) else 0.0

    @property
    def outlying(self) -> BoolArray:
        """(n,) beyond the bound."""
        return np.asarray(self.values > self.bound)

    how_to_read = (
        "The length of a bar is the figure; the tick is where a view stands apart. "
        "A name leads to its picture."
    )

    @property
    def good(self) -> str:
        """What a good one looks like."""
        return f"Good: bars of like length, none beyond the tick. A long one: {self.advice}."


@dataclass(frozen=True)
class BudgetPart:
    """One source of error: one sigma in mm, and where it comes from."""

    name: str
    sigma_mm: float
    source: str


@dataclass(frozen=True)
class ErrorBudget:
    """What makes a point on the work uncertain.

    Attributes:
        distance_mm: working distance.
        what: whose error it is.
        parts: independent of each other.
    """

    distance_mm: float
    what: str
    parts: tuple[BudgetPart, ...]

    title = "Error budget"
    how_to_read = (
        "One standard deviation of each source, in mm at the working distance. They are "
        "independent: the total is the root of the sum of squares, so the longest bar "
        "decides."
    )
    good = (
        "Good: the calibration is not the longest bar. Where robot or pixel noise is, "
        "more pictures for this calibration do not help."
    )

    @property
    def total_mm(self) -> float:
        """One sigma of all together."""
        return float(np.sqrt(sum(part.sigma_mm**2 for part in self.parts)))


@dataclass(frozen=True, eq=False)
class Outline:
    """A body in the scene: polylines (k, 3) mm, with a name."""

    name: str
    lines_mm: tuple[FloatArray, ...]
    role: Literal["target", "part", "robot", "axes"] = "target"


@dataclass(frozen=True, eq=False)
class Scene:
    """Target, cameras and robot in one frame.

    Attributes:
        frame: name of the frame.
        cameras: (n, 4, 4) ``frame_from_camera``, mm.
        names: of the cameras.
        half_angles: tangents of half the field of view, x and y.
        reach_mm: how long the drawn fields of view are.
        outlines: target, part, tool paths.
    """

    frame: str
    cameras: FloatArray
    names: tuple[str, ...]
    half_angles: tuple[float, float]
    reach_mm: float
    outlines: tuple[Outline, ...] = ()

    title = "Where the camera stood"

    @property
    def how_to_read(self) -> str:
        """In words."""
        return (
            f"Every pyramid is a camera with its field of view, in mm of the {self.frame} "
            "frame; lines are what it looked at, seen from two sides."
        )

    good = (
        "Good: cameras look from many sides and turn about their own axis as well. All "
        "in one bundle, or all with the same side up, leave something undecided."
    )


@dataclass(frozen=True, eq=False)
class Slack:
    """How far the robot was from its word in each view.

    Attributes:
        names: of the views.
        position_mm: (n, 3), base axes.
        angle_deg: (n, 3), base axes.
        stated: one sigma on each axis that was stated: mm, deg.
        found: what the views say: mm, deg.
    """

    names: tuple[str, ...]
    position_mm: FloatArray
    angle_deg: FloatArray
    stated: tuple[float, float]
    found: tuple[float, float]

    title = "Slack of the robot"
    how_to_read = (
        "For each view, how far the robot was from the pose it reported, so that picture "
        "and robot agree: position above, orientation below, three axes each. The grey "
        "band is twice the standard deviation that was stated, the dashed lines twice "
        "the one that was found."
    )
    good = (
        "Good: dots scattered inside the band, without a trend. Beyond the band, the "
        "robot is worse than stated; a single view outside: the arm was still moving, or "
        "its pose belongs to another picture; a trend: something slipped."
    )


@dataclass(frozen=True, eq=False)
class LensCurve:
    """One motor: measured nodes and the curve between them.

    Attributes:
        axis: zoom, focus or iris.
        symbol: what it sets, such as "f".
        steps: (k,) of the nodes.
        values_mm: (k,).
        sigma_mm: (k,).
        table_steps: (t,) of the exported table.
        table_mm: (t,).
        left_out_mm: (k - 2,), error foretold at the inner nodes when left out.
        left_out_sigma_mm: (k - 2,), what the nodes around allow.
        kind: the curve in words.
        hysteresis: in words; empty where it was not measured.
    """

    axis: str
    symbol: str
    steps: IntArray
    values_mm: FloatArray
    sigma_mm: FloatArray
    table_steps: IntArray
    table_mm: FloatArray
    left_out_mm: FloatArray
    left_out_sigma_mm: FloatArray
    kind: str
    hysteresis: str

    @property
    def title(self) -> str:
        """The motor."""
        return f"{self.axis[0].upper()}{self.axis[1:]} motor: {self.symbol} in mm"

    how_to_read = (
        "Above: measured nodes and the curve that the planner follows. Below: each inner "
        "node left out in turn, and how far the curve of the others misses it, in um; "
        "the bars are two standard deviations of the nodes around it."
    )

    @property
    def good(self) -> str:
        """What a good one looks like."""
        return (
            "Good: the curve rises or falls throughout, and the left-out errors lie "
            f"within their bars. Curve: {self.kind}. {self.hysteresis}".rstrip()
        )


@dataclass(frozen=True, eq=False)
class NodeErrors:
    """Nodes of a lens table against the fitted model.

    Attributes:
        names: zoom and focus steps of each node.
        off_um: (n,), f_cal as measured less as fitted.
        sigma_um: (n,), of the measured one.
    """

    names: tuple[str, ...]
    off_um: FloatArray
    sigma_um: FloatArray

    title = "Nodes against the model"
    how_to_read = (
        "For every measured setting, the principal distance less that of the model of "
        "the lens (f, d and pupil offset), in um; bars are two standard deviations."
    )
    good = (
        "Good: dots within their bars, without a pattern. A pattern over focus: the "
        "lens breathes, f is not the same at all focus settings."
    )


Plot: TypeAlias = (
    ResidualField
    | Coverage
    | Tilts
    | WorkMap
    | ViewBars
    | ErrorBudget
    | Scene
    | Slack
    | LensCurve
    | NodeErrors
)
