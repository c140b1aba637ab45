"""Grey levels about the features: metering, and too bright or too dark."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from mvp.imaging.measure_edges import SATURATED
from mvp.imaging.verify_data import Exposure

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mvp.geometry import FloatArray
    from mvp.imaging.edge_samples import Picture
    from mvp.imaging.expectation import ViewExpectation

_BAND_PX = 6.0
_TARGET = 0.6
_LARGEST_FACTOR = 64.0


def feature_band(picture: Picture, expectation: ViewExpectation) -> FloatArray:
    """Grey levels (n,) of all pixels within 6 px of a predicted feature line."""
    plane = expectation.plane
    mask = np.zeros(picture.grey.shape, dtype=np.uint8)
    share = np.linspace(0, 1, 17)[:, None]
    lines = [
        e.start_px * (1 - share) + e.end_px * share for e in expectation.feature_edges
    ]
    lines += [np.vstack([r.points_px, r.points_px[:1]]) for r in expectation.rims]
    lines += [np.stack([p.point_px, p.point_px + 0.1]) for p in expectation.points]
    width = int(2 * _BAND_PX + 1)
    for line in lines:
        raw = np.rint(plane.raw(line)).astype(np.int32)
        cv2.polylines(mask, [raw], isClosed=False, color=1, thickness=width)
    return np.asarray(picture.grey[mask > 0])


def feature_exposure(picture: Picture, expectation: ViewExpectation) -> Exposure:
    """95th percentile and clipped share of the feature band; 0, 0 if out of frame."""
    band = feature_band(picture, expectation)
    if not len(band):
        return Exposure(0.0, 0.0)
    level = float(np.percentile(band, 95))
    return Exposure(level, float((band >= SATURATED).mean()))


def meter_exposure(
    image: NDArray[np.generic], full_scale: float, expectation: ViewExpectation
) -> float:
    """Factor on the exposure time that brings the features to 60 % of full scale.

    A saturated picture tells only that it is too bright: the factor is then at most
    1/4, and one more picture is needed.
    """
    from mvp.imaging.verify import picture_of

    exposure = feature_exposure(picture_of(image, full_scale, expectation), expectation)
    factor = _TARGET / max(exposure.level_95, _TARGET / _LARGEST_FACTOR)
    return min(factor, 0.25) if exposure.level_95 >= SATURATED else factor
