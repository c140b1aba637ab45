"""Small geometry of lines in space and in the picture, for predictions."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray
    from mvp.imaging.expectation import ExpectedEdge
    from mvp.imaging.measure_plane import ImagePlane
    from mvp.imaging.predict_lines import Lines

SAME_PLACE_MM = 0.05


def straight_segments(
    polyline_mm: FloatArray,
) -> list[tuple[FloatArray, FloatArray]]:
    """Maximal straight segments of a polyline (n, 3)."""
    points = [polyline_mm[0]]
    for k in range(1, len(polyline_mm) - 1):
        a = polyline_mm[k]
        before, after = a - points[-1], polyline_mm[k + 1] - a
        size = np.linalg.norm(before) * np.linalg.norm(after)
        if np.linalg.norm(np.cross(before, after)) > 1e-6 * size or before @ after < 0:
            points.append(a)
    points.append(polyline_mm[-1])
    return list(pairwise(points))


def on_line(lines: Lines, a_mm: FloatArray, b_mm: FloatArray) -> BoolArray:
    """Which CAD edges overlap the segment a-b along one line."""
    along = lines.end_mm - lines.start_mm
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    unit = along / length[:, None]
    off = []
    places = []
    for point in (a_mm, b_mm):
        relative = point - lines.start_mm
        place = np.einsum("ki,ki->k", relative, unit)
        off.append(np.linalg.norm(relative - place[:, None] * unit, axis=1))
        places.append(place)
    low, high = np.minimum(*places), np.maximum(*places)
    overlap = np.minimum(high, length) - np.maximum(low, 0.0)
    return np.asarray((np.maximum(*off) < SAME_PLACE_MM) & (overlap > SAME_PLACE_MM))


def distance_mm(lines: Lines, point_mm: FloatArray) -> FloatArray:
    """Distance of a point from every line segment, (k,) mm."""
    along = lines.end_mm - lines.start_mm
    square = np.maximum(np.einsum("ki,ki->k", along, along), 1e-12)
    relative = point_mm - lines.start_mm
    place = np.clip(np.einsum("ki,ki->k", relative, along) / square, 0, 1)
    return np.asarray(np.linalg.norm(relative - place[:, None] * along, axis=1))


def cross(a: FloatArray, b: FloatArray | None) -> float:
    """|sin| of the angle between two unit vectors (2,); 1 without a second one."""
    return 1.0 if b is None else float(abs(a[0] * b[1] - a[1] * b[0]))


def cropped(
    edge: ExpectedEdge, low: float, high: float, plane: ImagePlane
) -> ExpectedEdge:
    """A piece of an edge, by shares of its length in the picture."""
    low, high = max(low, 0.0), min(high, 1.0)
    if low <= 0.0 and high >= 1.0:
        return edge
    depth = edge.start_mm[2], edge.end_mm[2]
    ends = []
    for share in (low, high):
        # Even steps in the picture are even steps in 1/z along the edge.
        part = share * depth[0] / (share * depth[0] + (1 - share) * depth[1])
        ends.append(edge.start_mm * (1 - part) + edge.end_mm * part)
    middle = (ends[0] + ends[1]) / 2
    last = len(edge.visible) - 1
    seen = slice(int(low * last), int(np.ceil(high * last)) + 1)
    return replace(
        edge,
        visible=edge.visible[seen],
        start_px=plane.project(ends[0]),
        end_px=plane.project(ends[1]),
        start_mm=ends[0],
        end_mm=ends[1],
        blur_px=float(plane.blur_px(middle[2])),
    )


def detail_px(edge: ExpectedEdge, plane: ImagePlane) -> float:
    """Image of the required detail along the edge, raw pixels, at its worst end."""
    if edge.requirement is None:
        return float("nan")
    along = edge.end_mm - edge.start_mm
    step = along / np.linalg.norm(along) * edge.requirement.detail_mm
    sizes = []
    for point, sign in ((edge.start_mm, 1.0), (edge.end_mm, -1.0)):
        pair = plane.raw(plane.project(np.stack([point, point + sign * step])))
        sizes.append(float(np.linalg.norm(pair[1] - pair[0])))
    return min(sizes)
