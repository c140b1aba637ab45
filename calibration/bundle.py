"""Camera and one pose per view against everything that was seen, as a least squares.

Which of the nine camera numbers are free, tied or held is a matrix: a step of the free
parameters times ``basis`` is the change of the nine numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from calibration.projection import (
    CAMERA_NAMES,
    POSE_NAMES,
    PinholeCamera,
    moved_pose,
    project,
    project_with_derivatives,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.observations import Observations
    from mvp.geometry import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Freedom:
    """Which parameters of the camera may move, and how.

    Attributes:
        names: (n,) of the free parameters.
        basis: (9, n): change of ``CAMERA_NAMES`` for a unit step of each.
        scales: (n,): steps of like importance, about what moves a corner by 1 px.
    """

    names: tuple[str, ...]
    basis: FloatArray
    scales: FloatArray


def freedom(
    camera: PinholeCamera,
    free: Sequence[str],
    *,
    tied_focal: bool = False,
    half_diagonal_px: float = 1000.0,
) -> Freedom:
    """Free some of ``CAMERA_NAMES``.

    Args:
        camera: a start; its fy / fx is kept when the two are tied.
        free: the names.
        tied_focal: fx and fy keep their ratio; name ``fx_px`` only.
        half_diagonal_px: of the image; sets the scale of the distortion.
    """
    wanted = [name for name in free if not (tied_focal and name == "fy_px")]
    index = [CAMERA_NAMES.index(name) for name in wanted]
    basis = np.eye(9)[:, index]
    if tied_focal and "fx_px" in wanted:
        basis[1, wanted.index("fx_px")] = camera.fy_px / camera.fx_px
    reach = half_diagonal_px / camera.fx_px
    powers = np.array([0, 0, 0, 0, 3, 5, 2, 2, 7])
    scales = np.where(powers == 0, 1.0, 1 / (half_diagonal_px * reach ** (powers - 1)))
    scales[:2] = 1 / reach
    return Freedom(tuple(wanted), basis, scales[index])


@dataclass(frozen=True, eq=False)
class BundleState:
    """A camera, and ``camera_from_target`` of every view.

    Attributes:
        camera: the nine numbers.
        rotation: (views, 3, 3).
        translation_mm: (views, 3).
    """

    camera: PinholeCamera
    rotation: FloatArray
    translation_mm: FloatArray

    @property
    def tilt_rad(self) -> FloatArray:
        """(views,): angle between the target's z axis and the optical axis."""
        return np.asarray(np.arccos(np.clip(np.abs(self.rotation[:, 2, 2]), 0, 1)))

    def of_views(self, numbers: Sequence[int] | IntArray) -> BundleState:
        """The same camera with some of the poses."""
        index = np.asarray(numbers, dtype=np.int64)
        return BundleState(
            self.camera, self.rotation[index], self.translation_mm[index]
        )


@dataclass(frozen=True, eq=False)
class BundleProblem:
    """Reprojection errors of all views, whitened by the noise of a corner.

    Attributes:
        seen: the observations.
        free: of the camera; empty names hold it.
        sigma_px: (m,) or a number: one standard deviation of a coordinate.
        priors: mean and standard deviation of some of ``CAMERA_NAMES``.
    """

    seen: Observations
    free: Freedom
    sigma_px: FloatArray | float
    priors: tuple[tuple[str, float, float], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The camera's names, then six for each view."""
        views = self.seen.names
        return self.free.names + tuple(f"{v}: {n}" for v in views for n in POSE_NAMES)

    @property
    def scales(self) -> FloatArray:
        """About what moves a corner by 1 px: for directions in words only."""
        reach = np.ptp(self.seen.points_target_mm, axis=0).max()
        focal = max(self.seen.width_px, self.seen.height_px)
        pose = [reach / focal] * 3 + [1 / focal] * 3
        return np.concatenate([self.free.scales, pose * self.seen.views])

    @property
    def prior_rows(self) -> int:
        """One for each prior."""
        return len(self.priors)

    def errors_px(self, state: BundleState) -> FloatArray:
        """(m, 2): predicted less found."""
        rows = self.seen.view
        predicted = project(
            state.camera,
            state.rotation[rows],
            state.translation_mm[rows],
            self.seen.points_target_mm,
        )
        return predicted - self.seen.pixels

    def residuals(self, state: BundleState) -> FloatArray:
        """(2 m + priors,), whitened."""
        errors = self.errors_px(state) / self._sigma()[:, None]
        values = dict(zip(CAMERA_NAMES, state.camera.values, strict=True))
        prior = [(values[name] - mean) / sd for name, mean, sd in self.priors]
        return np.concatenate([errors.ravel(), prior])

    def jacobian(self, state: BundleState) -> sparse.csr_matrix:
        """(2 m + priors, n + 6 views)."""
        rows, n = self.seen.view, len(self.free.names)
        found = project_with_derivatives(
            state.camera,
            state.rotation[rows],
            state.translation_mm[rows],
            self.seen.points_target_mm,
        )
        values = np.concatenate([found.d_camera @ self.free.basis, found.d_pose], -1)
        values = values / self._sigma()[:, None, None]
        own = n + 6 * rows[:, None] + np.arange(6)
        columns = np.concatenate([np.tile(np.arange(n), (len(rows), 1)), own], axis=1)
        columns = np.repeat(columns[:, None], 2, axis=1)
        bounds = np.arange(0, values.size + 1, n + 6)
        shape = (2 * len(rows), n + 6 * self.seen.views)
        matrix = sparse.csr_matrix((values.ravel(), columns.ravel(), bounds), shape)
        return sparse.vstack([matrix, self._prior_rows(shape[1])], format="csr")

    def moved(self, state: BundleState, step: FloatArray) -> BundleState:
        """The state after a step of the free parameters and all poses."""
        n = len(self.free.names)
        camera = PinholeCamera.from_values(
            state.camera.values + self.free.basis @ step[:n]
        )
        poses = moved_pose(
            state.rotation, state.translation_mm, step[n:].reshape(-1, 6)
        )
        return BundleState(camera, *poses)

    def _sigma(self) -> FloatArray:
        return np.broadcast_to(
            np.asarray(self.sigma_px, np.float64), (len(self.seen.view),)
        )

    def _prior_rows(self, columns: int) -> sparse.csr_matrix:
        rows = np.zeros((len(self.priors), columns))
        for row, (name, _, sd) in zip(rows, self.priors, strict=True):
            row[: len(self.free.names)] = self.free.basis[CAMERA_NAMES.index(name)] / sd
        return sparse.csr_matrix(rows)
