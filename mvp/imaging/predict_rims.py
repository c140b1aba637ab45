"""The near rim of a hole as a view must show it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.expectation import ExpectedRim, Requirement
from mvp.imaging.predict_contrast import WIDER_PX, both_sides, crowded
from mvp.imaging.predict_lines import Lines, hidden

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray, Pose
    from mvp.imaging.light import Illumination
    from mvp.imaging.measure_plane import ImagePlane
    from mvp.imaging.render_scene import RenderScene

RIM_POINTS = 96
_LIFT_MM = 0.02
_ON_RIM_MM = 0.05
_SAME_STEP = 0.5
# Share of a line beside which another one runs that makes it unmeasurable.
CROWDED = 0.5
# A second rim seen through a hole misleads the search for the first one.
_CROWDED_RIM = 0.25


def expected_rim(
    feature: str,
    outline_mm: FloatArray,
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
    light: Illumination | None,
    requirement: Requirement | None,
    lines: Lines,
) -> ExpectedRim:
    """Predict the ellipse of a circle (n, 3) on the part that a feature asks for."""
    centre, axis, radius = fitted_circle(part_from_camera.inverse().apply(outline_mm))
    points = circle_points(centre, axis, radius)
    places = plane.project(points)
    lifted = points + _LIFT_MM * axis
    visible = ~hidden(lifted, scene, part_from_camera) & plane.inside(places)
    blur = float(np.sqrt(np.mean(plane.blur_px(points[:, 2]) ** 2)))
    away = 1.5 + blur / 2
    beside = _beside(places, away, light, scene, part_from_camera, plane)
    detail = float("nan")
    if requirement is not None:
        detail = _detail_px(centre, axis, radius, requirement, plane)
    return ExpectedRim(
        feature,
        places,
        centre,
        axis,
        radius,
        ellipse_axes(places),
        blur,
        visible,
        np.abs(beside.steps),
        _own_lines(lines, part_from_camera.inverse(), centre, axis, radius),
        requirement,
        detail,
        beside.even,
        bool(visible.any() and beside.close[visible].mean() > _CROWDED_RIM),
    )


@dataclass(frozen=True, eq=False)
class _Beside:
    """What a rim shows at its places (n,): signed steps, where even, where crowded."""

    steps: FloatArray
    even: BoolArray
    close: BoolArray


def _beside(
    places: FloatArray,
    away_px: float,
    light: Illumination | None,
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
) -> _Beside:
    normals = outward_normals(places)
    reach = away_px, away_px + WIDER_PX, away_px + 2 * WIDER_PX
    sliver, close = (
        crowded(places, normals, reach[:count], scene, part_from_camera, plane)
        for count in (2, 3)
    )
    if light is None:
        return _Beside(np.full(len(places), np.nan), ~sliver, close)
    steps, wider = (
        both_sides(places, normals, t, scene, part_from_camera, plane).steps(
            light, np.zeros(1)
        )[0]
        for t in reach[:2]
    )
    same = np.abs(wider - steps) < _SAME_STEP * np.abs(steps)
    return _Beside(steps, np.asarray(~sliver & ~_jumps(steps) & same), close)


def _jumps(steps: FloatArray) -> BoolArray:
    """Where (n,) the step changes sign or doubles: another edge runs in, or a wall turns."""
    around = np.stack([np.roll(steps, k) for k in (-2, -1, 0, 1, 2)])
    size = np.abs(around)
    sign = (around.min(axis=0) < 0) & (around.max(axis=0) > 0)
    return np.asarray(sign | (size.max(axis=0) > 2 * size.min(axis=0)))


def _own_lines(
    lines: Lines,
    camera_from_part: Pose,
    centre: FloatArray,
    axis: FloatArray,
    radius: float,
) -> IntArray:
    """CAD edges both ends of which lie on the circle."""
    on = np.ones(len(lines.start_mm), dtype=np.bool_)
    for ends in (lines.start_mm, lines.end_mm):
        relative = camera_from_part.apply(ends) - centre
        height = relative @ axis
        reach = np.linalg.norm(relative - height[:, None] * axis, axis=1)
        on &= (np.abs(height) < _ON_RIM_MM) & (np.abs(reach - radius) < _ON_RIM_MM)
    return np.flatnonzero(on).astype(np.int64)


def fitted_circle(points: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Centre, axis towards the camera and radius of points (n, 3) on a circle."""
    middle = points.mean(axis=0)
    _, _, rows = np.linalg.svd(points - middle)
    flat = (points - middle) @ rows[:2].T
    system = np.column_stack([2 * flat, np.ones(len(flat))])
    u, v, w = np.linalg.lstsq(system, (flat**2).sum(axis=1), rcond=None)[0]
    centre = middle + u * rows[0] + v * rows[1]
    axis = rows[2] if rows[2] @ centre < 0 else -rows[2]
    return centre, axis, float(np.sqrt(w + u * u + v * v))


def circle_points(
    centre: FloatArray, axis: FloatArray, radius: float, count: int = RIM_POINTS
) -> FloatArray:
    """Even points (count, 3) on a circle."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first = first / np.linalg.norm(first)
    second = np.cross(axis, first)
    turn = np.arange(count) / count * 2 * np.pi
    return np.asarray(
        centre
        + radius * (np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second)
    )


def outward_normals(places_px: FloatArray) -> FloatArray:
    """Unit normals (n, 2) of a closed convex polyline, away from its middle."""
    tangent = np.roll(places_px, -1, axis=0) - np.roll(places_px, 1, axis=0)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    outward = ((places_px - places_px.mean(axis=0)) * normal).sum(axis=1)
    return np.asarray(normal * np.sign(np.median(outward)))


def ellipse_axes(places_px: FloatArray) -> tuple[float, float]:
    """Full (major, minor) axes of an ellipse given by points that are on it (n, 2)."""
    centred = places_px - places_px.mean(axis=0)
    scale = float(np.abs(centred).max())
    x, y = (centred / scale).T
    system = np.column_stack([x * x, x * y, y * y, x, y])
    a, b, c, d, e = np.linalg.lstsq(system, np.ones(len(x)), rcond=None)[0]
    quadric = np.array([[a, b / 2], [b / 2, c]])
    middle = np.linalg.solve(-2 * quadric, np.array([d, e]))
    level = 1 + middle @ quadric @ middle
    values = np.linalg.eigvalsh(quadric)
    full = 2 * scale * np.sqrt(level / values)
    return float(full.max()), float(full.min())


def _detail_px(
    centre: FloatArray,
    axis: FloatArray,
    radius: float,
    requirement: Requirement,
    plane: ImagePlane,
) -> float:
    """Smallest image of the required detail along the rim, raw pixels."""
    share = requirement.detail_mm / radius
    count = max(int(np.ceil(2 * np.pi / share)), 8)
    raw = plane.raw(plane.project(circle_points(centre, axis, radius, count)))
    step = np.linalg.norm(raw - np.roll(raw, 1, axis=0), axis=1)
    chord = 2 * radius * np.sin(np.pi / count)
    return float(step.min() * requirement.detail_mm / chord)
