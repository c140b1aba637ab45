"""What was measured at one setting of zoom and focus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray, IntArray

NODE_NAMES = ("f_cal_mm", "centre_x_px", "centre_y_px", "k1_per_mm2")


@dataclass(frozen=True)
class Measured:
    """A value and its one standard deviation, both in the unit of its name."""

    value: float
    sigma: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.value) and np.isfinite(self.sigma) and self.sigma > 0):
            raise ValueError("a measured value needs a finite value and a sigma > 0")


@dataclass(frozen=True, eq=False)
class LensNode:
    """A camera calibration at one zoom and focus, and what focus was sharp there.

    Attributes:
        zoom: motor steps.
        focus: motor steps.
        values: (4,) of ``NODE_NAMES``: principal distance, image centre, and the radial
            distortion k1 / f_cal^2 (OpenCV's k1 on the sensor, mm^-2).
        covariance: (4, 4) of them.
        sharp_mm: distance in best focus from the entrance pupil (a contrast sweep).
        pupil_mm: place of the entrance pupil along the optical axis, towards the object,
            from any origin that stays fixed at one zoom.
        fill: share of the short side of the image that the target filled.
    """

    zoom: int
    focus: int
    values: FloatArray
    covariance: FloatArray
    sharp_mm: Measured | None = None
    pupil_mm: Measured | None = None
    fill: float = 1.0

    def __post_init__(self) -> None:
        values = np.asarray(self.values, np.float64)
        covariance = np.asarray(self.covariance, np.float64)
        if values.shape != (4,) or covariance.shape != (4, 4):
            raise ValueError("a node needs 4 values and their 4 x 4 covariance")
        if np.linalg.eigvalsh(covariance)[0] <= 0:
            raise ValueError("the covariance of a node must be positive definite")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "covariance", covariance)

    @classmethod
    def from_camera(
        cls,
        steps: tuple[int, int],
        camera: Sequence[float],
        covariance: FloatArray,
        *,
        pitch_x_mm: float,
        sharp_mm: Measured | None = None,
        pupil_mm: Measured | None = None,
        fill: float = 1.0,
    ) -> LensNode:
        """From a camera fit in pixels.

        Args:
            steps: of zoom and focus.
            camera: fx (px), cx, cy (px), k1 (OpenCV's).
            covariance: (4, 4) of them.
            pitch_x_mm: width of a pixel.
            sharp_mm: as the attribute.
            pupil_mm: as the attribute.
            fill: as the attribute.
        """
        fx, cx, cy, k1 = camera
        f_cal = fx * pitch_x_mm
        slope = np.diag([pitch_x_mm, 1.0, 1.0, f_cal**-2])
        slope[3, 0] = -2 * k1 / f_cal**3 * pitch_x_mm
        values = np.array([f_cal, cx, cy, k1 / f_cal**2])
        found = slope @ np.asarray(covariance, np.float64) @ slope.T
        return cls(*steps, values, found, sharp_mm, pupil_mm, fill)

    @property
    def f_cal_mm(self) -> float:
        """Principal distance."""
        return float(self.values[0])

    @property
    def f_cal_sigma_mm(self) -> float:
        """One standard deviation of the principal distance."""
        return float(np.sqrt(self.covariance[0, 0]))


@dataclass(frozen=True, eq=False)
class NodeSet:
    """Nodes as arrays, sorted by zoom, then focus.

    Attributes:
        nodes: (n,).
        zoom_steps: (z,), distinct and rising.
        focus_steps: (k,), distinct and rising.
        zoom_of: (n,), index of each node's zoom.
        focus_of: (n,), index of each node's focus.
        values: (n, 4) of ``NODE_NAMES``.
        covariances: (n, 4, 4).
    """

    nodes: tuple[LensNode, ...]
    zoom_steps: IntArray
    focus_steps: IntArray
    zoom_of: IntArray
    focus_of: IntArray
    values: FloatArray
    covariances: FloatArray

    @classmethod
    def of(cls, nodes: Sequence[LensNode]) -> NodeSet:
        """Sort and index.

        Raises:
            ValueError: no node, or two with the same steps (average repeats first).
        """
        if not nodes:
            raise ValueError("there are no nodes")
        ordered = tuple(sorted(nodes, key=lambda node: (node.zoom, node.focus)))
        if len({(node.zoom, node.focus) for node in ordered}) < len(ordered):
            raise ValueError("two nodes have the same steps")
        zooms, zoom_of = np.unique([n.zoom for n in ordered], return_inverse=True)
        focuses, focus_of = np.unique([n.focus for n in ordered], return_inverse=True)
        return cls(
            ordered,
            zooms,
            focuses,
            zoom_of.astype(np.int64),
            focus_of.astype(np.int64),
            np.stack([node.values for node in ordered]),
            np.stack([node.covariance for node in ordered]),
        )

    def __len__(self) -> int:
        return len(self.nodes)

    @property
    def fill(self) -> FloatArray:
        """(n,): share of the short side that the target filled."""
        return np.array([node.fill for node in self.nodes])

    def measured(self, name: str) -> tuple[IntArray, FloatArray, FloatArray]:
        """Node index, value and sigma where ``sharp_mm`` or ``pupil_mm`` was measured."""
        pairs = [(i, getattr(n, name)) for i, n in enumerate(self.nodes)]
        there = [(i, found) for i, found in pairs if found is not None]
        return (
            np.array([i for i, _ in there], dtype=np.int64),
            np.array([found.value for _, found in there]),
            np.array([found.sigma for _, found in there]),
        )
