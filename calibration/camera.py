"""Camera calibration from many views of a target, and how far it can be trusted.

The free numbers and all poses are found together by minimising the reprojection error.
Cross-validation holds whole views out: with the camera of the other views, the pose of a
held-out view is found from every second of its points and tested on the rest. The shape
of the target may be found with the camera (``target_shape``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calibration.bundle import BundleProblem, BundleState, Freedom, freedom
from calibration.camera_start import poses_with, start_from_planes
from calibration.camera_verdict import doubtful, judge_camera, noise_causes
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
from calibration.target_shape import (
    FoundShape,
    ShapedProblem,
    ShapedState,
    TargetShape,
)
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibration.estimate import Problem, State
    from calibration.observations import Observations
    from calibration.target_shape import ShapePrior
    from calibration.verdict import Cause, Verdict
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
        shape: what is known of the target's flatness, which is then estimated with the
            camera; None: the target is taken to be exactly as stated.
        largest_noise_px: residuals beyond it are not noise, whatever their size says of
            themselves; None: any size is believed.
    """

    free: tuple[str, ...] = CAMERA_NAMES
    tied_focal: bool = False
    aspect: float = 1.0
    sigma_px: float | None = None
    priors: tuple[tuple[str, float, float], ...] = ()
    huber: float | None = None
    folds: int = _FOLDS
    target_faces_camera: bool = True
    shape: ShapePrior | None = None
    largest_noise_px: float | None = None


@dataclass(frozen=True, eq=False)
class CameraEstimate:
    """The camera, the poses, and how good they are.

    Attributes:
        camera: the nine numbers.
        state: the camera with ``camera_from_target`` of every view.
        estimate: covariance (camera first, then six for each view, then the shape of the
            target), condition, weakest direction, chi-square.
        free: which numbers of the camera were estimated.
        errors_px: (m, 2), predicted less found.
        rms_px: root mean square of the distance of a point, as OpenCV reports it.
        view_names: of the views.
        view_rms_px: (views,), the same for each view.
        sigma_px: one standard deviation of a coordinate: assumed, or from the residuals.
        out_of_sample_px: root mean square distance on held-out views; None: not tested.
        verdict: with causes.
        shape: of the target; None: not asked for.
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
    shape: FoundShape | None = None

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
    found = _solved(seen, options, start)
    errors = found.problem.errors_px(found.state)
    squares = (errors**2).sum(axis=1)
    tested = _held_out_rms(seen, options, found)
    sigma = float(np.max(found.problem.sigma_px))
    view_rms = np.sqrt(np.bincount(seen.view, squares) / np.bincount(seen.view))
    shape = FoundShape.of(found.shape, found.estimate) if found.shape else None
    verdict = _judged(seen, options, found, view_rms, tested, shape)
    return CameraEstimate(
        found.state.camera,
        found.state,
        found.estimate,
        found.problem.free,
        errors,
        float(np.sqrt(squares.mean())),
        seen.names,
        view_rms,
        sigma,
        tested,
        verdict,
        shape,
    )


@dataclass(frozen=True, eq=False)
class _Solved:
    """A minimum: the problem with the target as it was found to be, and its state."""

    problem: BundleProblem[PinholeCamera]
    state: BundleState[PinholeCamera]
    estimate: Estimate
    shape: TargetShape | None = None


def _judged(
    seen: Observations,
    options: CameraOptions,
    found: _Solved,
    view_rms_px: FloatArray,
    tested_px: float | None,
    shape: FoundShape | None,
) -> Verdict:
    """With what noise and target say."""
    above = noise_causes(
        found.estimate,
        options.sigma_px,
        found_px=float(np.max(found.problem.sigma_px)),
        most_px=options.largest_noise_px,
    )
    return judge_camera(
        seen,
        found.state,
        found.estimate,
        view_rms_px=view_rms_px,
        apart_rms_px=_told_apart(seen, options, found, view_rms_px, above),
        out_of_sample_px=tested_px,
        faces_camera=options.target_faces_camera,
        more=(*above, *(shape.causes() if shape else ())),
    )


def _told_apart(
    seen: Observations,
    options: CameraOptions,
    found: _Solved,
    view_rms_px: FloatArray,
    above_noise: tuple[Cause, ...],
) -> FloatArray:
    """Residual of each view (RMS, px), a wrong one not shared out among the others.

    Least squares bends the camera towards a wrong view until all views fit badly; a
    robust fit leaves the error where it is. Where nothing is doubtful, as it was.
    """
    suspicious = bool(above_noise) or doubtful(view_rms_px)
    if not suspicious or options.huber is not None or seen.views < _LEAST_TO_VOTE:
        return view_rms_px
    try:
        robust = _solved(seen, replace(options, huber=_VOTE), found.state, found.shape)
    except CalibrationError:
        return view_rms_px
    squares = (robust.problem.errors_px(robust.state) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(np.bincount(seen.view, squares) / np.bincount(seen.view)))


def _solved(
    seen: Observations,
    options: CameraOptions,
    start: BundleState[PinholeCamera],
    shape: TargetShape | None = None,
) -> _Solved:
    """The minimum from a start; the target's shape is sought last, where not known."""
    sigma, flat = options.sigma_px or 1.0, partial(_problem, seen, options)
    try:
        if options.shape is None or shape is None:
            found, sigma = _at_its_noise(flat, start, sigma, options)
            if options.shape is None:
                return _Solved(flat(sigma, start), found.state, found.estimate)
            start, shape = found.state, TargetShape.flat(seen.points_target_mm)
        problem = partial(_shaped_problem, seen, options, options.shape)
        best, sigma = _at_its_noise(problem, ShapedState(start, shape), sigma, options)
    except ValueError as error:
        raise CalibrationError(
            f"the camera cannot be calibrated from {seen.views} view(s): {error}",
            hint="take more views, or hold some parameters",
        ) from error
    bundle, shape = best.state.bundle, best.state.shape
    bent = problem(sigma, best.state).bundle(shape)
    return _Solved(bent, bundle, best.estimate, shape)


def _at_its_noise(
    problem: Callable[[float, State], Problem[State]],
    start: State,
    sigma_px: float,
    options: CameraOptions,
) -> tuple[Fit[State], float]:
    """The best state, with the noise that was stated or that its residuals show."""
    known, huber = options.sigma_px is not None, options.huber
    if not known:
        first = fit(problem(sigma_px, start), start, FitOptions(noise_known=False))
        start = first.state
        sigma_px *= _noise(first.estimate, huber)
        for _ in range(_ROBUST_ROUNDS if huber else 0):
            again = fit(problem(sigma_px, start), start, FitOptions(huber=huber))
            start = again.state
            sigma_px *= _noise(again.estimate, huber)
    how = FitOptions(huber=huber, noise_known=known)
    return fit(problem(sigma_px, start), start, how), sigma_px


def _noise(estimate: Estimate, huber: float | None) -> float:
    """One standard deviation of a residual; a robust fit takes it from the median."""
    if huber is not None:
        return float(1.4826 * np.median(np.abs(estimate.residuals))) or 1.0
    freedom = estimate.degrees_of_freedom
    return float(np.sqrt(estimate.chi_square / freedom)) or 1.0 if freedom > 0 else 1.0


def _problem(
    seen: Observations,
    options: CameraOptions,
    sigma_px: float,
    state: BundleState[PinholeCamera],
) -> BundleProblem[PinholeCamera]:
    half_diagonal_px = float(np.hypot(seen.width_px, seen.height_px) / 2)
    free = freedom(
        state.camera,
        options.free,
        tied_focal=options.tied_focal,
        half_diagonal_px=half_diagonal_px,
    )
    return BundleProblem(seen, free, sigma_px, options.priors)


def _shaped_problem(
    seen: Observations,
    options: CameraOptions,
    prior: ShapePrior,
    sigma_px: float,
    state: ShapedState[PinholeCamera],
) -> ShapedProblem[PinholeCamera]:
    return ShapedProblem(_problem(seen, options, sigma_px, state.bundle), prior)


def _held_out_rms(
    seen: Observations, options: CameraOptions, best: _Solved
) -> float | None:
    folds = min(options.folds, seen.views)
    if folds < 2:
        return None

    def fitted_on(views: IntArray) -> _Solved:
        some = seen.of_views(views)
        return _solved(some, options, best.state.of_views(views), best.shape)

    def errors_of(found: _Solved, views: IntArray) -> FloatArray:
        some = seen.of_views(views)
        return held_out_errors_px(found.state.camera, some, found.shape)

    try:
        errors = out_of_sample(seen.views, folds, fitted_on, errors_of)
    except CalibrationError:
        return None
    return float(np.sqrt(2 * (errors**2).mean()))


def held_out_errors_px(
    camera: PinholeCamera, seen: Observations, shape: TargetShape | None = None
) -> FloatArray:
    """Errors (k, 2) of points that had no part in the pose of their view.

    The pose of each view is found from every second point with the camera held fixed.
    """
    if shape is not None:
        seen = replace(seen, points_target_mm=shape.moved(seen.points_target_mm))
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
