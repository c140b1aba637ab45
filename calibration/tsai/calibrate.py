"""Tsai's calibration to the end: both stages, full refinement, and a verdict.

The two stages give the start; all free numbers and the poses of all views are then
found together by least squares in the picture. A flat target parallel to the sensor
leaves f and Tz open while the residual stays perfect, so the tilt and the covariance
decide, not the residual.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.bundle import BundleProblem, BundleState, Freedom
from calibration.camera_verdict import FOCAL, RESIDUAL, TILT, noise_causes
from calibration.estimate import Estimate, Fit, FitOptions, fit
from calibration.tsai.model import TSAI_NAMES, TsaiCamera
from calibration.tsai.stages import TwoStage, two_stage
from calibration.verdict import Cause, Verdict, judged
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from calibration.observations import Observations
    from mvp.geometry import FloatArray


@dataclass(frozen=True)
class TsaiOptions:
    """What is refined.

    Attributes:
        free_centre: the centre is refined too; one view of a flat target tells it badly.
        sigma_px: one standard deviation of a coordinate; None: from the residuals.
        priors: mean and one standard deviation of some of ``TSAI_NAMES``.
    """

    free_centre: bool = False
    sigma_px: float | None = None
    priors: tuple[tuple[str, float, float], ...] = ()


@dataclass(frozen=True, eq=False)
class TsaiEstimate:
    """The refined camera and poses, the two stages before, and how good they are.

    Attributes:
        camera: refined.
        state: the camera with ``camera_from_target`` of every view.
        stages: the two-stage result of every view.
        estimate: covariance (free numbers of the camera, then six for each view).
        free: which numbers were refined.
        errors_px: (m, 2), predicted less found.
        rms_px: root mean square of the distance of a point.
        tilt_deg: the largest tilt of a view against the sensor.
        verdict: with causes.
    """

    camera: TsaiCamera
    state: BundleState[TsaiCamera]
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
        camera: pitch and centre as known, sx as a start (kept for flat targets); f and k1
            are not used.
        seen: one or more views; all flat (z = 0), or all in depth.
        options: what is refined.

    Raises:
        CalibrationError: a view allows no start, or there are too few points.
    """
    options = options or TsaiOptions()
    stages = tuple(
        two_stage(camera, *seen.of_view(number)) for number in range(seen.views)
    )
    start = _start(stages)
    flat = all(stage.coplanar for stage in stages)
    free = ["f_mm", "k1_per_mm2"] + (["cx_px", "cy_px"] if options.free_centre else [])
    free += [] if flat else ["sx"]
    problem, found = _refined(seen, start, tuple(free), options)
    errors = problem.errors_px(found.state)
    rms = float(np.sqrt((errors**2).sum(axis=1).mean()))
    tilt = float(np.degrees(found.state.tilt_rad.max()))
    verdict = judged(
        TILT.check(tilt) if flat else (),
        FOCAL.check(100 * found.estimate.sigma_of("f_mm") / found.state.camera.f_mm),
        RESIDUAL.check(rms / np.sqrt(2)),
        noise_causes(found.estimate, options.sigma_px),
        _folded(found.state, seen),
    )
    return TsaiEstimate(
        found.state.camera,
        found.state,
        stages,
        found.estimate,
        tuple(free),
        errors,
        rms,
        tilt,
        verdict,
    )


def _start(stages: tuple[TwoStage, ...]) -> BundleState[TsaiCamera]:
    """Medians of the cameras; each pose moved in depth to fit the median f."""
    values = np.array([stage.camera.values for stage in stages])
    median = np.median(values, axis=0)
    rotation = np.stack([stage.rotation for stage in stages])
    shift = np.stack([stage.translation_mm for stage in stages])
    shift[:, 2] *= median[0] / values[:, 0]
    return BundleState(stages[0].camera.with_values(median), rotation, shift)


def _refined(
    seen: Observations,
    start: BundleState[TsaiCamera],
    free: tuple[str, ...],
    options: TsaiOptions,
) -> tuple[BundleProblem[TsaiCamera], Fit[BundleState[TsaiCamera]]]:
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


def _folded(state: BundleState[TsaiCamera], seen: Observations) -> tuple[Cause, ...]:
    radius = np.linalg.norm(state.camera.on_sensor(seen.pixels), axis=1)
    beyond = int((radius > state.camera.fold_mm).sum())
    if not beyond:
        return ()
    message = f"{beyond} points lie where the distortion folds over"
    action = "hold k1, or use points that fill the picture"
    return (Cause("distortion-folds", "no-go", message, action),)
