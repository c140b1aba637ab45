"""The outline of a feature, sorted into what a picture is measured for.

A tessellated circle is measured as a rim. Straight sides are measured as edges; where
one runs smoothly into a curve its end is marked by nothing, so only its place across is
asked. Short chords of other curves are not measured, and the caller is told how much;
of a feature that has nothing else the longest chord is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.predict_contrast import (
    WIDER_PX,
    LitPlaces,
    both_sides,
    crowded,
    other_face,
)
from mvp.imaging.predict_geometry import cropped, straight_segments
from mvp.imaging.predict_rims import CROWDED, fitted_circle

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, Pose
    from mvp.imaging.expectation import ExpectedEdge
    from mvp.imaging.measure_plane import ImagePlane
    from mvp.imaging.render_scene import RenderScene

_FEWEST_ON_CIRCLE = 8
_OFF_CIRCLE = 2e-3
_OFF_CIRCLE_MM = 5e-3
_LARGEST_STEP_RAD = np.deg2rad(60.0)
_SAGITTA_PX = 0.5
_SMALLEST_RIM_PX = 12.0
_SHORTEST_PX = 8.0
_SHORTEST_CHORD_PX = 25.0
_SMOOTH_RAD = np.deg2rad(30.0)
_CROSSING_RAD = np.deg2rad(15.0)
_PLACES = 65
# A sliver of face thinner than this does not disturb.
_THINNEST_PX = 0.4
_SHORTEST_PIECE_PX = 20.0


@dataclass(frozen=True, eq=False)
class Side:
    """A straight side of an outline, part frame.

    Attributes:
        open_ends: an end runs on smoothly, so its length cannot be measured.
    """

    start_mm: FloatArray
    end_mm: FloatArray
    open_ends: bool = False


@dataclass(frozen=True, eq=False)
class OutlineParts:
    """What is measured of a feature's polylines.

    Attributes:
        rims: circles as polylines, part frame.
        sides: straight sides.
        left_px: length in the picture that is not measured.
        total_px: length in the picture of all polylines.
    """

    rims: tuple[FloatArray, ...]
    sides: tuple[Side, ...]
    left_px: float
    total_px: float


def outline_parts(
    polylines_mm: tuple[FloatArray, ...], part_from_camera: Pose, plane: ImagePlane
) -> OutlineParts:
    """Sort the polylines (n, 3), part frame, of one feature."""
    camera_from_part = part_from_camera.inverse()
    rims: list[FloatArray] = []
    sides: list[Side] = []
    left = total = 0.0
    for polyline in polylines_mm:
        points_camera = camera_from_part.apply(polyline)
        length = _lengths_px(points_camera[:-1], points_camera[1:], plane)
        total += float(length.sum())
        if is_circle(points_camera, plane):
            width = np.ptp(plane.project(points_camera), axis=0)
            if width.min() < _SMALLEST_RIM_PX:
                left += float(length.sum())
            else:
                rims.append(polyline)
            continue
        kept, unmeasured = _sides(polyline, camera_from_part, plane)
        sides += kept
        left += unmeasured
    if not rims and not sides:
        side, length_px = _longest(polylines_mm, camera_from_part, plane)
        sides, left = [side], left - length_px
    return OutlineParts(tuple(rims), tuple(sides), left, total)


def _longest(
    polylines_mm: tuple[FloatArray, ...], camera_from_part: Pose, plane: ImagePlane
) -> tuple[Side, float]:
    pieces = [piece for line in polylines_mm for piece in straight_segments(line)]
    camera = camera_from_part.apply(np.array(pieces))
    length = _lengths_px(camera[:, 0], camera[:, 1], plane)
    best = int(length.argmax())
    return Side(*pieces[best]), float(length[best])


def is_circle(points_camera: FloatArray, plane: ImagePlane) -> bool:
    """Whether a polyline (n, 3) is a circle as far as the picture can tell."""
    ring = points_camera[:-1]
    closed = np.linalg.norm(points_camera[0] - points_camera[-1]) < _OFF_CIRCLE_MM
    if not closed or len(ring) < _FEWEST_ON_CIRCLE:
        return False
    centre, axis, radius = fitted_circle(ring)
    relative = ring - centre
    height = relative @ axis
    flat = np.linalg.norm(relative - height[:, None] * axis, axis=1)
    off = max(float(np.abs(flat - radius).max()), float(np.abs(height).max()))
    if not off < _OFF_CIRCLE * radius + _OFF_CIRCLE_MM:
        return False
    chord = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    step = 2 * np.arcsin(np.minimum(chord.max() / (2 * radius), 1.0))
    scale = plane.f_cal_mm / plane.px_mm / centre[2]
    sagitta_px = radius * (1 - np.cos(step / 2)) * scale
    return bool(step < _LARGEST_STEP_RAD and sagitta_px < _SAGITTA_PX)


def _sides(
    polyline: FloatArray, camera_from_part: Pose, plane: ImagePlane
) -> tuple[list[Side], float]:
    """Straight sides worth measuring, and the length left out, px."""
    pieces = straight_segments(polyline)
    ends = np.array(pieces)
    camera = camera_from_part.apply(ends)
    length = _lengths_px(camera[:, 0], camera[:, 1], plane)
    turn = _turns(ends, closed=np.allclose(polyline[0], polyline[-1]))
    before, after = turn, np.roll(turn, -1)
    chord = (np.minimum(before, after) < _SMOOTH_RAD) & (length < _SHORTEST_CHORD_PX)
    kept = (length >= _SHORTEST_PX) & ~chord
    open_ends = _open(before, np.roll(kept, 1)) | _open(after, np.roll(kept, -1))
    sides = [
        Side(pieces[k][0], pieces[k][1], bool(open_ends[k]))
        for k in np.flatnonzero(kept)
    ]
    return sides, float(length[~kept].sum())


def _open(turn: FloatArray, neighbour_kept: BoolArray) -> BoolArray:
    """Where a side runs on: straight ahead, or into a curve that is not measured."""
    return np.asarray((turn < _CROSSING_RAD) | ((turn < _SMOOTH_RAD) & ~neighbour_kept))


def _turns(ends: FloatArray, *, closed: bool) -> FloatArray:
    """Angle (k,) between each piece and the one before it; pi at a loose end."""
    along = ends[:, 1] - ends[:, 0]
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    cosine = np.einsum("ij,ij->i", along, np.roll(along, 1, axis=0))
    turn = np.arccos(np.clip(cosine, -1, 1))
    if not closed:
        turn[0] = np.pi
    return np.asarray(turn)


def _lengths_px(
    start_camera: FloatArray, end_camera: FloatArray, plane: ImagePlane
) -> FloatArray:
    step = plane.project(end_camera) - plane.project(start_camera)
    return np.asarray(np.linalg.norm(step, axis=1))


def even_pieces(
    edge: ExpectedEdge,
    away_px: float,
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
) -> list[tuple[float, float]]:
    """Shares of an edge with one and the same background, the longest first.

    Where the background of a contour changes its step does too, even in sign. Pieces
    that are too short are left out, but never the longest.
    """
    share = np.linspace(0, 1, _PLACES)
    places = edge.start_px + share[:, None] * (edge.end_px - edge.start_px)
    normals = np.broadcast_to(edge.normal, places.shape)
    sides = both_sides(places, normals, away_px, scene, part_from_camera, plane)
    change = _changes(sides.before) | _changes(sides.behind)
    # Near a corner another face shows beside it; that is no change of background.
    margin = min(2 * away_px / max(edge.length_px, 1e-9), 0.25)
    middle = (share[1:] + share[:-1]) / 2
    cuts = share[:-1][change & (middle > margin) & (middle < 1 - margin)]
    step = share[1]
    starts = np.concatenate([[0.0], cuts + step])
    ends = np.concatenate([cuts, [1.0]])
    order = np.argsort(starts - ends)
    pieces = [(float(starts[k]), float(ends[k])) for k in order]
    long = [p for p in pieces if (p[1] - p[0]) * edge.length_px >= _SHORTEST_PIECE_PX]
    return long or pieces[:1]


def _changes(side: LitPlaces) -> BoolArray:
    """Where (n - 1,) the next place shows something else than this one."""
    places = np.arange(len(side.solid))
    return other_face(side.at(places[:-1]), side.at(places[1:]))


def _crowded(
    edge: ExpectedEdge,
    away_px: float,
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
) -> bool:
    """Another line runs close beside most of it."""
    places = np.linspace(edge.start_px, edge.end_px, _PLACES)[1:-1]
    normals = np.broadcast_to(edge.normal, places.shape)
    reach = _THINNEST_PX, away_px, away_px + WIDER_PX
    close = crowded(places, normals, reach, scene, part_from_camera, plane)
    return bool(close.mean() > CROWDED)


def measured_pieces(
    edge: ExpectedEdge,
    away_px: float,
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
) -> list[ExpectedEdge]:
    """The longest piece with one background, then the others for their place."""
    out = []
    found = even_pieces(edge, away_px, scene, part_from_camera, plane)
    for number, (low, high) in enumerate(found):
        piece = cropped(edge, low, high, plane)
        if piece is not edge:
            name = edge.name if number == 0 else f"{edge.name}, piece {number + 1}"
            piece = replace(
                piece,
                name=name,
                whole=edge if number == 0 else None,
                open_ends=edge.open_ends or number > 0,
            )
        close = _crowded(piece, away_px, scene, part_from_camera, plane)
        out.append(replace(piece, crowded=close))
    return out
