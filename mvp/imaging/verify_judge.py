"""The verdict: one cause for the whole picture, or the first broken promise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvp.imaging.cause import Evidence, Finding, picture_fault, residual_limit_px
from mvp.imaging.verify_edges import (
    LOST,
    SATURATED,
    SMALLEST_SNR,
    beside_words,
    broken_promises,
    faint,
)
from mvp.imaging.verify_holes import broken_by_hole

if TYPE_CHECKING:
    from mvp.imaging.expectation import ViewExpectation
    from mvp.imaging.verify_data import EdgeReport, HoleReport, PointReport, Verdict

_NOTE_OFFSET_PX = 0.5
_MOST_NAMES = 6


@dataclass(frozen=True)
class Reports:
    """All features of a view as measured, and the contrast that is too little."""

    edges: tuple[EdgeReport, ...]
    holes: tuple[HoleReport, ...]
    points: tuple[PointReport, ...]
    faint_below: float

    def lost(self) -> tuple[str, ...]:
        """Features that should stand out and are not seen on three quarters."""
        lost = [e.name for e in self.edges if self._hidden(e)]
        return tuple(lost + [h.feature for h in self.holes if self._hidden(h)])

    def pale(self) -> tuple[str, ...]:
        """Features without contrast, as predicted or as seen."""
        pale = [e.name for e in self.edges if self.is_pale(e)]
        return tuple(pale + [h.feature for h in self.holes if self.is_pale(h)])

    def crowded(self, expectation: ViewExpectation) -> tuple[str, ...]:
        """Features not found as planned while another line runs close beside them."""
        close = [
            e.name
            for e in self.edges
            if e.crowded and (e.step is None or broken_promises(e, expectation))
        ]
        return tuple(
            close
            + [
                h.feature
                for h in self.holes
                if h.crowded and (h.step is None or broken_by_hole(h, expectation))
            ]
        )

    def unmeasured(self) -> tuple[str, ...]:
        """Features whose size or place was not found."""
        missing = [
            e.name for e in self.edges if e.measured_px is None and e.length_asked
        ]
        missing += [h.feature for h in self.holes if h.measured_px is None]
        return tuple(
            missing + [p.feature for p in self.points if p.measured_px is None]
        )

    def kept(self, expectation: ViewExpectation) -> bool:
        """Every feature was found where plan and picture put it, as promised."""
        limit_px = residual_limit_px(expectation)
        measured: list[EdgeReport | HoleReport] = [*self.edges, *self.holes]
        if any(abs(r.offset_after_px or 0.0) > limit_px for r in measured):
            return False
        doubtful = self.lost() or self.pale() or self.crowded(expectation)
        if doubtful or any(r.offset_px is None for r in (*measured, *self.points)):
            return False
        return bool(measured or self.points) and not _first_broken(expectation, self)

    def _hidden(self, report: EdgeReport | HoleReport) -> bool:
        missing = report.step is None or report.visible_fraction < LOST
        unsure = report.crowded or faint(report, self.faint_below)
        return missing and not unsure

    def is_pale(self, report: EdgeReport | HoleReport) -> bool:
        """Without contrast, as predicted or as seen."""
        return faint(report, self.faint_below) or report.snr < SMALLEST_SNR


def judge(
    expectation: ViewExpectation, evidence: Evidence, reports: Reports
) -> tuple[Verdict, Finding | None]:
    """A pass needs every promise measured and kept."""
    finding = picture_fault(evidence, expectation) or _first_broken(
        expectation, reports
    )
    if finding is not None:
        return "fail", finding
    pale, crowded = reports.pale(), reports.crowded(expectation)
    if pale:
        text = f"{listed(pale)}: too little contrast in this light"
        return "not measurable", Finding("low contrast", text)
    if crowded:
        text = f"{listed(crowded)}: another line is too close beside it"
        return "not measurable", Finding("resolution", text)
    missing = reports.unmeasured()
    if missing:
        text = f"{listed(missing)}: an end is not marked by any visible edge"
        return "not measurable", Finding("no end found", text)
    return "pass", None


def listed(names: tuple[str, ...]) -> str:
    """The first few of some names, each once."""
    once = list(dict.fromkeys(names))
    more = len(once) - _MOST_NAMES
    return ", ".join(once[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def _first_broken(expectation: ViewExpectation, reports: Reports) -> Finding | None:
    pale = reports.pale()
    for edge in reports.edges:
        broken = broken_promises(edge, expectation)
        if broken and edge.name not in pale and not edge.crowded:
            return _named(edge.name, edge.saturated, broken)
    for hole in reports.holes:
        broken = broken_by_hole(hole, expectation)
        if broken and not hole.crowded and not reports.is_pale(hole):
            return _named(hole.feature, hole.saturated, broken)
    for point in reports.points:
        if point.offset_px is not None and point.offset_px > point.allowed_offset_px:
            words = beside_words(point.offset_px, point.allowed_offset_px)
            text = f"{point.feature}: {words}"
            return Finding("misalignment", text)
    return None


def _named(name: str, saturated: float, broken: list[str]) -> Finding:
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


def remarks(reports: Reports) -> tuple[str, ...]:
    """What is worth knowing about a pass."""
    notes = []
    measured: list[EdgeReport | HoleReport] = [*reports.edges, *reports.holes]
    for report in measured:
        offset = abs(report.offset_px or 0.0)
        if offset > _NOTE_OFFSET_PX:
            name = getattr(report, "name", report.feature)
            notes.append(
                f"{name} lies {offset:.1f} px beside its place, within the"
                f" tolerance of {report.allowed_offset_px:.1f} px"
            )
    return tuple(notes)
