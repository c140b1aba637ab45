"""Reports of straight feature edges and point features, and what they must keep."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.cause import scale_tolerance, shift_tolerance_px
from mvp.imaging.measure_edges import FAINT, share_seen, trim_px
from mvp.imaging.measure_ends import Crossing, EndPoint, find_end, not_measured
from mvp.imaging.verify_data import Blur, EdgeReport, HoleReport, PointReport

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.imaging.edge_samples import Line, Picture
    from mvp.imaging.expectation import ExpectedEdge, ExpectedPoint, ViewExpectation
    from mvp.imaging.hole_rim import RimMeasurement
    from mvp.imaging.measure_edges import EdgeMeasurement
    from mvp.imaging.measure_plane import ImagePlane
    from mvp.imaging.measure_view import MeasuredView

LENGTH_PX = 1.0
LENGTH_SHARE = 0.01
SMALLEST_SNR = 5.0
VISIBLE = 0.9
LOST = 0.75
PARTLY = 0.1
SATURATED = 0.05
_TWO_SIGMA = 1.96
_NEARLY_WHOLE = 0.95
_PLACES = 33


def blur_of(
    found: EdgeMeasurement | RimMeasurement, predicted_px: float, c_px: float
) -> Blur:
    """Blur diameter with its 95 % interval."""
    if not found.found or found.saturated > SATURATED:
        return Blur(None, None, None, predicted_px, c_px)
    low = found.blur_q_px2 - _TWO_SIGMA * found.blur_q_sd
    high = found.blur_q_px2 + _TWO_SIGMA * found.blur_q_sd
    return Blur(
        found.blur_px,
        float(np.sqrt(max(low, 0.0))),
        float(np.sqrt(max(high, 0.0))),
        predicted_px,
        c_px,
        found.blur_q_px2,
        found.blur_q_sd,
    )


def _weighed_px2(
    edge: ExpectedEdge, found: EdgeMeasurement, plane: ImagePlane
) -> float:
    """Predicted b^2, averaged along the picture as the fit averages."""
    reach = 1 - 2 * trim_px(found.line, found.blur_px) / found.line.length_px
    place = np.linspace(-reach, reach, _PLACES)
    blur = plane.blur_px(edge.depth_mm_at((1 + place) / 2))
    weight = (found.step + found.step_slope * place) ** 2
    return float(np.average(blur**2, weights=weight))


def edge_report(
    picture: Picture, expectation: ViewExpectation, view: MeasuredView, index: int
) -> EdgeReport:
    """Everything about one feature edge."""
    edge, found = expectation.edges[index], view.found[index]
    whole = edge.asked
    line = view.line_of(expectation, whole)
    ends = [
        _end(picture, view, index, line.start_px, edge.start_neighbours, expectation),
        _end(picture, view, index, line.end_px, edge.end_neighbours, expectation),
    ]
    length, sd = _length(ends)
    raw = [
        tuple(map(float, expectation.plane.raw(p)))
        for p in (whole.start_px, whole.end_px)
    ]
    middle = (edge.start_px + edge.end_px) / 2
    return EdgeReport(
        feature=edge.feature,
        name=edge.name,
        predicted_px=whole.length_px,
        measured_px=length,
        measured_sd_px=sd,
        start_px=_raw_place(expectation, ends[0]),
        end_px=_raw_place(expectation, ends[1]),
        predicted_start_px=(raw[0][0], raw[0][1]),
        predicted_end_px=(raw[1][0], raw[1][1]),
        offset_px=_offset_at_middle(edge, found) if found.found else None,
        offset_after_px=float(view.residual_px[index]) if found.found else None,
        offset_sd_px=found.offset_sd_px if found.found else None,
        allowed_offset_px=shift_tolerance_px(
            expectation, (float(middle[0]), float(middle[1]))
        ),
        visible_fraction=_visible(picture, expectation, view, index),
        saturated=found.saturated,
        step=found.step if found.found else None,
        snr=found.snr,
        predicted_contrast=None if np.isnan(edge.contrast) else edge.contrast,
        detail_px=_detail(edge.detail_px, length, whole.length_px),
        required_px=edge.requirement.pixels if edge.requirement else None,
        blur=replace(
            blur_of(found, edge.blur_px, expectation.c_px),
            weighed_px2=_weighed_px2(edge, found, expectation.plane)
            if found.found
            else None,
        ),
        notes=_notes(edge, found, ends),
        length_asked=not edge.open_ends,
        crowded=edge.crowded,
    )


def _visible(
    picture: Picture, expectation: ViewExpectation, view: MeasuredView, index: int
) -> float:
    edge, found = expectation.edges[index], view.found[index]
    if found.found:
        return found.visible_fraction
    line = view.line(expectation, index)
    return share_seen(picture, line, view.drawn(expectation), edge.blur_px)


def _detail(detail_px: float, measured: float | None, predicted: float) -> float | None:
    if measured is None or np.isnan(detail_px):
        return None
    return float(detail_px * measured / predicted)


def _offset_at_middle(edge: ExpectedEdge, found: EdgeMeasurement) -> float:
    """Across the planned line, at its middle, to where the measured line crosses."""
    middle = (edge.start_px + edge.end_px) / 2
    away = float(found.line.across @ (found.line.middle_px - middle))
    return away * float(np.sign(found.line.across @ edge.normal))


def _end(
    picture: Picture,
    view: MeasuredView,
    index: int,
    expected_px: FloatArray,
    neighbours: tuple[int, ...],
    expectation: ViewExpectation,
) -> EndPoint:
    if not neighbours:
        return not_measured("no visible edge of the part crosses there")
    crossings = [
        Crossing(expectation.edges[n].name, view.found[n], float(view.residual_px[n]))
        for n in neighbours
    ]
    own = float(view.residual_px[index])
    return find_end(picture, view.found[index], expected_px, crossings, own)


def _length(ends: list[EndPoint]) -> tuple[float | None, float | None]:
    if not (ends[0].measured and ends[1].measured):
        return None, None
    between = ends[1].place_px - ends[0].place_px
    length = float(np.linalg.norm(between))
    along = between / max(length, 1e-9)
    total = ends[0].covariance + ends[1].covariance
    return length, float(np.sqrt(along @ total @ along))


def _raw_place(
    expectation: ViewExpectation, end: EndPoint
) -> tuple[float, float] | None:
    if not end.measured:
        return None
    raw = expectation.plane.raw(end.place_px)
    return float(raw[0]), float(raw[1])


def _notes(
    edge: ExpectedEdge, found: EdgeMeasurement, ends: list[EndPoint]
) -> tuple[str, ...]:
    notes = []
    if not found.found:
        notes.append(f"not found: {found.reason}")
    for word, end in zip(("start", "end"), ends, strict=True):
        if not end.measured and not edge.open_ends:
            notes.append(f"{word} not measured: {end.reason}")
    if found.saturated > SATURATED:
        notes.append(f"{found.saturated:.0%} of its pixels are saturated: no blur")
    share = edge.length_px / edge.asked.length_px
    if share < _NEARLY_WHOLE:
        notes.append(f"what lies behind it changes; measured on {share:.0%} of it")
    if not edge.visible.all():
        notes.append(f"the plan itself shows only {edge.visible.mean():.0%} of it")
    return tuple(notes)


def faint(report: EdgeReport | HoleReport, limit: float = FAINT) -> bool:
    """The light gives it no contrast above ``limit``, by prediction or as seen."""
    if report.predicted_contrast is not None:
        return report.predicted_contrast < limit
    return (
        report.step is None
        and report.visible_fraction < PARTLY
        and report.snr < SMALLEST_SNR
        and report.saturated < SATURATED
    )


def broken_promises(report: EdgeReport, expectation: ViewExpectation) -> list[str]:
    """What a measured edge does not keep, in words."""
    broken = []
    if report.measured_px is not None:
        change = abs(report.measured_px - report.predicted_px)
        allowed = max(
            LENGTH_PX,
            LENGTH_SHARE * report.predicted_px,
            scale_tolerance(expectation) * report.predicted_px,
        )
        if change > allowed:
            broken.append(
                f"length {report.measured_px:.1f} px instead of "
                f"{report.predicted_px:.1f} px (limit +-{allowed:.1f} px)"
            )
    sd = report.offset_sd_px or 0.0
    limit_px = max(report.allowed_offset_px, 1.0) + 3 * sd
    doubt = 0.0
    if report.measured_px and report.measured_sd_px:
        doubt = 2 * report.measured_sd_px / report.measured_px
    return broken + broken_by_any(report, limit_px, doubt)


def broken_by_any(
    report: EdgeReport | HoleReport, limit_px: float, doubt: float
) -> list[str]:
    """What an edge or a rim does not keep besides its size, in words.

    Args:
        report: of the feature.
        limit_px: how far it may lie beside its place.
        doubt: relative uncertainty of its size.
    """
    broken = []
    if report.offset_px is not None and abs(report.offset_px) > limit_px:
        broken.append(beside_words(report.offset_px, limit_px))
    if report.visible_fraction < VISIBLE:
        share = report.visible_fraction
        broken.append(f"seen on {share:.0%} of its length (limit {VISIBLE:.0%})")
    if report.saturated > SATURATED:
        share = report.saturated
        broken.append(f"{share:.0%} of its pixels saturated (limit {SATURATED:.0%})")
    if report.blur.measured_px is not None and _too_blurred(report.blur):
        broken.append(
            f"blur {report.blur.measured_px:.2f} px above {report.blur.c_px:.2f}"
        )
    detail, required = report.detail_px, report.required_px
    if detail is not None and required is not None and detail * (1 + doubt) < required:
        broken.append(
            f"the required detail covers {detail:.2f} px instead of {required:.2f}"
        )
    return broken


def beside_words(offset_px: float, limit_px: float) -> str:
    """A feature beside its place."""
    return f"{abs(offset_px):.1f} px beside its place (limit {limit_px:.1f} px)"


def _too_blurred(blur: Blur) -> bool:
    """Above the acceptable circle beyond doubt (3 standard deviations)."""
    low, high, measured = blur.low_px, blur.high_px, blur.measured_px
    if low is None or high is None or measured is None:
        return False
    sd = (high - low) / (2 * _TWO_SIGMA)
    return measured > blur.c_px + 3 * sd and low > blur.c_px


def point_report(
    point: ExpectedPoint, expectation: ViewExpectation, view: MeasuredView
) -> PointReport:
    """A corner as the crossing of the edges that meet in it."""
    raw = expectation.plane.raw(point.point_px)
    place, sd, notes = _corner(point, view)
    measured, offset = None, None
    if place is not None:
        at = expectation.plane.raw(place)
        measured = (float(at[0]), float(at[1]))
        offset = float(np.linalg.norm(place - point.point_px))
    return PointReport(
        feature=point.feature,
        predicted_px=(float(raw[0]), float(raw[1])),
        measured_px=measured,
        measured_sd_px=sd,
        offset_px=offset,
        allowed_offset_px=shift_tolerance_px(
            expectation, (float(point.point_px[0]), float(point.point_px[1]))
        ),
        notes=notes,
    )


def _corner(
    point: ExpectedPoint, view: MeasuredView
) -> tuple[FloatArray | None, float | None, tuple[str, ...]]:
    lines: list[tuple[Line, float]] = [
        (view.found[n].line, view.found[n].offset_sd_px)
        for n in point.neighbours
        if view.agrees[n]
    ]
    if len(lines) < 2:
        return None, None, ("fewer than two of its edges were found",)
    normals = np.array([line.across for line, _ in lines])
    weight = np.array([1 / (sd**2 + 0.03**2) for _, sd in lines])
    gram = normals.T @ (normals * weight[:, None])
    if np.linalg.cond(gram) > 1e4:
        return None, None, ("its edges cross at too small an angle",)
    offsets = np.array([line.across @ line.middle_px for line, _ in lines])
    place = np.linalg.solve(gram, normals.T @ (weight * offsets))
    sd = float(np.sqrt(np.trace(np.linalg.inv(gram))))
    return np.asarray(place), sd, ()
