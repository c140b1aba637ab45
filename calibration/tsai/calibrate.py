"""Tsai's calibration to the end: both stages, full refinement, and a verdict.

The two stages give the start; all free numbers and the poses of all views are then
found together by least squares in the picture. A flat target parallel to the sensor
leaves f and Tz open while the residual stays perfect, so the tilt and the covariance
decide, not the residual.

One view of a flat target leaves sx with f: it is kept as given. Points in depth tell it,
and so do several flat views that are tilted about different axes. Where several views tell
it badly, it is kept unless they contradict it, and its doubt counts in the doubt of f.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from calibration.bundle import BundleProblem, BundleState, Freedom
from calibration.camera_verdict import FOCAL, RESIDUAL, TILT, noise_causes
from calibration.estimate import Estimate, Fit, FitOptions, fit, weakest_direction
from calibration.tsai.model import TSAI_NAMES, TsaiCamera
from calibration.tsai.stages import TwoStage, two_stage
from calibration.verdict import Cause, Verdict, judged
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from calibration.observations import Observations
    from calibration.verdict import Grade
    from mvp.geometry import FloatArray


_State: TypeAlias = BundleState[TsaiCamera]

_SCALE_TOLD = 0.0005  # one sigma; half a pixel over 1,000, what a digital camera keeps
_SCALE_OPEN = 0.005  # one sigma; no better than what is usually known of the clocks
_CONTRADICTED = 3.0  # sigmas between the given sx and what the views say
_SCALE_ACTION = (
    "of a digital camera it is 1 and can be held; otherwise take several views tilted by 25 to 40 deg about different axes, or a target with "
    "points in depth, or state sx from the clocks of camera and sampler"
)


@dataclass(frozen=True)
class TsaiOptions:
    """What is refined.

    Attributes:
        free_centre: the centre is refined too; one view of a flat target tells it badly.
        scale: whether sx is refined: where the views tell it well or contradict the
            given one, wherever they tell it (refused where not), or never: then it is
            a fact, and f is stated as well as with any other fact.
        sigma_px: one standard deviation of a coordinate; None: from the residuals.
        priors: mean and one standard deviation of some of ``TSAI_NAMES``.
    """

    free_centre: bool = False
    scale: Literal["where-seen", "free", "held"] = "where-seen"
    sigma_px: float | None = None
    priors: tuple[tuple[str, float, float], ...] = ()

    def __post_init__(self) -> None:
        unknown = [name for name, *_ in self.priors if name not in TSAI_NAMES]
        if unknown:
            raise ValueError(f"{unknown[0]} is none of {', '.join(TSAI_NAMES)}")


@dataclass(frozen=True, eq=False)
class _Solved:
    """The refined state, which numbers were free in it, and what is to be said of sx."""

    free: tuple[str, ...]
    problem: BundleProblem[TsaiCamera]
    found: Fit[_State]
    scale_causes: tuple[Cause, ...] = ()


@dataclass(frozen=True, eq=False)
class TsaiEstimate:
    """The refined camera and poses, the two stages before, and how good they are.

    Attributes:
        camera: refined.
        state: the camera with ``camera_from_target`` of every view.
        stages: the two-stage result of every view.
        estimate: covariance (free numbers of the camera, then six for each view); where
            several views tell a kept sx badly, with what that leaves open of the others.
        free: which numbers were refined.
        errors_px: (m, 2), predicted less found.
        rms_px: root mean square of the distance of a point.
        tilt_deg: the largest tilt of a view against the sensor.
        verdict: with causes.
    """

    camera: TsaiCamera
    state: _State
    stages: tuple[TwoStage, ...]
    estimate: Estimate
    free: tuple[str, ...]
    errors_px: FloatArray
    rms_px: float
    tilt_deg: float
    verdict: Verdict


def tsai_calibrate(
    camera: TsaiCamera, seen: Observations, options: TsaiOptions | None = None
) -> TsaiEstimate:
    """Calibrate from one or several views that share the camera.

    Args:
        camera: pitch and centre as known, sx as a start (kept where the views neither
            tell nor contradict it); f and k1 are not used.
        seen: one or more views; all flat (z = 0), or all in depth.
        options: what is refined.

    Raises:
        CalibrationError: a view allows no start, there are too few points, or sx is
            asked for where the views do not tell it.
    """
    options = options or TsaiOptions()
    stages = tuple(
        two_stage(camera, *seen.of_view(number)) for number in range(seen.views)
    )
    flat = all(stage.coplanar for stage in stages)
    solved = _solved(seen, _start(stages), camera.sx, flat, options)
    found = solved.found
    errors = solved.problem.errors_px(found.state)
    rms = float(np.sqrt((errors**2).sum(axis=1).mean()))
    tilt = float(np.degrees(found.state.tilt_rad.max()))
    verdict = judged(
        TILT.check(tilt) if flat else (),
        FOCAL.check(100 * found.estimate.sigma_of("f_mm") / found.state.camera.f_mm),
        RESIDUAL.check(rms / np.sqrt(2)),
        noise_causes(found.estimate, options.sigma_px),
        _folded(found.state, seen),
        solved.scale_causes,
    )
    return TsaiEstimate(
        found.state.camera,
        found.state,
        stages,
        found.estimate,
        solved.free,
        errors,
        rms,
        tilt,
        verdict,
    )


def _solved(
    seen: Observations,
    start: _State,
    given_sx: float,
    flat: bool,
    options: TsaiOptions,
) -> _Solved:
    """With sx free where it is told or contradicted, otherwise as given."""
    held = ("f_mm", "k1_per_mm2") + ("cx_px", "cy_px") * options.free_centre
    one_flat = flat and seen.views == 1
    if options.scale == "held":
        return _held(seen, start, given_sx, held, options, "as asked")
    if one_flat and options.scale == "free":
        raise CalibrationError(
            "one view of a flat target does not tell sx, the scale along the rows",
            hint=_SCALE_ACTION,
        )
    if one_flat:
        why = "one view of a flat target does not tell it, and f is stated as if it were right"
        return _held(seen, start, given_sx, held, options, why)
    free = (*held, "sx")
    problem, found = _refined(seen, start, free, options)
    sx, sigma = found.state.camera.sx, found.estimate.sigma_of("sx")
    percent = f"{100 * sigma / sx:.2g} %"
    if options.scale == "free" and not sigma <= _SCALE_OPEN * sx:
        raise CalibrationError(
            f"these views tell sx, the scale along the rows, to {percent} only",
            hint=_SCALE_ACTION,
        )
    if options.scale == "free" or sigma <= _SCALE_TOLD * sx:
        return _Solved(free, problem, found)
    if abs(sx - given_sx) > _CONTRADICTED * sigma:
        return _Solved(free, problem, found, (_contradicted(sx, given_sx, sigma),))
    why = f"these views tell it only to {percent}, which counts in the doubt of f"
    solved = _held(seen, start, given_sx, held, options, why)
    return replace(solved, found=_doubted(solved, found.estimate))


def _held(
    seen: Observations,
    start: _State,
    given_sx: float,
    free: tuple[str, ...],
    options: TsaiOptions,
    why: str,
) -> _Solved:
    start = replace(start, camera=replace(start.camera, sx=given_sx))
    message = f"sx, the scale along the rows, is kept at {given_sx:.6g}: {why}"
    cause = Cause("scale-kept", "go", message, _SCALE_ACTION)
    return _Solved(free, *_refined(seen, start, free, options), (cause,))


def _doubted(held: _Solved, open_scale: Estimate) -> Fit[_State]:
    """The fit with sx kept; the covariance also has what its doubt does to the rest."""
    row = open_scale.names.index("sx")
    shift = np.delete(open_scale.covariance[row], row) / open_scale.sigma_of("sx")
    estimate = held.found.estimate
    covariance = estimate.covariance + np.outer(shift, shift)
    weakest = weakest_direction(estimate.names, covariance, held.problem.scales)
    return replace(
        held.found, estimate=replace(estimate, covariance=covariance, weakest=weakest)
    )


def _contradicted(sx: float, given_sx: float, sigma: float) -> Cause:
    message = (
        f"sx, the scale along the rows, is found at {sx:.6g}, "
        f"{abs(sx - given_sx) / sigma:.2g} sigmas from the given {given_sx:.6g}; "
        f"these views tell it only to {100 * sigma / sx:.2g} %"
    )
    grade: Grade = "go" if sigma <= _SCALE_OPEN * sx else "marginal"
    return Cause("scale-contradicted", grade, message, _SCALE_ACTION)


def _start(stages: tuple[TwoStage, ...]) -> _State:
    """Medians of the cameras; each pose moved in depth to fit the median f."""
    values = np.array([stage.camera.values for stage in stages])
    median = np.median(values, axis=0)
    rotation = np.stack([stage.rotation for stage in stages])
    shift = np.stack([stage.translation_mm for stage in stages])
    shift[:, 2] *= median[0] / values[:, 0]
    return BundleState(stages[0].camera.with_values(median), rotation, shift)


def _refined(
    seen: Observations,
    start: _State,
    free: tuple[str, ...],
    options: TsaiOptions,
) -> tuple[BundleProblem[TsaiCamera], Fit[_State]]:
    freedom = _freedom(start.camera, seen, free)
    problem = BundleProblem[TsaiCamera](
        seen, freedom, options.sigma_px or 1.0, options.priors
    )
    how = FitOptions(noise_known=options.sigma_px is not None)
    try:
        found = fit(problem, start, how)
        if options.sigma_px is None and options.priors:
            sigma = float(np.sqrt(found.estimate.variance_factor)) or 1.0
            problem = replace(problem, sigma_px=sigma)
            found = fit(problem, found.state, how)
        return problem, found
    except ValueError as error:
        raise CalibrationError(
            f"the refinement has no start: {error}", hint="use more points or views"
        ) from error


def _freedom(camera: TsaiCamera, seen: Observations, free: tuple[str, ...]) -> Freedom:
    index = [TSAI_NAMES.index(name) for name in free]
    reach_px = float(np.hypot(seen.width_px, seen.height_px) / 2)
    reach_mm = reach_px * camera.pitch_y_mm
    scales = [camera.f_mm / reach_px, 1.0, 1.0, 1 / reach_px]
    scales += [camera.pitch_y_mm / reach_mm**3]
    return Freedom(free, np.eye(5)[:, index], np.array(scales)[index])


def _folded(state: _State, seen: Observations) -> tuple[Cause, ...]:
    radius = np.linalg.norm(state.camera.on_sensor(seen.pixels), axis=1)
    beyond = int((radius > state.camera.fold_mm).sum())
    if not beyond:
        return ()
    message = f"{beyond} points lie where the distortion folds over"
    action = "hold k1, or use points that fill the picture"
    return (Cause("distortion-folds", "no-go", message, action),)
