"""How far the camera is from its planned pose, from edge offsets at known depth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import FloatArray, Pose

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mvp.imaging.edge_samples import Line
    from mvp.imaging.expectation import DrawnEdges, ExpectedEdge
    from mvp.imaging.measure_plane import ImagePlane

_ROUNDS = 8
_STEP = 1e-4
# What a pose error may be at all: it decides only what the edges leave open.
_PRIOR_SD = np.array([20.0, 20.0, 20.0, 0.1, 0.1, 0.1])
_OFFSET_SD_PX = 0.05
_FEWEST_EDGES = 4
_SMALLEST_SCATTER_PX = 0.15


@dataclass(frozen=True, eq=False)
class PoseOffset:
    """Motion of the part in the planned camera's frame that explains the picture.

    Attributes:
        position_mm: (3,) shift along the camera's axes.
        rotvec_rad: (3,) turn about the camera's axes.
        sd: (6,) standard deviations of both, mm and rad.
        residual_px: root mean square of what is left.
    """

    position_mm: FloatArray
    rotvec_rad: FloatArray
    sd: FloatArray
    residual_px: float

    def places(self, points_camera: FloatArray, plane: ImagePlane) -> FloatArray:
        """Where points (..., 3) of the plan appear, ideal px (..., 2)."""
        moved = Pose.from_rotvec(
            "camera", "camera", self.rotvec_rad, self.position_mm
        ).apply(points_camera)
        return plane.project(moved)

    def drawn(self, edges: DrawnEdges, plane: ImagePlane) -> DrawnEdges:
        """All predicted lines where they should be now."""
        return replace(
            edges,
            start_px=self.places(edges.start_mm, plane),
            end_px=self.places(edges.end_mm, plane),
        )


def fit_pose(
    edges: Sequence[ExpectedEdge], lines: Sequence[Line], plane: ImagePlane
) -> PoseOffset | None:
    """Least squares over six coordinates; None with fewer than four edges.

    Args:
        edges: expected edges, camera frame.
        lines: the measured line of each.
        plane: the planned lens.
    """
    if len(edges) < _FEWEST_EDGES:
        return None
    share = np.array([0.2, 0.8])[:, None, None]
    starts = np.array([e.start_mm for e in edges])
    ends = np.array([e.end_mm for e in edges])
    points = (starts * (1 - share) + ends * share).reshape(-1, 3)
    normals = np.tile([line.across for line in lines], (2, 1))
    middles = np.tile([line.middle_px for line in lines], (2, 1))

    def offsets(x: FloatArray) -> FloatArray:
        moved = Pose.from_rotvec("camera", "camera", x[3:], x[:3]).apply(points)
        places = plane.project(moved)
        return np.asarray(((middles - places) * normals).sum(axis=1))

    x = np.zeros(6)
    prior = np.diag((_OFFSET_SD_PX / _PRIOR_SD) ** 2)
    gram, weight = prior, np.ones(len(points))
    for _ in range(_ROUNDS):
        left = offsets(x)
        jacobian = _jacobian(offsets, x, left)
        weighted = jacobian * weight[:, None]
        gram = weighted.T @ jacobian + prior
        x = x - np.linalg.solve(gram, weighted.T @ left + prior @ x)
        weight = _tukey(offsets(x))
    left = offsets(x)
    residual = float(np.sqrt((weight * left**2).sum() / max(weight.sum(), 1e-9)))
    sd = np.sqrt(np.diag(np.linalg.inv(gram))) * max(residual, _OFFSET_SD_PX)
    return PoseOffset(x[:3], x[3:], sd, residual)


def _tukey(left: FloatArray) -> FloatArray:
    scatter = max(1.4826 * float(np.median(np.abs(left))), _SMALLEST_SCATTER_PX)
    return np.asarray(np.clip(1 - (left / (4.7 * scatter)) ** 2, 0.0, 1.0) ** 2)


def _jacobian(
    offsets: Callable[[FloatArray], FloatArray], x: FloatArray, left: FloatArray
) -> FloatArray:
    return np.stack(
        [(offsets(x + _STEP * unit) - left) / _STEP for unit in np.eye(6)], axis=1
    )
