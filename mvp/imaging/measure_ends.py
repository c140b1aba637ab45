"""Ends of a measured edge: where the lines of its neighbours cross it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray
    from mvp.imaging.edge_samples import Line, Picture
    from mvp.imaging.measure_edges import EdgeMeasurement

GATE_PX = 0.8
GATE_PER_BLUR = 0.1
_FLOOR_PX = 0.03
_PROFILE_PX = 10.0
_AGREEMENT_PX = 1.0
# The half-amplitude place lies this far inside the corner (the corner rounds it off).
_INSIDE_LOW_PX, _INSIDE_HIGH_PX = -0.8, 1.8


@dataclass(frozen=True, eq=False)
class EndPoint:
    """One end of an edge, or the reason why it is not known.

    Attributes:
        place_px: (2,) ideal px, nan when not measured.
        covariance: (2, 2) px^2.
        neighbours: names of the edges that cross there.
        reason: empty when measured.
    """

    place_px: FloatArray
    covariance: FloatArray
    neighbours: tuple[str, ...]
    reason: str = ""

    @property
    def measured(self) -> bool:
        """Whether a place was found."""
        return not self.reason


def not_measured(reason: str) -> EndPoint:
    """An end that nothing in the picture marks."""
    return EndPoint(np.full(2, np.nan), np.full((2, 2), np.nan), (), reason)


@dataclass(frozen=True, eq=False)
class Crossing:
    """A neighbour edge at an end.

    Attributes:
        name: of the edge.
        found: its measurement.
        residual_px: its offset left by the alignment of the whole picture.
    """

    name: str
    found: EdgeMeasurement
    residual_px: float


def find_end(
    picture: Picture,
    own: EdgeMeasurement,
    expected_px: FloatArray,
    neighbours: Sequence[Crossing],
    own_residual_px: float,
) -> EndPoint:
    """Intersect an edge with its trusted neighbours.

    A neighbour is trusted when it lies where the rest of the picture says. One that
    does not is believed only if the edge itself visibly ends where it crosses, or two
    such neighbours cross the edge in one point: then the part really differs there.

    Args:
        picture: for a look at where the step fades out.
        own: the edge.
        expected_px: where the end should be after alignment.
        neighbours: edges through the same corner.
        own_residual_px: offset of the edge itself left by the alignment.
    """
    if not own.found:
        return not_measured("the edge itself was not found")
    usable = [n for n in neighbours if n.found.found and n.found.covariance is not None]
    if not usable:
        return not_measured("no neighbour edge was found there")
    agreed = [n for n in usable if _agrees(n, own_residual_px)]
    if agreed:
        return _intersection(own, agreed, expected_px)
    if len(usable) > 1:
        corner = _intersection(own, usable, expected_px)
        if _misfit_px(own, usable, corner.place_px) < _AGREEMENT_PX:
            return corner
    for neighbour in usable:
        corner = _intersection(own, [neighbour], expected_px)
        if _ends_there(picture, own, corner.place_px, expected_px):
            return corner
    return not_measured("no neighbour edge lies where the edge ends")


def _agrees(neighbour: Crossing, own_residual_px: float) -> bool:
    gate = GATE_PX + GATE_PER_BLUR * neighbour.found.blur_px
    return abs(neighbour.residual_px) < gate + min(abs(own_residual_px), 1.0)


def _row(found: EdgeMeasurement, at_px: FloatArray) -> tuple[FloatArray, float, float]:
    """Normal, offset and variance of a measured line near a point."""
    line = found.line
    s, _ = line.place(at_px)
    lever = np.array([1.0, float(s)])
    covariance = found.covariance if found.covariance is not None else np.eye(2)
    variance = float(lever @ covariance @ lever) + _FLOOR_PX**2
    return line.across, float(line.across @ line.middle_px), variance


def _intersection(
    own: EdgeMeasurement, neighbours: Sequence[Crossing], near_px: FloatArray
) -> EndPoint:
    rows = [_row(own, near_px)] + [_row(n.found, near_px) for n in neighbours]
    normals = np.array([row[0] for row in rows])
    weight = np.array([1 / row[2] for row in rows])
    gram = normals.T @ (normals * weight[:, None])
    right = normals.T @ (weight * np.array([row[1] for row in rows]))
    return EndPoint(
        np.linalg.solve(gram, right),
        np.linalg.inv(gram),
        tuple(n.name for n in neighbours),
    )


def _misfit_px(
    own: EdgeMeasurement, neighbours: Sequence[Crossing], place: FloatArray
) -> float:
    lines = [own.line] + [n.found.line for n in neighbours]
    return max(abs(float(line.place(place)[1])) for line in lines)


def _ends_there(
    picture: Picture,
    own: EdgeMeasurement,
    corner_px: FloatArray,
    expected_px: FloatArray,
) -> bool:
    """Whether the step fades out just inside the corner."""
    line = own.line
    sign = 1.0 if float(line.place(expected_px)[0]) > 0 else -1.0
    corner = float(line.place(corner_px)[0]) * sign
    faded = _half_amplitude(picture, own, sign, corner)
    return bool(_INSIDE_LOW_PX < corner - faded < _INSIDE_HIGH_PX)


def _half_amplitude(
    picture: Picture, own: EdgeMeasurement, sign: float, corner: float
) -> float:
    """Place along the edge (towards the end) where half of the step is left; nan."""
    line, blur = own.line, own.blur_px
    s = np.arange(corner - _PROFILE_PX, corner + _PROFILE_PX, 0.5)
    near, far = 0.7 + blur / 2, 2.2 + blur / 2
    t = np.concatenate([np.linspace(-far, -near, 5), np.linspace(near, far, 5)])
    places = _places(line, sign * s, t)
    grey = picture.at(places)
    step = grey[:, 5:].mean(axis=1) - grey[:, :5].mean(axis=1)
    share = np.convolve(step / own.step, np.ones(3) / 3, mode="same")
    below = np.flatnonzero(~(share > 0.5))
    below = below[below > 3]
    if not len(below):
        return float("nan")
    k = int(below[0])
    drop = share[k - 1] - share[k]
    return float(s[k - 1] + 0.5 * (share[k - 1] - 0.5) / max(drop, 1e-6))


def _places(line: Line, s: FloatArray, t: FloatArray) -> FloatArray:
    return np.asarray(
        line.middle_px + s[:, None, None] * line.along + t[None, :, None] * line.across
    )
