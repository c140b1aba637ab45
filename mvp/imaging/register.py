"""Where the picture lies against the prediction: a similarity from edge offsets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.edge_samples import Line

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import BoolArray, FloatArray
    from mvp.imaging.expectation import DrawnEdges

_ROUNDS = 12
_SMALLEST_SCATTER_PX = 0.15
_OFFSET_FLOOR_PX = 0.05
_QUARTER = 0.3
# Weak beliefs that only matter when edges of one direction are left.
_PRIOR_SD = np.array([60.0, 60.0, 0.15, 0.3])


@dataclass(frozen=True)
class Alignment:
    """p' = scale R(roll) p + shift, ideal px about the principal point."""

    shift_x_px: float = 0.0
    shift_y_px: float = 0.0
    roll_rad: float = 0.0
    scale: float = 1.0

    @property
    def shift_px(self) -> float:
        """Length of the shift."""
        return float(np.hypot(self.shift_x_px, self.shift_y_px))

    @property
    def matrix(self) -> FloatArray:
        """Scale R(roll), (2, 2)."""
        cos, sin = np.cos(self.roll_rad), np.sin(self.roll_rad)
        return self.scale * np.array([[cos, -sin], [sin, cos]])

    def apply(self, points_px: FloatArray) -> FloatArray:
        """Expected to actual place, (..., 2)."""
        shift = np.array([self.shift_x_px, self.shift_y_px])
        return np.asarray(points_px @ self.matrix.T + shift)

    def line(self, start_px: FloatArray, end_px: FloatArray) -> Line:
        """An expected line where it should be now."""
        return Line(self.apply(start_px), self.apply(end_px))

    def drawn(self, edges: DrawnEdges) -> DrawnEdges:
        """All predicted lines where they should be now."""
        return replace(
            edges,
            start_px=self.apply(edges.start_px),
            end_px=self.apply(edges.end_px),
        )

    def then(self, finer: Alignment) -> Alignment:
        """This one first, then a finer one."""
        shift = finer.apply(np.array([self.shift_x_px, self.shift_y_px]))
        return Alignment(
            float(shift[0]),
            float(shift[1]),
            self.roll_rad + finer.roll_rad,
            self.scale * finer.scale,
        )


@dataclass(frozen=True, eq=False)
class AlignmentFit:
    """A robust fit of an alignment to edge offsets.

    Attributes:
        alignment: the similarity.
        residual_px: (n,) offset of each edge that the similarity leaves.
        inlier: (n,) edges it agrees with.
        rms_px: of the inliers' residuals.
        scale_sd: standard deviation of the scale.
    """

    alignment: Alignment
    residual_px: FloatArray
    inlier: BoolArray
    rms_px: float
    scale_sd: float


def fit_alignment(
    expected: Sequence[Line], measured: Sequence[Line], sd_px: FloatArray
) -> AlignmentFit:
    """Robust similarity that moves the expected lines onto the measured ones.

    Args:
        expected: lines where they should be.
        measured: lines of the same edges in the picture.
        sd_px: (n,) standard deviation of the offsets.
    """
    rows, right = _equations(expected, measured)
    weight_sd = np.repeat(np.hypot(sd_px, _OFFSET_FLOOR_PX), 2)
    solution, covariance = _robust(rows, right, weight_sd)
    left = right - rows @ solution
    residual = left.reshape(-1, 2).mean(axis=1)
    scatter = max(1.4826 * float(np.median(np.abs(left))), _SMALLEST_SCATTER_PX)
    inlier = np.abs(residual) < 4 * np.hypot(scatter, sd_px)
    rms = float(np.sqrt(np.mean(residual[inlier] ** 2))) if inlier.any() else np.inf
    alignment = Alignment(
        float(solution[0]),
        float(solution[1]),
        float(np.arctan2(solution[2], 1 + solution[3])),
        float(np.hypot(1 + solution[3], solution[2])),
    )
    scale_sd = float(np.sqrt(covariance[3, 3]))
    return AlignmentFit(alignment, residual, np.asarray(inlier), rms, scale_sd)


def _equations(
    expected: Sequence[Line], measured: Sequence[Line]
) -> tuple[FloatArray, FloatArray]:
    """Two points per edge: n . (d + w J p + s p) = offset there."""
    rows, right = [], []
    for line, found in zip(expected, measured, strict=True):
        normal = found.across
        for share in (-_QUARTER, _QUARTER):
            point = line.middle_px + share * line.length_px * line.along
            turned = np.array([-point[1], point[0]])
            rows.append([normal[0], normal[1], normal @ turned, normal @ point])
            right.append(float(normal @ (found.middle_px - point)))
    return np.array(rows).reshape(-1, 4), np.array(right)


def _robust(
    rows: FloatArray, right: FloatArray, sd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Iteratively reweighted least squares, first L1, then Tukey's biweight.

    Returns the solution and its covariance.
    """
    weight = 1 / sd
    prior = np.diag(1 / _PRIOR_SD**2)
    solution: FloatArray = np.zeros(rows.shape[1])
    system = prior
    for number in range(_ROUNDS):
        scaled = rows * (weight**2)[:, None]
        system = rows.T @ scaled + prior
        solution = np.asarray(np.linalg.solve(system, scaled.T @ right))
        left = np.abs(right - rows @ solution)
        scatter = max(1.4826 * float(np.median(left)), _SMALLEST_SCATTER_PX)
        spread = np.hypot(scatter, sd)
        if number < _ROUNDS // 2:
            weight = np.asarray(np.sqrt(1 / np.maximum(left / spread, 0.3)) / spread)
        else:
            weight = np.asarray(
                np.clip(1 - (left / (4.7 * spread)) ** 2, 0, 1) / spread
            )
    return solution, np.asarray(np.linalg.inv(system))
