"""Was the promise kept? Measures one picture and gives a verdict with a named cause.

Sees the picture, the expectation from plan and CAD, and nothing else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.blur_excess import BlurExcess, blur_excess
from mvp.imaging.cause import (
    CHECK_FIRST,
    Evidence,
    Finding,
    exposure_fault,
    residual_limit_px,
    residual_words,
)
from mvp.imaging.edge_samples import Picture
from mvp.imaging.measure_edges import FAINT
from mvp.imaging.measure_exposure import feature_exposure
from mvp.imaging.measure_view import MeasuredView, measure_view
from mvp.imaging.register_pose import fit_pose
from mvp.imaging.verify_data import (
    BlurReport,
    EdgeReport,
    Exposure,
    HoleReport,
    Registration,
    ViewVerification,
)
from mvp.imaging.verify_edges import (
    LOST,
    SATURATED,
    SMALLEST_SNR,
    edge_report,
    point_report,
)
from mvp.imaging.verify_holes import hole_report
from mvp.imaging.verify_judge import Reports, judge, remarks

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mvp.geometry import FloatArray
    from mvp.imaging.expectation import ViewExpectation
    from mvp.imaging.verify_data import Verdict

_CLEAN_MISFIT = 4.0
_WHITE = 0.95


def verify_view(
    image: NDArray[np.generic], full_scale: float, expectation: ViewExpectation
) -> ViewVerification:
    """Measure the features in a picture and judge whether the plan was kept.

    Args:
        image: (rows, columns) linear grey levels (no gamma).
        full_scale: the level at which a pixel saturates (255 for 8 bit).
        expectation: what plan and CAD say the picture must show.

    Raises:
        ValueError: the picture is not the size of the sensor.
    """
    picture = picture_of(image, full_scale, expectation)
    exposure = feature_exposure(picture, expectation)
    fault = exposure_fault(exposure)
    if fault is not None:
        return _unmeasured(fault, exposure, expectation)
    view = measure_view(picture, expectation)
    edges = tuple(
        edge_report(picture, expectation, view, index)
        for index, edge in enumerate(expectation.edges)
        if edge.role == "feature"
    )
    points = tuple(point_report(p, expectation, view) for p in expectation.points)
    holes = tuple(hole_report(picture, expectation, view, r) for r in expectation.rims)
    reports = Reports(edges, holes, points, _faint_limit(picture, exposure))
    return _judged(expectation, view, exposure, reports)


def _faint_limit(picture: Picture, exposure: Exposure) -> float:
    """The relative contrast that stands out from the noise at this brightness."""
    return max(FAINT, SMALLEST_SNR * picture.noise / max(exposure.level_95, 1e-6))


def picture_of(
    image: NDArray[np.generic], full_scale: float, expectation: ViewExpectation
) -> Picture:
    """The image as shares of full scale, with the geometry of the expectation."""
    sensor = expectation.plane.intrinsics.sensor
    grey = np.asarray(image, dtype=np.float64)
    if grey.shape != (sensor.height_px, sensor.width_px):
        raise ValueError(
            f"the picture is {grey.shape}, the sensor "
            f"({sensor.height_px}, {sensor.width_px})"
        )
    return Picture(grey / full_scale, expectation.plane)


def _judged(
    expectation: ViewExpectation,
    view: MeasuredView,
    exposure: Exposure,
    reports: Reports,
) -> ViewVerification:
    excess = _excess(expectation, view)
    evidence = Evidence(
        view.alignment,
        view.rms_px,
        excess,
        reports.lost(),
        view.share_after,
        _clipped_share(expectation, view),
        reports.kept(expectation),
        view.witnesses,
        view.scale_sd,
    )
    verdict, finding = judge(expectation, evidence, reports)
    return ViewVerification(
        verdict=verdict,
        cause=finding.cause if finding else None,
        explanation=finding.explanation if finding else "every promise was kept",
        check_first=CHECK_FIRST[finding.cause] if finding else "",
        notes=expectation.notes + _remarks(expectation, evidence, reports, verdict),
        edges=reports.edges,
        holes=reports.holes,
        points=reports.points,
        blur=_blur_report(expectation, reports, excess),
        exposure=exposure,
        registration=_registration(expectation, view),
    )


def _remarks(
    expectation: ViewExpectation, evidence: Evidence, reports: Reports, verdict: Verdict
) -> tuple[str, ...]:
    if verdict != "pass":
        return ()
    limit_px = residual_limit_px(expectation)
    if evidence.residual_px <= limit_px:
        return remarks(reports)
    return (*remarks(reports), residual_words(evidence, limit_px))


def _clipped_share(expectation: ViewExpectation, view: MeasuredView) -> float:
    """Of the edges about the features: which are seen, with a saturated side.

    Those that are white altogether tell nothing; a bright body may hide them.
    """
    near = [
        m
        for m, edge in zip(view.found, expectation.edges, strict=True)
        if edge.role != "auxiliary"
    ]
    grey = [m for m in near if m.saturated < _WHITE]
    if not grey:
        return float(bool(near))
    seen = [m.found and m.visible_fraction > LOST for m in grey]
    clipped = [ok and m.saturated > SATURATED for ok, m in zip(seen, grey, strict=True)]
    return float(np.mean(clipped))


def _excess(expectation: ViewExpectation, view: MeasuredView) -> BlurExcess | None:
    good = [
        i
        for i, m in enumerate(view.found)
        if view.agrees[i] and m.saturated < SATURATED and m.misfit < _CLEAN_MISFIT
    ]
    if not good:
        return None
    normals = np.array([view.found[i].line.across for i in good])
    return blur_excess(
        np.array([view.found[i].blur_q_px2 for i in good]),
        np.array([view.found[i].blur_q_sd for i in good]),
        np.array([expectation.edges[i].blur_px ** 2 for i in good]),
        np.arctan2(normals[:, 1], normals[:, 0]),
    )


def _blur_report(
    expectation: ViewExpectation,
    reports: Reports,
    excess: BlurExcess | None,
) -> BlurReport:
    measured: list[EdgeReport | HoleReport] = [*reports.edges, *reports.holes]
    values = [r.blur for r in measured if r.blur.measured_px is not None]

    def mean(numbers: list[float | None]) -> float | None:
        known = [n for n in numbers if n is not None]
        return float(np.sqrt(np.mean(np.square(known)))) if known else None

    return BlurReport(
        measured_px=mean([b.measured_px for b in values]),
        low_px=mean([b.low_px for b in values]),
        high_px=mean([b.high_px for b in values]),
        predicted_px=mean([r.blur.predicted_px for r in measured]),
        c_px=expectation.c_px,
        excess_px2=excess.isotropic_px2 if excess else None,
        directional_px2=excess.directional_px2 if excess else None,
        direction_deg=float(np.rad2deg(excess.direction_rad)) if excess else None,
    )


def _registration(expectation: ViewExpectation, view: MeasuredView) -> Registration:
    alignment, coarse = view.alignment, view.coarse
    agree = [i for i, ok in enumerate(view.agrees) if ok]
    pose = fit_pose(
        [expectation.edges[i] for i in agree],
        [view.found[i].line for i in agree],
        expectation.plane,
    )
    return Registration(
        shift_px=(alignment.shift_x_px, alignment.shift_y_px),
        roll_deg=float(np.rad2deg(alignment.roll_rad)),
        scale=alignment.scale,
        residual_px=view.rms_px,
        found_before=view.share_before,
        found_after=view.share_after,
        searched=coarse is not None,
        match=coarse.score if coarse else None,
        match_unmoved=coarse.score_unmoved if coarse else None,
        position_mm=_three(pose.position_mm) if pose else None,
        angle_deg=_three(np.rad2deg(pose.rotvec_rad)) if pose else None,
        pose_residual_px=pose.residual_px if pose else None,
    )


def _three(values: FloatArray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _unmeasured(
    fault: Finding, exposure: Exposure, expectation: ViewExpectation
) -> ViewVerification:
    return ViewVerification(
        verdict="fail",
        cause=fault.cause,
        explanation=fault.explanation,
        check_first=CHECK_FIRST[fault.cause],
        notes=(),
        edges=(),
        holes=(),
        points=(),
        blur=BlurReport(None, None, None, None, expectation.c_px),
        exposure=exposure,
        registration=None,
    )
