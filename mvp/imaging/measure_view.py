"""All edges of a view measured: first where expected, then where the picture lies."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.edge_samples import Line
from mvp.imaging.measure_edges import EdgeMeasurement, EdgeTask, measure_edge
from mvp.imaging.register import Alignment, AlignmentFit, fit_alignment
from mvp.imaging.register_pose import PoseOffset, fit_pose
from mvp.imaging.register_search import CoarseMatch, coarse_match

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.imaging.edge_samples import Picture
    from mvp.imaging.expectation import DrawnEdges, ExpectedEdge, ViewExpectation

_SEARCH_PX = 6.0
_AGAIN_PX = 2.5
_GATE_PX = 0.8
_GATE_PER_BLUR = 0.1
_FOUND_SHARE = 0.7
_LARGEST_RESIDUAL_PX = 1.5
_FAINT = 0.05
_FEWEST_EDGES = 3
# Edges known better than this count alike in the residual, vaguer ones less.
_SHARP_SD_PX = 0.15
_FEWEST_FOR_POSE = 8
_POSE_REACH_PX = 1.5
_POSE_GAIN = 0.6
# A similarity this good leaves nothing to explain.
_FINE_PX = 0.15
# Clipping moves an edge towards its dark side.
CLIPPED = 0.05
_CLIPPED_PX = 1.0


@dataclass(frozen=True, eq=False)
class MeasuredView:
    """The edges of a view and how they lie.

    Attributes:
        found: one measurement per expected edge; lines are absolute.
        alignment: plan to picture.
        residual_px: (n,) what the alignment leaves of each edge's offset, nan if lost.
        agrees: (n,) found, and where the alignment says.
        rms_px: of the residuals of the edges that agree, the vague ones counting less.
        share_before: of the expected length found where it was expected.
        share_after: the same with the alignment.
        coarse: result of the search over shift, roll and scale, if it was needed.
        pose: the motion of the part that explains the offsets; where it does so
            better than a similarity (edges at different depths) edges are placed by it.
        witnesses: how many edges the residual rests on.
        scale_sd: standard deviation of the alignment's scale.
    """

    found: tuple[EdgeMeasurement, ...]
    alignment: Alignment
    residual_px: FloatArray
    agrees: BoolArray
    rms_px: float
    share_before: float
    share_after: float
    coarse: CoarseMatch | None
    pose: PoseOffset | None = None
    witnesses: int = 0
    scale_sd: float = float("inf")

    def line(self, expectation: ViewExpectation, index: int) -> Line:
        """Where the measured piece of an expected edge should be now."""
        return self.line_of(expectation, expectation.edges[index])

    def line_of(self, expectation: ViewExpectation, edge: ExpectedEdge) -> Line:
        """Where a predicted edge should be now."""
        plane = expectation.plane
        if self.pose is None:
            return self.alignment.line(edge.start_px, edge.end_px)
        return Line(
            self.pose.places(edge.start_mm, plane), self.pose.places(edge.end_mm, plane)
        )

    def drawn(self, expectation: ViewExpectation) -> DrawnEdges:
        """All predicted lines where they should be now."""
        if self.pose is None:
            return self.alignment.drawn(expectation.drawn)
        return self.pose.drawn(expectation.drawn, expectation.plane)


def measure_view(picture: Picture, expectation: ViewExpectation) -> MeasuredView:
    """Measure every expected edge; register the picture when that is needed."""
    blur = np.array([edge.blur_px for edge in expectation.edges])
    first = _measure(picture, expectation, _placed(Alignment()), blur, _SEARCH_PX)
    view = _aligned(expectation, Alignment(), first, None)
    if not _needs_search(view):
        return _second_look(picture, expectation, view, blur)
    coarse = coarse_match(picture, expectation.drawn)
    found = _registered(picture, expectation, view, coarse)
    # The prediction itself is a candidate too: a search must not make things worse.
    if found.share_after < view.share_after:
        found = replace(view, coarse=coarse)
    return replace(found, share_before=view.share_before)


def _registered(
    picture: Picture,
    expectation: ViewExpectation,
    before: MeasuredView,
    coarse: CoarseMatch,
) -> MeasuredView:
    alignment = coarse.alignment
    blur = np.full(len(expectation.edges), 3.0)
    view = before
    for search_px in (10.0, 5.0):
        found = _measure(picture, expectation, _placed(alignment), blur, search_px)
        view = _aligned(expectation, alignment, found, coarse)
        alignment = view.alignment
        measured = [m.blur_px for m in view.found if m.found]
        blur = np.full(len(blur), float(np.median(measured)) if measured else 3.0)
    return _second_look(picture, expectation, view, blur)


def _measure(
    picture: Picture,
    expectation: ViewExpectation,
    view: MeasuredView,
    blur_px: FloatArray,
    search_px: float,
    which: BoolArray | None = None,
) -> list[EdgeMeasurement]:
    """Measure the edges (or only some) where ``view`` places them."""
    drawn = view.drawn(expectation)
    out = []
    for index, edge in enumerate(expectation.edges):
        line = view.line(expectation, index)
        if which is not None and not which[index]:
            out.append(EdgeMeasurement(False, "not asked", line))
            continue
        task = EdgeTask(edge.role, search_px, float(blur_px[index]), edge.visible)
        out.append(measure_edge(picture, line, drawn, task))
    return out


def _placed(alignment: Alignment) -> MeasuredView:
    """Nothing measured yet, everything where an alignment puts it."""
    none = np.zeros(0)
    return MeasuredView(
        (), alignment, none, none.astype(np.bool_), float("inf"), 0.0, 0.0, None
    )


def _aligned(
    expectation: ViewExpectation,
    alignment: Alignment,
    found: list[EdgeMeasurement],
    coarse: CoarseMatch | None,
) -> MeasuredView:
    """Fit what is left after ``alignment`` and judge every edge by it."""
    count = len(found)
    residual, agrees = np.full(count, np.nan), np.zeros(count, dtype=np.bool_)
    use = np.array([i for i, m in enumerate(found) if m.found], dtype=np.int64)
    rms, total = _unfitted(expectation, len(use)), alignment
    witnesses, scale_sd = 0, float("inf")
    if len(use) < _FEWEST_EDGES:
        residual[use] = [found[i].offset_px for i in use]
        agrees[use] = True
    else:
        clipped = np.array([found[i].saturated > CLIPPED for i in use])
        sound = use if (~clipped).sum() < _FEWEST_EDGES else use[~clipped]
        fit = _fit(expectation, alignment, found, sound)
        total, scale_sd = alignment.then(fit.alignment), fit.scale_sd
        residual[use] = [_left(expectation, total, found, i) for i in use]
        gate = _GATE_PX + _GATE_PER_BLUR * np.array([found[i].blur_px for i in use])
        sd = _sd_px(found, use)
        agrees[use] = (np.abs(residual[use]) < gate + clipped * _CLIPPED_PX) & (
            sd < gate
        )
        kept = sound[agrees[sound]]
        witnesses = len(kept)
        rms = residual_rms_px(residual[kept], _sd_px(found, kept)) if witnesses else rms
    share = _share(expectation, agrees)
    return MeasuredView(
        tuple(found),
        total,
        residual,
        agrees,
        rms,
        share,
        share,
        coarse,
        witnesses=witnesses,
        scale_sd=scale_sd,
    )


def _sd_px(found: list[EdgeMeasurement], which: IntArray) -> FloatArray:
    return np.array([found[i].offset_sd_px for i in which])


def residual_rms_px(residual_px: FloatArray, sd_px: FloatArray) -> float:
    """What an alignment leaves of (n,) edges with (n,) standard deviations.

    An edge that is itself known to half a pixel cannot tell of a third of one.
    """
    weight = 1 / (sd_px**2 + _SHARP_SD_PX**2)
    return float(np.sqrt(np.average(residual_px**2, weights=weight)))


def _left(
    expectation: ViewExpectation,
    alignment: Alignment,
    found: list[EdgeMeasurement],
    index: int,
) -> float:
    """Offset of an edge that the alignment does not explain, px."""
    edge = expectation.edges[index]
    middle = alignment.apply((edge.start_px + edge.end_px) / 2)
    line = found[index].line
    return float(line.across @ (line.middle_px - middle))


def _unfitted(expectation: ViewExpectation, found: int) -> float:
    """Residual without a fit: none to speak of if the plan has too few edges itself."""
    expected = sum(not edge.contrast < _FAINT for edge in expectation.edges)
    return 0.0 if found == expected or expected < _FEWEST_EDGES else float("inf")


def _fit(
    expectation: ViewExpectation,
    alignment: Alignment,
    found: list[EdgeMeasurement],
    use: IntArray,
) -> AlignmentFit:
    expected = [
        alignment.line(expectation.edges[i].start_px, expectation.edges[i].end_px)
        for i in use
    ]
    return fit_alignment(expected, [found[i].line for i in use], _sd_px(found, use))


def _share(expectation: ViewExpectation, agrees: BoolArray) -> float:
    """Share of the expected length found, faint edges left out."""
    length = np.array([edge.length_px for edge in expectation.edges])
    contrast = np.array([edge.contrast for edge in expectation.edges])
    counts = ~(contrast < _FAINT)
    total = float(length[counts].sum())
    return float(length[counts & agrees].sum() / total) if total else 0.0


def _needs_search(view: MeasuredView) -> bool:
    return (
        view.share_before < _FOUND_SHARE
        or view.rms_px > _LARGEST_RESIDUAL_PX
        or view.alignment.shift_px > _SEARCH_PX
    )


def _second_look(
    picture: Picture,
    expectation: ViewExpectation,
    view: MeasuredView,
    blur_px: FloatArray,
) -> MeasuredView:
    """Search the edges that disagree close to where the others say they are."""
    view = _posed(expectation, view)
    which = ~view.agrees
    if not which.any() or not view.agrees.any():
        return view
    again = _measure(picture, expectation, view, blur_px, _AGAIN_PX, np.asarray(which))
    merged = [
        new if new.found else old for new, old in zip(again, view.found, strict=True)
    ]
    better = _aligned(expectation, view.alignment, merged, view.coarse)
    return _posed(expectation, replace(better, share_before=view.share_before))


def _posed(expectation: ViewExpectation, view: MeasuredView) -> MeasuredView:
    """Judge the edges by a motion in space where that explains the picture better."""
    near = [
        i
        for i, m in enumerate(view.found)
        if m.found and abs(view.residual_px[i]) < _POSE_REACH_PX + 2 * view.rms_px
    ]
    if len(near) < _FEWEST_FOR_POSE:
        return view
    edges = [expectation.edges[i] for i in near]
    pose = fit_pose(edges, [view.found[i].line for i in near], expectation.plane)
    if pose is None or pose.residual_px > _POSE_GAIN * max(view.rms_px, _FINE_PX):
        return view
    posed = replace(view, pose=pose)
    residual, agrees = view.residual_px.copy(), view.agrees.copy()
    for i, m in enumerate(view.found):
        if m.found:
            middle = posed.line(expectation, i).middle_px
            residual[i] = float(m.line.across @ (m.line.middle_px - middle))
            gate = _GATE_PX + _GATE_PER_BLUR * m.blur_px
            agrees[i] = max(abs(residual[i]), m.offset_sd_px) < gate
    share = _share(expectation, agrees)
    return replace(posed, residual_px=residual, agrees=agrees, share_after=share)
