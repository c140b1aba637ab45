"""The straight edges and hole rims of a part, measured to find out where it lies.

The expectation says which line is which; the picture may lie shifted, turned and scaled
against it as far as ``measure_view`` searches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.cause import exposure_fault
from mvp.imaging.measure_edges import SATURATED, SHADED_SNR, trim_px
from mvp.imaging.measure_exposure import feature_exposure
from mvp.imaging.measure_view import CLIPPED, MeasuredView, measure_view
from mvp.imaging.verify import picture_of
from mvp.imaging.verify_holes import hole_report

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.imaging.edge_samples import Picture
    from mvp.imaging.expectation import ExpectedEdge, ViewExpectation
    from mvp.imaging.measure_edges import EdgeMeasurement

# Lines of a drawing and of a picture agree no better: rounded edges, lens model.
_MODEL_PX = 0.03
# What the slope of the grey across a faint step may move it; in rendered pictures of
# steps of 4 to 10 times the noise 0.05 to 0.14 px (root mean square).
_SHADING_PX = 0.1
# Width of a step, px: that of a pixel, and of the spread in a blur circle.
_PIXEL_WIDTH, _WIDTH_PER_BLUR = 1.0, 0.8
_LARGEST_MISFIT = 6.0
_SHORTEST_PX = 12.0


@dataclass(frozen=True, eq=False)
class PartLines:
    """What was found, places in raw pixels, the drawing in the expected camera's frame.

    Attributes:
        ends_mm: (e, 2, 3) ends of the measured pieces.
        places_px: (k, 2) two places on each line.
        edge: (k,) the line of each place.
        sigma_px: (k,) one standard deviation across the line.
        names: (e,).
        agrees: (e,) it lies where the others put it; edges at other depths than most
            do so only when the expected pose is nearly right.
        centres_mm: (c, 3) of rims.
        axes: (c, 3).
        radii_mm: (c,).
        rim_px: (c, 2) centres of the ellipses.
        rim_sigma_px: (c,).
        rim_names: (c,).
        found: share of the expected length of edges that was found.
        reason: why nothing could be measured.
    """

    ends_mm: FloatArray
    places_px: FloatArray
    edge: IntArray
    sigma_px: FloatArray
    names: tuple[str, ...]
    agrees: BoolArray
    centres_mm: FloatArray
    axes: FloatArray
    radii_mm: FloatArray
    rim_px: FloatArray
    rim_sigma_px: FloatArray
    rim_names: tuple[str, ...]
    found: float = 0.0
    reason: str = ""


def measure_part(
    image: NDArray[np.generic], full_scale: float, expectation: ViewExpectation
) -> PartLines:
    """Measure every expected edge and rim that the picture shows.

    Args:
        image: (rows, columns) linear grey levels.
        full_scale: the level at which a pixel saturates.
        expectation: of this lens setting, at about this pose.

    Raises:
        ValueError: the picture is not the size of the sensor.
    """
    picture = picture_of(image, full_scale, expectation)
    fault = exposure_fault(feature_exposure(picture, expectation))
    if fault is not None:
        return _lines([], [], reason=fault.explanation)
    view = measure_view(picture, expectation)
    edges = [
        _on_edge(picture, edge, found, agrees=bool(agrees))
        for edge, found, agrees in zip(
            expectation.edges, view.found, view.agrees, strict=True
        )
        if _clean(edge, found)
    ]
    return _lines(edges, _rims(picture, expectation, view), found=view.share_after)


@dataclass(frozen=True, eq=False)
class _OnEdge:
    name: str
    ends_mm: FloatArray
    places_px: FloatArray
    sigma_px: float
    agrees: bool


@dataclass(frozen=True, eq=False)
class _OnRim:
    name: str
    centre_mm: FloatArray
    axis: FloatArray
    radius_mm: float
    place_px: FloatArray
    sigma_px: float


def _clean(edge: ExpectedEdge, found: EdgeMeasurement) -> bool:
    """One line beside which nothing else was taken for it, and that nothing moved.

    Clipping moves a line towards its dark side.
    """
    return (
        found.found
        and not edge.crowded
        and found.covariance is not None
        and found.saturated <= CLIPPED
        and found.misfit < _LARGEST_MISFIT
        and edge.length_px >= _SHORTEST_PX
    )


def _on_edge(
    picture: Picture, edge: ExpectedEdge, found: EdgeMeasurement, *, agrees: bool
) -> _OnEdge:
    """Two places that know as much of offset and slope as the fit does."""
    covariance = np.zeros((2, 2)) if found.covariance is None else found.covariance
    offset, slope = max(covariance[0, 0], 0.0), max(covariance[1, 1], 0.0)
    line = found.line
    furthest = line.length_px / 2 - trim_px(line, found.blur_px)
    half = min(float(np.sqrt(offset / slope)), furthest) if slope > 0 else furthest
    places = line.middle_px + np.outer([-half, half], line.along)
    return _OnEdge(
        edge.name,
        np.stack([edge.start_mm, edge.end_mm]),
        picture.plane.raw(places),
        float(np.sqrt(2 * (offset + _MODEL_PX**2 + _moved_px(found) ** 2))),
        agrees,
    )


def _moved_px(found: EdgeMeasurement) -> float:
    """How far a line may be moved by what the model of its step does not hold.

    What is left beyond the noise is alike all along a line: many pixels do not average
    it away. A faint step is fitted without the shading on either side.
    """
    share = np.sqrt(max(found.misfit**2 - 1, 0.0)) / found.snr
    width = np.hypot(_PIXEL_WIDTH, _WIDTH_PER_BLUR * found.blur_px)
    shading = 0.0 if found.snr > SHADED_SNR else _SHADING_PX
    return float(np.hypot(share * width, shading))


def _rims(
    picture: Picture, expectation: ViewExpectation, view: MeasuredView
) -> list[_OnRim]:
    found = []
    for rim in expectation.rims:
        report = hole_report(picture, expectation, view, rim)
        sd = report.axes_sd_px
        if sd is None or report.crowded or report.saturated > SATURATED:
            continue
        outline = picture.plane.ideal(np.array(report.rim_px))
        found.append(
            _OnRim(
                rim.feature,
                rim.centre_mm,
                rim.axis,
                rim.radius_mm,
                picture.plane.raw(outline.mean(axis=0)),
                float(np.hypot(max(sd) / 2, _MODEL_PX)),
            )
        )
    return found


def _lines(
    edges: list[_OnEdge], rims: list[_OnRim], *, found: float = 0.0, reason: str = ""
) -> PartLines:
    return PartLines(
        ends_mm=np.array([e.ends_mm for e in edges]).reshape(-1, 2, 3),
        places_px=np.array([e.places_px for e in edges]).reshape(-1, 2),
        edge=np.repeat(np.arange(len(edges)), 2),
        sigma_px=np.repeat([e.sigma_px for e in edges], 2).astype(np.float64),
        names=tuple(e.name for e in edges),
        agrees=np.array([e.agrees for e in edges], np.bool_),
        centres_mm=np.array([r.centre_mm for r in rims]).reshape(-1, 3),
        axes=np.array([r.axis for r in rims]).reshape(-1, 3),
        radii_mm=np.array([r.radius_mm for r in rims], np.float64),
        rim_px=np.array([r.place_px for r in rims]).reshape(-1, 2),
        rim_sigma_px=np.array([r.sigma_px for r in rims], np.float64),
        rim_names=tuple(r.name for r in rims),
        found=found,
        reason=reason,
    )
