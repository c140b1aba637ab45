"""Camera and one pose per view against everything that was seen, as a least squares.

The camera may be any model that projects with derivatives. Which of its numbers are free,
tied or held is a matrix: a step of the free parameters times ``basis`` is the change of
all numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import numpy as np
from scipy import sparse

from calibration.projection import (
    CAMERA_NAMES,
    POSE_NAMES,
    moved_pose,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Self

    from calibration.estimate import Jacobian
    from calibration.observations import Observations
    from calibration.projection import PinholeCamera, Projection
    from mvp.geometry import FloatArray, IntArray


class CameraModel(Protocol):
    """What the bundle needs of a camera."""

    @property
    def names(self) -> tuple[str, ...]:
        """One for each number, with its unit."""

    @property
    def values(self) -> FloatArray:
        """The numbers."""

    def with_values(self, values: FloatArray) -> Self:
        """The same kind of camera with other numbers."""

    def project(
        self, rotation: FloatArray, translation_mm: FloatArray, points: FloatArray
    ) -> FloatArray:
        """Points (..., 3) to pixels (..., 2); nan behind the camera."""

    def project_with_derivatives(
        self, rotation: FloatArray, translation_mm: FloatArray, points: FloatArray
    ) -> Projection:
        """The same with derivatives; ``d_camera`` is for ``names``."""


Camera = TypeVar("Camera", bound=CameraModel)


@dataclass(frozen=True, eq=False)
class Freedom:
    """Which parameters of the camera may move, and how.

    Attributes:
        names: (n,) of the free parameters.
        basis: (numbers, n): change of the camera's numbers for a unit step of each.
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
class BundleState(Generic[Camera]):
    """A camera, and ``camera_from_target`` of every view.

    Attributes:
        camera: its numbers.
        rotation: (views, 3, 3).
        translation_mm: (views, 3).
    """

    camera: Camera
    rotation: FloatArray
    translation_mm: FloatArray

    @property
    def tilt_rad(self) -> FloatArray:
        """(views,): angle between the target's z axis and the optical axis."""
        return np.asarray(np.arccos(np.clip(np.abs(self.rotation[:, 2, 2]), 0, 1)))

    def of_views(self, numbers: Sequence[int] | IntArray) -> BundleState[Camera]:
        """The same camera with some of the poses."""
        index = np.asarray(numbers, dtype=np.int64)
        return BundleState(
            self.camera, self.rotation[index], self.translation_mm[index]
        )


@dataclass(frozen=True, eq=False)
class BundleProblem(Generic[Camera]):
    """Reprojection errors of all views, whitened by the noise of a corner.

    Attributes:
        seen: the observations.
        free: of the camera; empty names hold it.
        sigma_px: (m,) or a number: one standard deviation of a coordinate.
        priors: mean and standard deviation of some of the camera's numbers.
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

    def errors_px(self, state: BundleState[Camera]) -> FloatArray:
        """(m, 2): predicted less found."""
        rows = self.seen.view
        predicted = state.camera.project(
            state.rotation[rows],
            state.translation_mm[rows],
            self.seen.points_target_mm,
        )
        return predicted - self.seen.pixels

    def residuals(self, state: BundleState[Camera]) -> FloatArray:
        """(2 m + priors,), whitened."""
        errors = self.errors_px(state) / self._sigma()[:, None]
        values = dict(zip(state.camera.names, state.camera.values, strict=True))
        prior = [(values[name] - mean) / sd for name, mean, sd in self.priors]
        return np.concatenate([errors.ravel(), prior])

    def jacobian(self, state: BundleState[Camera]) -> Jacobian:
        """(2 m + priors, n + 6 views); sparse where there are several views."""
        rows, n = self.seen.view, len(self.free.names)
        found = state.camera.project_with_derivatives(
            state.rotation[rows],
            state.translation_mm[rows],
            self.seen.points_target_mm,
        )
        values = np.concatenate([found.d_camera @ self.free.basis, found.d_pose], -1)
        values = values / self._sigma()[:, None, None]
        if self.seen.views == 1:
            priors = self._prior_rows(state.camera.names, n + 6)
            return np.concatenate([values.reshape(-1, n + 6), priors])
        own = n + 6 * rows[:, None] + np.arange(6)
        columns = np.concatenate([np.tile(np.arange(n), (len(rows), 1)), own], axis=1)
        columns = np.repeat(columns[:, None], 2, axis=1)
        bounds = np.arange(0, values.size + 1, n + 6)
        shape = (2 * len(rows), n + 6 * self.seen.views)
        matrix = sparse.csr_matrix((values.ravel(), columns.ravel(), bounds), shape)
        priors = sparse.csr_matrix(self._prior_rows(state.camera.names, shape[1]))
        return sparse.vstack([matrix, priors], format="csr")

    def moved(
        self, state: BundleState[Camera], step: FloatArray
    ) -> BundleState[Camera]:
        """The state after a step of the free parameters and all poses."""
        n = len(self.free.names)
        camera = state.camera.with_values(
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

    def _prior_rows(self, names: tuple[str, ...], columns: int) -> FloatArray:
        rows = np.zeros((len(self.priors), columns))
        for row, (name, _, sd) in zip(rows, self.priors, strict=True):
            row[: len(self.free.names)] = self.free.basis[names.index(name)] / sd
        return rows
