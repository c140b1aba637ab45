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
    picture_fault,
)
from mvp.imaging.edge_samples import Picture
from mvp.imaging.measure_exposure import feature_exposure
from mvp.imaging.measure_view import MeasuredView, measure_view
from mvp.imaging.verify_data import (
    BlurReport,
    EdgeReport,
    Exposure,
    HoleReport,
    PointReport,
    Registration,
    Verdict,
    ViewVerification,
)
from mvp.imaging.verify_edges import (
    LOST,
    SATURATED,
    SMALLEST_SNR,
    broken_promises,
    edge_report,
    faint,
    point_report,
)
from mvp.imaging.verify_holes import broken_by_hole, hole_report

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mvp.imaging.expectation import ViewExpectation

_CLEAN_MISFIT = 4.0
_NOTE_OFFSET_PX = 1.0


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
    return _judged(expectation, view, exposure, edges, holes, points)


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
    edges: tuple[EdgeReport, ...],
    holes: tuple[HoleReport, ...],
    points: tuple[PointReport, ...],
) -> ViewVerification:
    excess = _excess(expectation, view)
    evidence = Evidence(
        view.alignment, view.rms_px, excess, _lost(edges, holes), view.share_after
    )
    verdict, finding = _verdict(expectation, evidence, edges, holes, points)
    return ViewVerification(
        verdict=verdict,
        cause=finding.cause if finding else None,
        explanation=finding.explanation if finding else "every promise was kept",
        check_first=CHECK_FIRST[finding.cause] if finding else "",
        notes=_notes(edges) if verdict == "pass" else (),
        edges=edges,
        holes=holes,
        points=points,
        blur=_blur_report(expectation, edges, holes, excess),
        exposure=exposure,
        registration=_registration(view),
    )


def _verdict(
    expectation: ViewExpectation,
    evidence: Evidence,
    edges: tuple[EdgeReport, ...],
    holes: tuple[HoleReport, ...],
    points: tuple[PointReport, ...],
) -> tuple[Verdict, Finding | None]:
    finding = picture_fault(evidence, expectation)
    if finding is not None:
        return "fail", finding
    pale = [e.name for e in edges if faint(e) or e.snr < SMALLEST_SNR]
    pale += [h.feature for h in holes if faint(h) or h.snr < SMALLEST_SNR]
    if pale:
        text = f"{', '.join(pale)}: too little contrast in this light"
        return "not measurable", Finding("low contrast", text)
    for report in edges:
        broken = broken_promises(report, expectation)
        if broken:
            return "fail", _broken(report.name, report.saturated, broken)
    for hole in holes:
        broken = broken_by_hole(hole, expectation)
        if broken:
            return "fail", _broken(hole.feature, hole.saturated, broken)
    missing = [e.name for e in edges if e.measured_px is None]
    missing += [p.feature for p in points if p.measured_px is None]
    missing += [h.feature for h in holes if h.measured_px is None]
    if missing:
        text = f"{', '.join(missing)}: an end is not marked by any visible edge"
        return "not measurable", Finding("no end found", text)
    return "pass", None


def _broken(name: str, saturated: float, broken: list[str]) -> Finding:
    text = f"{name}: " + "; ".join(broken)
    if saturated > SATURATED:
        return Finding("overexposed", text)
    if "required detail" in text:
        return Finding("resolution", text)
    if "seen on" in text:
        return Finding("occlusion", text)
    if "blur" in text:
        return Finding("defocus", text)
    if "beside" in text:
        return Finding("misalignment", text)
    return Finding("shape", text)


def _lost(
    edges: tuple[EdgeReport, ...], holes: tuple[HoleReport, ...]
) -> tuple[str, ...]:
    lost = [e.name for e in edges if e.visible_fraction < LOST and not faint(e)]
    lost += [h.feature for h in holes if h.visible_fraction < LOST and not faint(h)]
    return tuple(lost)


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
    edges: tuple[EdgeReport, ...],
    holes: tuple[HoleReport, ...],
    excess: BlurExcess | None,
) -> BlurReport:
    values = [r.blur for r in (*edges, *holes) if r.blur.measured_px is not None]

    def mean(numbers: list[float | None]) -> float | None:
        known = [n for n in numbers if n is not None]
        return float(np.sqrt(np.mean(np.square(known)))) if known else None

    return BlurReport(
        measured_px=mean([b.measured_px for b in values]),
        low_px=mean([b.low_px for b in values]),
        high_px=mean([b.high_px for b in values]),
        predicted_px=mean([r.blur.predicted_px for r in (*edges, *holes)]),
        c_px=expectation.c_px,
        excess_px2=excess.isotropic_px2 if excess else None,
        directional_px2=excess.directional_px2 if excess else None,
        direction_deg=float(np.rad2deg(excess.direction_rad)) if excess else None,
    )


def _registration(view: MeasuredView) -> Registration:
    alignment, coarse = view.alignment, view.coarse
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
    )


def _notes(edges: tuple[EdgeReport, ...]) -> tuple[str, ...]:
    notes = []
    for report in edges:
        offset = abs(report.offset_px or 0.0)
        if offset > _NOTE_OFFSET_PX:
            notes.append(
                f"{report.name} lies {offset:.1f} px beside its place, within the"
                f" tolerance of {report.allowed_offset_px:.1f} px"
            )
    return tuple(notes)


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
