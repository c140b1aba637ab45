"""Predicted contrast: what the light model says on both sides of a line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from mvp.imaging.predict_lines import hit_depth

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray, Pose
    from mvp.imaging.light import Float32Array
    from mvp.imaging.measure_plane import ImagePlane
    from mvp.imaging.render_scene import RenderScene


class LightModel(Protocol):
    """Grey of lit points; ``background`` where nothing is hit."""

    @property
    def background(self) -> float:
        """Grey of empty space."""
        ...

    def radiance(
        self,
        points: Sequence[Float32Array],
        normals: Sequence[Float32Array],
        albedo: Float32Array,
    ) -> Float32Array:
        """Grey (n,) of points (x, y, z) with normals (x, y, z), camera frame."""
        ...


def greys(
    places_px: FloatArray,
    light: LightModel,
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
) -> FloatArray:
    """Predicted grey at ideal pixels (n, 2), without blur."""
    directions = np.ones((len(places_px), 3))
    directions[:, :2] = places_px * (plane.px_mm / plane.f_cal_mm)
    depth, found = hit_depth(directions, scene, part_from_camera)
    solid = np.isfinite(depth)
    points = directions[solid] * depth[solid, None]
    normals = scene.planes(part_from_camera).normals[found[solid]]
    out = np.full(len(places_px), light.background)
    out[solid] = light.radiance(
        list(points.T.astype(np.float32)),
        list(normals.T),
        scene.albedo[found[solid]],
    )
    return out


def contrast_at(
    places_px: FloatArray,
    normals_px: FloatArray,
    away_px: float,
    light: LightModel,
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
) -> FloatArray:
    """|step| over the brighter grey (n,), between both sides of places (n, 2)."""
    sides = [
        greys(
            places_px + sign * away_px * normals_px,
            light,
            scene,
            part_from_camera,
            plane,
        )
        for sign in (-1.0, 1.0)
    ]
    brighter = np.maximum(np.maximum(sides[0], sides[1]), 1e-6)
    return np.asarray(np.abs(sides[1] - sides[0]) / brighter)
