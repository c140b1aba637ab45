"""Predicted contrast: what the light model says on both sides of a line."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.predict_lines import hit_depth

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import BoolArray, FloatArray, IntArray, Pose
    from mvp.imaging.light import Float32Array, Illumination
    from mvp.imaging.measure_plane import ImagePlane
    from mvp.imaging.render_scene import RenderScene


_SAME_FACE = np.cos(np.deg2rad(20.0))
_SAME_DEPTH = 0.1
# How far a face must reach beside a line to have a level of its own.
WIDER_PX = 2.5


@dataclass(frozen=True, eq=False)
class LitPlaces:
    """What lies at n places of a picture.

    Attributes:
        solid: (n,) something is hit.
        points, normals: (n, 3) of what is hit, camera frame; 0 elsewhere.
        albedo: (n,) diffuse reflectance.
    """

    solid: BoolArray
    points: FloatArray
    normals: FloatArray
    albedo: Float32Array

    def at(self, places: IntArray) -> LitPlaces:
        """Some of the places."""
        return LitPlaces(
            self.solid[places],
            self.points[places],
            self.normals[places],
            self.albedo[places],
        )

    def greys(self, light: Illumination, turns_rad: FloatArray) -> FloatArray:
        """Greys (R, n) when the camera, and its light, is turned about its axis.

        Args:
            light: fixed to the camera.
            turns_rad: (R,) from the camera's x towards its y.
        """
        turns = np.asarray(turns_rad, np.float64)
        out = np.full((len(turns), len(self.solid)), light.background)
        points = _turned(self.points[self.solid], turns)
        normals = _turned(self.normals[self.solid], turns)
        lit = light.radiance(
            points.reshape(-1, 3).T.astype(np.float32),
            normals.reshape(-1, 3).T.astype(np.float32),
            np.tile(self.albedo[self.solid], len(turns)),
        )
        out[:, self.solid] = lit.reshape(len(turns), -1)
        return out


def _turned(vectors: FloatArray, turns_rad: FloatArray) -> FloatArray:
    """Vectors (n, 3) in the frames (R) of a camera turned about its own axis."""
    c, s = np.cos(turns_rad)[:, None], np.sin(turns_rad)[:, None]
    x, y, z = (column[None] for column in vectors.T)
    return np.stack([c * x + s * y, c * y - s * x, z + 0 * c], axis=-1)


def lit_places(
    places_px: FloatArray,
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
) -> LitPlaces:
    """What lies at ideal pixels (n, 2)."""
    directions = np.ones((len(places_px), 3))
    directions[:, :2] = places_px * (plane.px_mm / plane.f_cal_mm)
    depth, found = hit_depth(directions, scene, part_from_camera)
    solid = np.isfinite(depth)
    points = directions * np.where(solid, depth, 0.0)[:, None]
    normals = scene.planes(part_from_camera).normals[found].astype(np.float64)
    return LitPlaces(solid, points, normals, scene.albedo[found])


@dataclass(frozen=True, eq=False)
class BothSides:
    """What lies on either side of n places along lines of a picture."""

    before: LitPlaces
    behind: LitPlaces

    def steps(self, light: Illumination, turns_rad: FloatArray) -> FloatArray:
        """Step over the brighter grey, (R, n), for a camera turned about its axis."""
        a, b = (p.greys(light, turns_rad) for p in (self.before, self.behind))
        return np.asarray((b - a) / np.maximum(np.maximum(a, b), 1e-6))

    def contrast(self, light: Illumination, turns_rad: FloatArray) -> FloatArray:
        """|step| over the brighter grey, (R, n)."""
        return np.abs(self.steps(light, turns_rad))


def both_sides(
    places_px: FloatArray,
    normals_px: FloatArray,
    away_px: FloatArray | float,
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
) -> BothSides:
    """Look ``away_px`` to either side of places (n, 2) along normals (n, 2)."""
    step = np.reshape(away_px, (-1, 1)) * normals_px
    return BothSides(
        lit_places(places_px - step, scene, part_from_camera, plane),
        lit_places(places_px + step, scene, part_from_camera, plane),
    )


def other_face(a: LitPlaces, b: LitPlaces) -> BoolArray:
    """Where (n,) two sets of places show clearly different faces, whatever the light."""
    turned = np.einsum("ij,ij->i", a.normals, b.normals) < _SAME_FACE
    depth = a.points[:, 2], b.points[:, 2]
    apart = np.abs(depth[1] - depth[0]) > _SAME_DEPTH * np.maximum(*depth)
    return np.asarray((a.solid != b.solid) | (a.solid & b.solid & (turned | apart)))


def crowded(
    places_px: FloatArray,
    normals_px: FloatArray,
    away_px: Sequence[float],
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
) -> BoolArray:
    """Where (n,) a face beside a line is only a sliver, with another line behind it.

    ``away_px``: distances, the nearest first, that should show one face on each side.
    """
    sides = [
        both_sides(places_px, normals_px, t, scene, part_from_camera, plane)
        for t in away_px
    ]
    changes = [
        other_face(near.before, wide.before) | other_face(near.behind, wide.behind)
        for near, wide in pairwise(sides)
    ]
    return np.asarray(np.any(changes, axis=0))


def contrast_at(
    places_px: FloatArray,
    normals_px: FloatArray,
    away_px: float,
    light: Illumination,
    scene: RenderScene,
    part_from_camera: Pose,
    plane: ImagePlane,
) -> FloatArray:
    """|step| over the brighter grey (n,), between both sides of places (n, 2)."""
    sides = both_sides(places_px, normals_px, away_px, scene, part_from_camera, plane)
    return np.asarray(sides.contrast(light, np.zeros(1))[0])
