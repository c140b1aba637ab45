"""Where in a focus sweep the picture is sharpest, and where it should be."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray
    from mvp.imaging.expectation import ExpectedEdge, ViewExpectation
    from mvp.imaging.verify_data import ViewVerification

_FEWEST = 4
_MODEL_SHARE = 0.02
_FLOOR_PX2 = 0.05
_PLACES = 33


def best_focus_mm(
    d_mm: Sequence[float], verifications: Sequence[ViewVerification]
) -> float:
    """The image distance that makes the mean b^2 of the feature edges smallest.

    The b^2 of an edge is a parabola in d about its own best d, and all have the same
    opening, so the best d in common is the mean of the vertices. Each vertex comes
    from a weighted least-squares parabola.

    Args:
        d_mm: the image distances of the sweep.
        verifications: of the pictures taken there.

    Raises:
        ValueError: no edge was measured in four pictures, or there is no minimum.
    """
    found: dict[str, list[tuple[float, float, float]]] = {}
    for d, verification in zip(d_mm, verifications, strict=True):
        for edge in verification.edges:
            square, sd = edge.blur.square_px2, edge.blur.square_sd_px2
            if square is not None and sd is not None:
                total = np.sqrt(sd**2 + (_MODEL_SHARE * square) ** 2 + _FLOOR_PX2**2)
                found.setdefault(edge.name, []).append((d, square, float(total)))
    curves = [np.array(rows) for rows in found.values() if len(rows) >= _FEWEST]
    if not curves:
        raise ValueError("a focus sweep needs an edge measured in four pictures")
    return float(np.mean([_vertex(rows) for rows in curves]))


def _vertex(rows: FloatArray) -> float:
    d, square, sd = rows.T
    middle = float(d.mean())
    second, first, _ = np.polyfit(d - middle, square, 2, w=1 / sd)
    if not second > 0:
        raise ValueError("the sweep shows no sharpest place")
    return middle - float(first / (2 * second))


def planned_best_focus_mm(expectation: ViewExpectation) -> float:
    """The image distance with the smallest predicted mean b^2 of the feature edges."""
    edges = expectation.feature_edges
    if not edges:
        raise ValueError("no feature edge to focus on")
    d = expectation.plane.d_mm + np.array([-0.1, 0.0, 0.1])
    square = [np.mean([_mean_b2(expectation, e, float(x)) for e in edges]) for x in d]
    second, first, _ = np.polyfit(d - d[1], np.array(square), 2)
    return float(d[1] - first / (2 * second))


def _mean_b2(expectation: ViewExpectation, edge: ExpectedEdge, d_mm: float) -> float:
    """Mean b^2 along the picture of an edge, where 1/z is linear."""
    inverse = np.linspace(1 / edge.start_mm[2], 1 / edge.end_mm[2], _PLACES)
    blur = replace(expectation.plane, d_mm=d_mm).blur_px(1 / inverse)
    return float(np.mean(blur**2))
