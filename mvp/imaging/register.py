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

_ROUNDS = 8
_TRIMMINGS = 4
_MOST_STARTS = 600
_KEPT_STARTS = 10
_CUT = 2.5
# Standard deviation over upper quartile of the root mean square of two normal deviates.
_RAYLEIGH = 0.8493
_SMALLEST_SCATTER_PX = 0.15
_ROUNDING_PX = 0.02
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
    equations = _equations(expected, measured)
    solution, weight = equations.robust(np.hypot(sd_px, _OFFSET_FLOOR_PX))
    left = equations.left(solution)
    residual = left.mean(axis=-1)
    scatter = max(1.4826 * float(np.median(np.abs(left))), _SMALLEST_SCATTER_PX)
    spread = np.hypot(scatter, sd_px)
    inlier = np.abs(residual) < 4 * spread
    rms = float(np.sqrt(np.mean(residual[inlier] ** 2))) if inlier.any() else np.inf
    alignment = Alignment(
        float(solution[0]),
        float(solution[1]),
        float(np.arctan2(solution[2], 1 + solution[3])),
        float(np.hypot(1 + solution[3], solution[2])),
    )
    covariance = np.linalg.inv(equations.system(weight / spread**2))
    scale_sd = float(np.sqrt(covariance[3, 3]))
    return AlignmentFit(alignment, residual, np.asarray(inlier), rms, scale_sd)


def _equations(expected: Sequence[Line], measured: Sequence[Line]) -> _Equations:
    """Two points per edge: n . (d + w J p + s p) = offset there."""
    rows, right = [], []
    for line, found in zip(expected, measured, strict=True):
        normal = found.across
        for share in (-_QUARTER, _QUARTER):
            point = line.middle_px + share * line.length_px * line.along
            turned = np.array([-point[1], point[0]])
            rows.append([normal[0], normal[1], normal @ turned, normal @ point])
            right.append(float(normal @ (found.middle_px - point)))
    return _Equations(np.array(rows).reshape(-1, 2, 4), np.array(right).reshape(-1, 2))


@dataclass(frozen=True, eq=False)
class _Equations:
    """Two linear equations for the similarity from each of n edges.

    Solutions are (..., 4), weights of the edges (..., n).
    """

    rows: FloatArray
    right: FloatArray

    def system(self, weight: FloatArray) -> FloatArray:
        """Normal equations (..., 4, 4) with the weak beliefs."""
        gram = np.einsum("nki,nkj->nij", self.rows, self.rows)
        return np.asarray(
            np.tensordot(weight, gram, axes=1) + np.diag(1 / _PRIOR_SD**2)
        )

    def solved(self, weight: FloatArray) -> FloatArray:
        """Weighted least squares."""
        right = weight @ np.einsum("nki,nk->ni", self.rows, self.right)
        return np.asarray(
            np.linalg.solve(self.system(weight), right[..., None])[..., 0]
        )

    def left(self, solution: FloatArray) -> FloatArray:
        """What solutions leave of the equations, (..., n, 2)."""
        reached = np.einsum("nki,...i->...nk", self.rows, solution)
        return np.asarray(self.right - reached)

    def missed(self, solution: FloatArray) -> FloatArray:
        """Root mean square of what they leave of each edge, (..., n)."""
        return np.asarray(np.sqrt(np.mean(self.left(solution) ** 2, axis=-1)))

    def robust(self, sd_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The solution that most edges agree on, and the edges' weights, 0 to 1.

        Starts from every pair of edges and from all of them together; the pairs that
        suit three of four edges best, and all, are refined by Tukey's biweight, and the
        one with the smallest cost is taken. An edge counts as a whole, by its own
        standard deviation.
        """
        best = self._trimmed(sd_px)
        missed = np.sort(self.missed(best[0]))[_most(len(sd_px)) - 1]
        freedom = max(len(sd_px) - 2, 1) / len(sd_px)
        scatter = _RAYLEIGH * float(missed) / np.sqrt(freedom)
        spread = np.hypot(max(scatter, _ROUNDING_PX), sd_px)
        everything = np.ones((1, len(sd_px)))
        solution = np.concatenate([self.solved(everything / sd_px**2), best])
        for _ in range(_ROUNDS):
            weight = _biweight(self.missed(solution) / spread)
            solution = self.solved(weight / spread**2)
        agreed = np.clip(1 - (self.missed(solution) / spread / _CUT) ** 2, 0, 1)
        chosen = int(np.argmin((1 - agreed**3).sum(axis=-1)))
        return solution[chosen], weight[chosen]

    def _trimmed(self, sd_px: FloatArray) -> FloatArray:
        """Least trimmed squares over three of four edges, the best few (m, 4)."""
        count = len(sd_px)
        first, second = np.triu_indices(count, 1)
        step = -(-len(first) // _MOST_STARTS) or 1
        pairs = np.zeros((len(first[::step]), count))
        np.put_along_axis(pairs, first[::step, None], 1.0, axis=1)
        np.put_along_axis(pairs, second[::step, None], 1.0, axis=1)
        chosen = np.concatenate([np.ones((1, count)), pairs])
        most = _most(count)
        for _ in range(_TRIMMINGS):
            solution = self.solved(chosen / sd_px**2)
            missed = (self.missed(solution) / sd_px) ** 2
            cost = np.partition(missed, most - 1, axis=-1)[:, :most].sum(axis=-1)
            best = np.argsort(cost, kind="stable")[:_KEPT_STARTS]
            limit = np.partition(missed[best], most - 1, axis=-1)[:, most - 1]
            chosen = (missed[best] <= limit[:, None]).astype(np.float64)
        return solution[best]


def _most(count: int) -> int:
    """Three of four edges, of which the fit takes for granted that they are right."""
    return -(-3 * count // 4)


def _biweight(share: FloatArray) -> FloatArray:
    """Tukey's weights of residuals in units of their spread."""
    return np.asarray(np.clip(1 - (share / _CUT) ** 2, 0, 1) ** 2)
