"""What speaks against a camera calibration.

The residual never shows a target that is parallel to the sensor, nor one that fills too
little of the picture; tilt and covariance do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import chi2

from calibration.estimate import IMPROBABLE
from calibration.planar import homography
from calibration.verdict import Cause, Limit, Verdict, judged

if TYPE_CHECKING:
    from collections.abc import Iterable

    from calibration.bundle import BundleState
    from calibration.estimate import Estimate
    from calibration.observations import Observations
    from calibration.projection import PinholeCamera
    from calibration.verdict import Grade
    from mvp.geometry import FloatArray

_TILT_ACTION = "tilt the target (or the camera) by 30 to 45 deg in some of the views"
_MORE_VIEWS = "add views tilted by 25 to 40 deg about different axes"
TILT = Limit(
    "target-nearly-parallel",
    "target nearly parallel to sensor: the largest tilt",
    "deg",
    20,
    10,
    _TILT_ACTION,
    at_least=True,
)
FOCAL = Limit(
    "focal-length-uncertain",
    "the standard deviation of the focal length",
    "%",
    0.3,
    1.0,
    _MORE_VIEWS,
)
CENTRE = Limit(
    "centre-uncertain",
    "the standard deviation of the principal point",
    "px",
    5,
    20,
    _MORE_VIEWS,
)
RESIDUAL = Limit(
    "residual-large",
    "the residual (RMS per coordinate)",
    "px",
    0.5,
    2.0,
    "check sharpness, flatness of the target, and that all pictures are of one camera "
    "at one lens setting",
)
FILLED = Limit(
    "target-too-small",
    "the part of the picture's width and height that the points reach",
    "%",
    60,
    30,
    "bring the target closer, or to all sides of the picture",
    at_least=True,
)
HELD_OUT = Limit(
    "views-disagree",
    "error on views that took no part, over the error on those that did,",
    "times",
    1.5,
    3.0,
    "add views; look for one that was taken at another lens setting",
)
NOISE_CODE = "residuals-above-noise"
_LEAST_VIEWS = 3
_PERFECT_PX = 0.02
_OUTLYING_VIEW = 3.0
_FOREIGN_VIEW = 10.0
_UNEVEN = 1.5
_FAR_ABOVE_NOISE = 5.0
_WORST_VIEW_FLOOR_PX = 0.3
_OUT_OF_PLACE = 0.5


def judge_camera(
    seen: Observations,
    state: BundleState[PinholeCamera],
    estimate: Estimate,
    *,
    view_rms_px: FloatArray,
    apart_rms_px: FloatArray,
    out_of_sample_px: float | None,
    faces_camera: bool,
    more: Iterable[Cause] = (),
) -> Verdict:
    """GO, MARGINAL or NO-GO, with every cause.

    ``apart_rms_px``: residuals of the views where a wrong one is not shared out.
    ``more``: what noise and target say.
    """
    counts = np.bincount(seen.view)
    rms = float(np.sqrt((view_rms_px**2 @ counts) / counts.sum()))
    return judged(
        _out_of_order(seen) if seen.planar() else (),
        _mirrored(state) if faces_camera and seen.planar() else (),
        _outlying_views(seen, apart_rms_px),
        TILT.check(float(np.degrees(state.tilt_rad.max()))) if seen.planar() else (),
        FILLED.check(_filled_percent(seen)),
        _few_views(seen),
        _sigma_causes(state, estimate),
        RESIDUAL.check(rms / np.sqrt(2)),
        () if out_of_sample_px is None else _held_out(out_of_sample_px, rms),
        more,
        () if estimate.converged else (_NOT_CONVERGED,),
    )


_NOT_CONVERGED = Cause(
    "not-converged",
    "no-go",
    "the least squares did not come to an end",
    "hold the higher distortion terms, or add views",
)


def _sigma_causes(
    state: BundleState[PinholeCamera], estimate: Estimate
) -> tuple[Cause, ...]:
    sigma = dict(zip(estimate.names, estimate.sigmas, strict=True))
    causes: tuple[Cause, ...] = ()
    if "fx_px" in sigma:
        causes += FOCAL.check(100 * sigma["fx_px"] / state.camera.fx_px)
    if "cx_px" in sigma:
        causes += CENTRE.check(max(sigma["cx_px"], sigma.get("cy_px", 0.0)))
    return causes


def _few_views(seen: Observations) -> tuple[Cause, ...]:
    if seen.views >= _LEAST_VIEWS:
        return ()
    message = (
        f"{seen.views} view(s): too few to test the result on views that took no part"
    )
    return (Cause("few-views", "marginal", message, _MORE_VIEWS),)


def _held_out(out_of_sample_px: float, rms_px: float) -> tuple[Cause, ...]:
    return HELD_OUT.check(out_of_sample_px / max(rms_px, _PERFECT_PX))


def _filled_percent(seen: Observations) -> float:
    reach = np.ptp(seen.pixels, axis=0) / (seen.width_px, seen.height_px)
    return float(100 * reach.min())


def doubtful(view_rms_px: FloatArray) -> bool:
    """One wrong view may hide among the others: they share its error."""
    uneven = float(view_rms_px.max()) > _UNEVEN * float(np.median(view_rms_px))
    large = float(np.sqrt((view_rms_px**2).mean() / 2)) > RESIDUAL.marginal
    return bool(uneven or large)


def noise_causes(
    estimate: Estimate,
    stated_px: float | None,
    *,
    found_px: float = 0.0,
    most_px: float | None = None,
) -> tuple[Cause, ...]:
    """Residuals that contradict the noise that was stated.

    Args:
        estimate: of the fit.
        stated_px: what a coordinate's noise is; None: not known.
        found_px: the noise that whitened the residuals, where it is not known.
        most_px: what noise may reach at most; None: anything.
    """
    freedom, factor = estimate.degrees_of_freedom, estimate.variance_factor
    if stated_px is not None:
        contradicted, limit, words = estimate.inflated, stated_px, "assumed"
        probability = estimate.probability
    elif most_px is not None and freedom > 0:
        limit, words = most_px, "largest"
        factor *= (found_px / most_px) ** 2
        probability = float(chi2.sf(freedom * factor, freedom))
        contradicted = probability < IMPROBABLE
    else:
        return ()
    if not contradicted:
        return ()
    times = float(np.sqrt(factor))
    message = (
        f"the residuals are {times:.2g} times the {words} noise of {limit:.3g} px "
        f"(probability {probability:.1g})"
    )
    action = (
        "look at the residuals of single views; check the target (flat and stiff, its "
        "layout), free more distortion terms, or state the true noise"
    )
    grade: Grade = "no-go" if times > _FAR_ABOVE_NOISE else "marginal"
    return (Cause(NOISE_CODE, grade, message, action),)


def _outlying_views(seen: Observations, view_rms_px: FloatArray) -> list[Cause]:
    usual = max(float(np.median(view_rms_px)), _WORST_VIEW_FLOOR_PX / _OUTLYING_VIEW)
    return [
        Cause(
            "view-does-not-fit",
            "no-go" if view_rms_px[view] > _FOREIGN_VIEW * usual else "marginal",
            f"{seen.names[view]} has a residual of {view_rms_px[view]:.2g} px, the "
            f"others {usual:.2g} px",
            f"remove {seen.names[view]} or take it again",
        )
        for view in np.flatnonzero(view_rms_px > _OUTLYING_VIEW * usual)
    ]


def _mirrored(state: BundleState[PinholeCamera]) -> tuple[Cause, ...]:
    behind = state.rotation[:, 2, 2] < 0
    if not behind.any():
        return ()
    message = f"{int(behind.sum())} of {behind.size} views show the target from behind"
    action = (
        "the target is mirrored, or its rows and columns are swapped: check print and "
        "layout"
    )
    return (Cause("target-mirrored", "no-go", message, action),)


def _out_of_order(seen: Observations) -> tuple[Cause, ...]:
    """Views whose points do not lie as the layout says, whatever the lens."""
    named = []
    for view, name in enumerate(seen.names):
        points, pixels = seen.of_view(view)
        there = np.pad(points[:, :2], ((0, 0), (0, 1)), constant_values=1.0)
        image = there @ homography(points[:, :2], pixels).T
        off = np.linalg.norm(image[:, :2] / image[:, 2:] - pixels, axis=1)
        spacing = np.median(cKDTree(pixels).query(pixels, k=2)[0][:, 1])
        if np.median(off) > _OUT_OF_PLACE * spacing:
            named.append(name)
    if not named:
        return ()
    return (
        Cause(
            "points-out-of-order",
            "no-go",
            f"in {', '.join(named)} the points do not lie as the layout says",
            "check whether rows and columns of the target are exchanged, in which order "
            "its points are counted, and that these pictures show this target",
        ),
    )
