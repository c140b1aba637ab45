"""Reports of hole rims, and what they must keep."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.cause import scale_tolerance, shift_tolerance_px
from mvp.imaging.hole_ellipse import Ellipse, fitted_ellipse
from mvp.imaging.hole_rim import RimMeasurement, measure_rim
from mvp.imaging.verify_data import HoleReport
from mvp.imaging.verify_edges import (
    LENGTH_PX,
    LENGTH_SHARE,
    blur_of,
    broken_by_any,
)

if TYPE_CHECKING:
    from mvp.imaging.edge_samples import Picture
    from mvp.imaging.expectation import ExpectedRim, ViewExpectation
    from mvp.imaging.measure_view import MeasuredView

_ALIGNED_SEARCH_PX = 3.0
_UNALIGNED_SEARCH_PX = 6.0
_FEWEST_FOR_ALIGNMENT = 4
_OUTLINE = 48
_DETAIL_DOUBT = 0.02


def hole_report(
    picture: Picture, expectation: ViewExpectation, view: MeasuredView, rim: ExpectedRim
) -> HoleReport:
    """Everything about one rim."""
    plan = fitted_ellipse(rim.points_px)
    expected = _now(plan, view, rim, expectation)
    aligned = int(view.agrees.sum()) >= _FEWEST_FOR_ALIGNMENT
    found = measure_rim(
        picture,
        expected,
        view.drawn(expectation),
        rim,
        search_px=_ALIGNED_SEARCH_PX if aligned else _UNALIGNED_SEARCH_PX,
    )
    measured = found.ellipse
    axes = measured.axes_px if found.found else None
    return HoleReport(
        feature=rim.feature,
        predicted_axes_px=rim.axes_px,
        measured_axes_px=axes,
        axes_sd_px=found.axes_sd_px if found.found else None,
        predicted_px=rim.axes_px[0],
        measured_px=axes[0] if axes else None,
        offset_px=_apart(measured, plan) if found.found else None,
        offset_after_px=_apart(measured, expected) if found.found else None,
        allowed_offset_px=shift_tolerance_px(expectation, (plan.x_px, plan.y_px)),
        visible_fraction=found.visible_fraction if found.found else 0.0,
        saturated=found.saturated,
        step=found.step if found.found else None,
        snr=found.snr,
        predicted_contrast=_contrast(rim),
        detail_px=_detail(rim, found),
        required_px=rim.requirement.pixels if rim.requirement else None,
        predicted_rim_px=_outline(expectation, plan),
        rim_px=_outline(expectation, measured) if found.found else (),
        blur=blur_of(found, rim.blur_px, expectation.c_px),
        notes=_notes(rim, found),
        crowded=rim.crowded,
    )


def _now(
    plan: Ellipse, view: MeasuredView, rim: ExpectedRim, expectation: ViewExpectation
) -> Ellipse:
    """The rim where it should be in this picture; eccentric angles are kept."""
    if view.pose is None:
        return plan.moved(view.alignment)
    centre = view.pose.places(rim.centre_mm, expectation.plane)
    start = expectation.plane.project(rim.centre_mm)
    by = centre - start
    return replace(plan, x_px=plan.x_px + float(by[0]), y_px=plan.y_px + float(by[1]))


def _contrast(rim: ExpectedRim) -> float | None:
    """What nine tenths of the rim exceed."""
    if np.isnan(rim.contrast).all():
        return None
    return float(np.nanpercentile(rim.contrast, 10))


def _apart(a: Ellipse, b: Ellipse) -> float:
    return float(np.hypot(a.x_px - b.x_px, a.y_px - b.y_px))


def _detail(rim: ExpectedRim, found: RimMeasurement) -> float | None:
    if not found.found or np.isnan(rim.detail_px):
        return None
    return float(rim.detail_px * found.ellipse.axes_px[1] / rim.axes_px[1])


def _outline(
    expectation: ViewExpectation, ellipse: Ellipse
) -> tuple[tuple[float, float], ...]:
    angle = np.arange(_OUTLINE) / _OUTLINE * 2 * np.pi
    raw = expectation.plane.raw(ellipse.points(angle))
    return tuple((float(x), float(y)) for x, y in raw)


def _notes(rim: ExpectedRim, found: RimMeasurement) -> tuple[str, ...]:
    notes = []
    if not found.found:
        notes.append(f"not found: {found.reason}")
    if not rim.visible.all():
        notes.append(f"the plan itself shows only {rim.visible.mean():.0%} of it")
    return tuple(notes)


def broken_by_hole(report: HoleReport, expectation: ViewExpectation) -> list[str]:
    """What a measured rim does not keep, in words."""
    broken = []
    if report.measured_axes_px is not None:
        pairs = zip(report.measured_axes_px, report.predicted_axes_px, strict=True)
        for measured, predicted in pairs:
            share = max(LENGTH_SHARE, scale_tolerance(expectation))
            allowed = max(LENGTH_PX, share * predicted)
            if abs(measured - predicted) > allowed:
                broken.append(
                    f"axis {measured:.1f} px instead of {predicted:.1f} px "
                    f"(limit +-{allowed:.1f} px)"
                )
    limit_px = max(report.allowed_offset_px, 1.0)
    return broken + broken_by_any(report, limit_px, _DETAIL_DOUBT)
