"""Where in a focus sweep the picture is sharpest, and where it should be."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.verify import verify_view

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mvp.geometry import FloatArray
    from mvp.imaging.expectation import ViewExpectation
    from mvp.imaging.sensor_noise import FrameArray
    from mvp.imaging.verify_data import ViewVerification

_FEWEST = 4
_MODEL_SHARE = 0.02
_FLOOR_PX2 = 0.05
_PLACES = 33
_PROBE_MM = 0.1
_FARTHEST_BLUR = 2.0
_NEAREST_SHARE = 0.6
_ABOVE_F = 0.95
_FIRST_FRAMES = 4


@dataclass(frozen=True)
class BestFocus:
    """The sharpest place of a sweep.

    Attributes:
        d_mm: image distance with the smallest mean b^2 of the feature edges.
        sd_mm: its standard deviation.
        planned_mm: what the plan says.
        frames: taken at every distance.
    """

    d_mm: float
    sd_mm: float
    planned_mm: float
    frames: int = 1


def focus_sweep(
    plan: ViewExpectation,
    expect: Callable[[float], ViewExpectation],
    take: Callable[[float], FrameArray],
    *,
    full_scale: float,
    wanted_sd_mm: float = 0.002,
    most_frames: int = 64,
) -> BestFocus:
    """Take pictures on both sides of the planned best focus, and find the true one.

    A few frames at every distance tell how many must be averaged for the wanted
    uncertainty; then the others are taken.

    Args:
        plan: what the view must show.
        expect: what it would show at an image distance.
        take: one frame at an image distance.
        full_scale: grey level of a full well.
        wanted_sd_mm: standard deviation to reach.
        most_frames: at one distance; the stated uncertainty tells if they were too few.

    Raises:
        ValueError: no feature edge, none measured often enough, or no minimum.
    """
    distances = [float(d) for d in sweep_distances_mm(plan)]
    expected = [expect(d) for d in distances]
    totals = [np.zeros(1) for _ in distances]
    taken, wanted = 0, min(_FIRST_FRAMES, most_frames)
    while True:
        for k, d in enumerate(distances):
            for _ in range(wanted - taken):
                totals[k] = totals[k] + np.asarray(take(d), np.float64)
        first, taken = not taken, wanted
        seen = [
            verify_view(total / taken, full_scale, there)
            for total, there in zip(totals, expected, strict=True)
        ]
        best = replace(best_focus(plan, distances, seen), frames=taken)
        needed = int(np.ceil(taken * (best.sd_mm / wanted_sd_mm) ** 2))
        wanted = min(needed, most_frames)
        if wanted <= taken or not first:
            return best


def sweep_distances_mm(plan: ViewExpectation, count: int = 6) -> FloatArray:
    """Where to take the pictures of a sweep: on both sides of the planned best focus.

    They reach to twice the acceptable circle, and not to an image distance below the
    focal length. Near the sharpest place b^2 hardly changes, and says little.
    """
    best = planned_best_focus_mm(plan)
    there = replace(plan.plane, d_mm=best)
    per_mm = _mean_b2(plan, best + _PROBE_MM) - _mean_b2(plan, best)
    reach = _FARTHEST_BLUR * plan.c_px * _PROBE_MM / np.sqrt(per_mm)
    reach = min(reach, _ABOVE_F * (best - there.f_mm))
    side = np.linspace(_NEAREST_SHARE, 1.0, count // 2) * reach
    return np.asarray(np.concatenate([best - side[::-1], best + side]))


def best_focus(
    plan: ViewExpectation,
    d_mm: Sequence[float],
    verifications: Sequence[ViewVerification],
) -> BestFocus:
    """The image distance that makes the mean b^2 of the feature edges smallest.

    The b^2 of an edge is a parabola in d. How far its vertex lies from the predicted one
    is measured for every edge, and the mean is weighted by each edge's own uncertainty.
    So an edge of strong contrast may tell where one of weak contrast is sharpest: the
    plan knows how much nearer it is.

    Args:
        plan: what the view must show.
        d_mm: the image distances of the sweep.
        verifications: of the pictures taken there, each against its own distance.

    Raises:
        ValueError: no edge was measured in four pictures, or there is no minimum.
    """
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    for d, verification in zip(d_mm, verifications, strict=True):
        for edge in verification.edges:
            square, sd = edge.blur.square_px2, edge.blur.square_sd_px2
            weighed = edge.blur.weighed_px2
            if square is not None and sd is not None and weighed is not None:
                total = np.sqrt(sd**2 + (_MODEL_SHARE * square) ** 2 + _FLOOR_PX2**2)
                rows = found.setdefault(edge.name, [])
                rows.append((d, square, float(total), weighed))
    curves = [np.array(rows) for rows in found.values() if len(rows) >= _FEWEST]
    if not curves:
        raise ValueError("a focus sweep needs an edge measured in four pictures")
    shift, sd = np.array([_shift(rows) for rows in curves]).T
    weight = 1 / sd**2
    planned = planned_best_focus_mm(plan)
    return BestFocus(
        planned + float(np.average(shift, weights=weight)),
        float(1 / np.sqrt(weight.sum())),
        planned,
    )


def _shift(rows: FloatArray) -> tuple[float, float]:
    """Measured less predicted vertex of one edge, and its standard deviation."""
    d, square, sd, weighed = rows.T
    vertex, vertex_sd = _vertex(d, square, sd)
    return vertex - _vertex(d, weighed, sd)[0], vertex_sd


def _vertex(d: FloatArray, square: FloatArray, sd: FloatArray) -> tuple[float, float]:
    middle = float(d.mean())
    fit, covariance = np.polyfit(d - middle, square, 2, w=1 / sd, cov="unscaled")
    second, first, _ = fit
    if not second > 0:
        raise ValueError("the sweep shows no sharpest place")
    vertex = -first / (2 * second)
    slope = np.array([-vertex / second, -1 / (2 * second), 0.0])
    return middle + float(vertex), float(np.sqrt(slope @ covariance @ slope))


def planned_best_focus_mm(expectation: ViewExpectation) -> float:
    """The image distance with the smallest predicted mean b^2 of the feature edges."""
    d = expectation.plane.d_mm + np.array([-_PROBE_MM, 0.0, _PROBE_MM])
    square = np.array([_mean_b2(expectation, float(x)) for x in d])
    second, first, _ = np.polyfit(d - d[1], square, 2)
    return float(d[1] - first / (2 * second))


def _mean_b2(expectation: ViewExpectation, d_mm: float) -> float:
    """Predicted mean b^2 of all feature edges, along their pictures."""
    edges = expectation.feature_edges
    if not edges:
        raise ValueError("no feature edge to focus on")
    plane = replace(expectation.plane, d_mm=d_mm)
    share = np.linspace(0, 1, _PLACES)
    blur = np.array([plane.blur_px(edge.depth_mm_at(share)) for edge in edges])
    return float(np.mean(blur**2))
