"""Camera calibration from many views of a target, and how far it can be trusted.

The free numbers and all poses are found together by minimising the reprojection error.
Cross-validation holds whole views out: with the camera of the other views, the pose of a
held-out view is found from every second of its points and tested on the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.bundle import BundleProblem, BundleState, Freedom, freedom
from calibration.camera_start import poses_with, start_from_planes
from calibration.camera_verdict import doubtful, judge_camera
from calibration.estimate import (
    Estimate,
    Fit,
    FitOptions,
    WeakDirection,
    fit,
    out_of_sample,
    weakest_direction,
)
from calibration.projection import CAMERA_NAMES, PinholeCamera, project
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from calibration.observations import Observations
    from calibration.verdict import Verdict
    from mvp.geometry import BoolArray, FloatArray, IntArray

_FOLDS = 5
_ROBUST_ROUNDS = 4
_LEAST_TO_VOTE = 4
_VOTE = 1.0


@dataclass(frozen=True)
class CameraOptions:
    """How a camera is calibrated.

    Attributes:
        free: which of ``CAMERA_NAMES`` are estimated.
        tied_focal: fy / fx is known (``aspect``) and kept.
        aspect: fy / fx at the start: pixel pitch x / pitch y.
        sigma_px: one standard deviation of a found coordinate; None: not known, then
            it is taken from the residuals.
        priors: mean and one standard deviation of some of ``CAMERA_NAMES``.
        huber: corners beyond this many standard deviations count linearly.
        folds: of the cross-validation; 0: none.
        target_faces_camera: the target's z axis points away from the camera, as with x
            to the right and y down on a printed target; a mirrored one is then noticed.
    """

    free: tuple[str, ...] = CAMERA_NAMES
    tied_focal: bool = False
    aspect: float = 1.0
    sigma_px: float | None = None
    priors: tuple[tuple[str, float, float], ...] = ()
    huber: float | None = None
    folds: int = _FOLDS
    target_faces_camera: bool = True


@dataclass(frozen=True, eq=False)
class CameraEstimate:
    """The camera, the poses, and how good they are.

    Attributes:
        camera: the nine numbers.
        state: the camera with ``camera_from_target`` of every view.
        estimate: covariance (camera first, then six for each view), condition, weakest
            direction, chi-square.
        free: which numbers of the camera were estimated.
        errors_px: (m, 2), predicted less found.
        rms_px: root mean square of the distance of a point, as OpenCV reports it.
        view_names: of the views.
        view_rms_px: (views,), the same for each view.
        sigma_px: one standard deviation of a coordinate: assumed, or from the residuals.
        out_of_sample_px: root mean square distance on held-out views; None: not tested.
        verdict: with causes.
    """

    camera: PinholeCamera
    state: BundleState[PinholeCamera]
    estimate: Estimate
    free: Freedom
    errors_px: FloatArray
    rms_px: float
    view_names: tuple[str, ...]
    view_rms_px: FloatArray
    sigma_px: float
    out_of_sample_px: float | None
    verdict: Verdict

    @property
    def camera_covariance(self) -> FloatArray:
        """(9, 9) of ``CAMERA_NAMES``; zero where a number was held."""
        basis = self.free.basis
        return np.asarray(basis @ self.estimate.block(self.free.names) @ basis.T)

    @property
    def weakest(self) -> WeakDirection:
        """The worst determined combination of the camera's own numbers."""
        block = self.estimate.block(self.free.names)
        return weakest_direction(self.free.names, block, self.free.scales)

    def sigma_of(self, name: str) -> float:
        """One standard deviation of one of ``CAMERA_NAMES``."""
        index = CAMERA_NAMES.index(name)
        return float(np.sqrt(self.camera_covariance[index, index]))


def calibrate_camera(
    seen: Observations,
    options: CameraOptions | None = None,
    *,
    start: BundleState[PinholeCamera] | None = None,
) -> CameraEstimate:
    """Find the camera and the pose of every view.

    Args:
        seen: at least one view; of a flat target unless ``start`` is given.
        options: what is free, and the noise.
        start: camera and poses to begin with.

    Raises:
        CalibrationError: a view gives no pose, or there are too few points for the
            unknowns.
    """
    options = options or CameraOptions()
    if start is None and not seen.planar():
        raise ValueError("a target that is not flat (z = 0) needs a start")
    start = start or start_from_planes(seen, aspect=options.aspect)
    problem, found = _solved(seen, options, start)
    errors = problem.errors_px(found.state)
    squares = (errors**2).sum(axis=1)
    tested = _held_out_rms(seen, options, found.state)
    sigma = float(np.max(problem.sigma_px))
    view_rms = np.sqrt(np.bincount(seen.view, squares) / np.bincount(seen.view))
    verdict = judge_camera(
        seen,
        found.state,
        found.estimate,
        view_rms_px=view_rms,
        apart_rms_px=_told_apart(seen, options, found, view_rms),
        out_of_sample_px=tested,
        sigma_assumed_px=options.sigma_px,
        faces_camera=options.target_faces_camera,
    )
    return CameraEstimate(
        found.state.camera,
        found.state,
        found.estimate,
        problem.free,
        errors,
        float(np.sqrt(squares.mean())),
        seen.names,
        view_rms,
        sigma,
        tested,
        verdict,
    )


def _told_apart(
    seen: Observations,
    options: CameraOptions,
    found: Fit[BundleState[PinholeCamera]],
    view_rms_px: FloatArray,
) -> FloatArray:
    """Residual of each view (RMS, px), a wrong one not shared out among the others.

    Least squares bends the camera towards a wrong view until all views fit badly; a
    robust fit leaves the error where it is. Where nothing is doubtful, as it was.
    """
    suspicious = doubtful(found.estimate, view_rms_px, options.sigma_px)
    if not suspicious or options.huber is not None or seen.views < _LEAST_TO_VOTE:
        return view_rms_px
    try:
        problem, robust = _solved(seen, replace(options, huber=_VOTE), found.state)
    except CalibrationError:
        return view_rms_px
    squares = (problem.errors_px(robust.state) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(np.bincount(seen.view, squares) / np.bincount(seen.view)))


def _solved(
    seen: Observations, options: CameraOptions, start: BundleState[PinholeCamera]
) -> tuple[BundleProblem[PinholeCamera], Fit[BundleState[PinholeCamera]]]:
    try:
        problem = _problem(seen, options, start.camera, options.sigma_px or 1.0)
        if options.sigma_px is None:
            first = fit(problem, start, FitOptions(noise_known=False))
            start, sigma = first.state, _noise_px(first.estimate, options.huber)
            problem = _problem(seen, options, start.camera, sigma)
            for _ in range(_ROBUST_ROUNDS if options.huber else 0):
                again = fit(problem, start, FitOptions(huber=options.huber))
                start = again.state
                sigma *= _noise_px(again.estimate, options.huber)
                problem = _problem(seen, options, start.camera, sigma)
        how = FitOptions(huber=options.huber, noise_known=options.sigma_px is not None)
        return problem, fit(problem, start, how)
    except ValueError as error:
        raise CalibrationError(
            f"the camera cannot be calibrated from {seen.views} view(s): {error}",
            hint="take more views, or hold some parameters",
        ) from error


def _noise_px(estimate: Estimate, huber: float | None) -> float:
    """One standard deviation of a residual; a robust fit takes it from the median."""
    if huber is not None:
        return float(1.4826 * np.median(np.abs(estimate.residuals))) or 1.0
    return float(np.sqrt(estimate.variance_factor)) or 1.0


def _problem(
    seen: Observations, options: CameraOptions, camera: PinholeCamera, sigma_px: float
) -> BundleProblem[PinholeCamera]:
    half_diagonal_px = float(np.hypot(seen.width_px, seen.height_px) / 2)
    free = freedom(
        camera,
        options.free,
        tied_focal=options.tied_focal,
        half_diagonal_px=half_diagonal_px,
    )
    return BundleProblem(seen, free, sigma_px, options.priors)


def _held_out_rms(
    seen: Observations, options: CameraOptions, best: BundleState[PinholeCamera]
) -> float | None:
    folds = min(options.folds, seen.views)
    if folds < 2:
        return None

    def fitted_on(views: IntArray) -> PinholeCamera:
        return _solved(seen.of_views(views), options, best.of_views(views))[
            1
        ].state.camera

    def errors_of(camera: PinholeCamera, views: IntArray) -> FloatArray:
        return held_out_errors_px(camera, seen.of_views(views))

    try:
        errors = out_of_sample(seen.views, folds, fitted_on, errors_of)
    except CalibrationError:
        return None
    return float(np.sqrt(2 * (errors**2).mean()))


def held_out_errors_px(camera: PinholeCamera, seen: Observations) -> FloatArray:
    """Errors (k, 2) of points that had no part in the pose of their view.

    The pose of each view is found from every second point with the camera held fixed.
    """
    even = _every_second(seen)
    poses = poses_with(camera, _rows(seen, even))
    rows = seen.view[~even]
    predicted = project(
        camera,
        poses.rotation[rows],
        poses.translation_mm[rows],
        seen.points_target_mm[~even],
    )
    return predicted - seen.pixels[~even]


def _every_second(seen: Observations) -> BoolArray:
    first = np.searchsorted(seen.view, seen.view)
    return np.asarray((np.arange(len(seen.view)) - first) % 2 == 0)


def _rows(seen: Observations, chosen: BoolArray) -> Observations:
    return replace(
        seen,
        points_target_mm=seen.points_target_mm[chosen],
        pixels=seen.pixels[chosen],
        view=seen.view[chosen],
    )
