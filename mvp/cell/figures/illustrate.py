"""Technical illustrations: shaded solids with drawn edges and translucent regions.

An orthographic picture by ray casting, so that surfaces which pass through each other
are ordered correctly at every pixel. Points can be asked whether they are hidden, so
that labels and arrows on top of the picture tell the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh as EmbreeMesh

from mvp.geometry import Box, as_points, unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import BoolArray, FloatArray, TriangleMesh

Colour: TypeAlias = tuple[float, float, float]

_OVERSAMPLING = 2
_LAYERS = 2
_CREASE_COSINE = 0.985
_LIGHTS = ((0.45, 0.35, 0.85, 0.62), (-0.7, -0.2, 0.5, 0.22))
_AMBIENT = 0.30
_INK: Colour = (0.13, 0.15, 0.18)


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh with a colour; opacity below 1 lets what is behind shine through."""

    mesh: TriangleMesh
    colour: Colour
    opacity: float = 1.0
    edges: bool = True


@dataclass(frozen=True, eq=False)
class Eye:
    """An orthographic eye, mm.

    Attributes:
        target_mm: (3,) the point in the middle of the picture.
        forward: (3,) viewing direction.
        up: (3,) what points up in the picture (not parallel to ``forward``).
        width_mm: width of what is seen.
        size_px: (columns, rows).
    """

    target_mm: FloatArray
    forward: FloatArray
    up: FloatArray
    width_mm: float
    size_px: tuple[int, int]

    @property
    def axes(self) -> FloatArray:
        """Rows: right, down, forward; (3, 3)."""
        forward = unit(self.forward)
        right = unit(np.cross(forward, self.up))
        return np.stack([right, np.cross(forward, right), forward])

    @property
    def mm_per_px(self) -> float:
        """Size of a pixel in the scene, mm."""
        return self.width_mm / self.size_px[0]

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (..., 3) to pixels (..., 2) and depth (...) in mm."""
        local = (as_points(points) - self.target_mm) @ self.axes.T
        centre = (np.array(self.size_px) - 1) / 2
        return local[..., :2] / self.mm_per_px + centre, local[..., 2]


def eye_around(
    box: Box,
    *,
    forward: Sequence[float] = (-0.55, 0.75, -0.62),
    up: Sequence[float] = (0.0, 0.0, 1.0),
    size_px: tuple[int, int] = (960, 720),
    fill: float = 0.92,
) -> Eye:
    """An eye that sees the whole box."""
    probe = Eye(
        box.centre_mm, np.array(forward), np.array(up), float(size_px[0]), size_px
    )
    pixels, _ = probe.project(box.corners())
    span = pixels.max(axis=0) - pixels.min(axis=0)
    width = max(span[0], span[1] * size_px[0] / size_px[1]) / fill
    return Eye(box.centre_mm, probe.forward, probe.up, float(width), size_px)


@dataclass(frozen=True, eq=False)
class Drawing:
    """A finished picture.

    Attributes:
        rgb: (rows, columns, 3) in 0..1.
        depth_mm: (rows, columns) of the nearest opaque surface; inf where there is none.
        eye: what it was seen with.
    """

    rgb: FloatArray
    depth_mm: FloatArray
    eye: Eye

    def hidden(self, points: FloatArray, *, slack_mm: float = 1.0) -> BoolArray:
        """Which points (n, 3) lie behind an opaque surface."""
        pixels, depth = self.eye.project(points)
        columns, rows = self.eye.size_px
        x = np.clip(np.rint(pixels[..., 0]).astype(int), 0, columns - 1)
        y = np.clip(np.rint(pixels[..., 1]).astype(int), 0, rows - 1)
        return np.asarray(depth > self.depth_mm[y, x] + slack_mm)


@dataclass(frozen=True, eq=False)
class _Hits:
    depth: FloatArray
    normal: FloatArray
    face_id: FloatArray

    @property
    def hit(self) -> BoolArray:
        return np.isfinite(self.depth)


def draw(surfaces: Sequence[Surface], eye: Eye) -> Drawing:
    """Draw opaque surfaces first, then translucent ones from back to front."""
    columns, rows = eye.size_px
    fine = Eye(
        eye.target_mm,
        eye.forward,
        eye.up,
        eye.width_mm,
        (columns * _OVERSAMPLING, rows * _OVERSAMPLING),
    )
    origins, start = _pixel_rays(fine, surfaces)
    shape = (rows * _OVERSAMPLING, columns * _OVERSAMPLING)
    rgb = np.ones((*shape, 3))
    depth = np.full(shape, np.inf)
    for surface in (s for s in surfaces if s.opacity >= 1):
        hits = _cast(surface.mesh, origins, fine, shape, 1)[0]
        nearer = hits.depth < depth
        colour = _ink_edges(_shade(hits, surface.colour, fine), hits, surface, fine)
        rgb[nearer] = colour[nearer]
        depth = np.where(nearer, hits.depth, depth)
    layers: list[tuple[_Hits, Surface]] = []
    for surface in (s for s in surfaces if s.opacity < 1):
        cast = _cast(surface.mesh, origins, fine, shape, _LAYERS)
        layers += [(hits, surface) for hits in cast]
    _blend(rgb, depth, layers, fine)
    return Drawing(_shrink(rgb), _shrink_nearest(depth) + start, eye)


def _pixel_rays(eye: Eye, surfaces: Sequence[Surface]) -> tuple[FloatArray, float]:
    """Ray origins (n, 3) on a plane in front of everything, and that plane's depth."""
    right, down, forward = eye.axes
    columns, rows = eye.size_px
    nearest = min(
        (float(eye.project(s.mesh.vertices_mm)[1].min()) for s in surfaces), default=0.0
    )
    start = nearest - 1.0
    x = (np.arange(columns) - (columns - 1) / 2) * eye.mm_per_px
    y = (np.arange(rows) - (rows - 1) / 2) * eye.mm_per_px
    grid_x, grid_y = np.meshgrid(x, y)
    origins = (
        eye.target_mm
        + start * forward
        + grid_x.reshape(-1, 1) * right
        + grid_y.reshape(-1, 1) * down
    )
    return origins, start


def _cast(
    mesh: TriangleMesh,
    origins: FloatArray,
    eye: Eye,
    shape: tuple[int, int],
    layers: int,
) -> list[_Hits]:
    scene = rtcore_scene.EmbreeScene()
    EmbreeMesh(scene, mesh.vertices_mm.astype(np.float32), mesh.faces.astype(np.int32))
    forward = eye.axes[2]
    directions = np.broadcast_to(forward, origins.shape).astype(np.float32)
    travelled = np.zeros(len(origins))
    step = 1e-4 * max(1.0, mesh.extent_mm)
    result = []
    for _ in range(layers):
        from_here = (origins + travelled[:, None] * forward).astype(np.float32)
        found = scene.run(from_here, directions, output=True)
        face = found["primID"]
        hit = face >= 0
        depth = np.where(hit, travelled + found["tfar"], np.inf)
        normal = np.where(hit[:, None], mesh.normals[face], 0.0)
        ids = np.where(hit, mesh.face_ids[face], -1)
        result.append(
            _Hits(depth.reshape(shape), normal.reshape(*shape, 3), ids.reshape(shape))
        )
        travelled = np.where(hit, depth + step, travelled)
    return result


def _shade(hits: _Hits, colour: Colour, eye: Eye) -> FloatArray:
    """Two-sided Lambert with a key and a fill light fixed to the eye, (h, w, 3)."""
    right, down, forward = eye.axes
    towards = np.where(
        (hits.normal @ forward)[..., None] > 0, -hits.normal, hits.normal
    )
    light = np.full(hits.depth.shape, _AMBIENT)
    for x, y, z, strength in _LIGHTS:
        direction = unit(x * right - y * down - z * forward)
        light = light + strength * np.clip(towards @ direction, 0, 1)
    return np.asarray(np.clip(light, 0, 1.15)[..., None] * np.array(colour)).clip(0, 1)


def _crease(hits: _Hits, eye: Eye) -> BoolArray:
    """Pixels next to a fold, a silhouette or another CAD face."""
    jump = 6 * eye.mm_per_px
    mask = np.zeros(hits.depth.shape, dtype=bool)
    for axis in (0, 1):
        near = np.swapaxes(mask, 0, axis)
        depth = np.swapaxes(np.where(hits.hit, hits.depth, 1e9), 0, axis)
        normal = np.swapaxes(hits.normal, 0, axis)
        folded = (normal[1:] * normal[:-1]).sum(axis=-1) < _CREASE_COSINE
        folded &= (depth[1:] < 1e9) | (depth[:-1] < 1e9)
        near[1:] |= folded | (np.abs(np.diff(depth, axis=0)) > jump)
    return mask


def _ink_edges(rgb: FloatArray, hits: _Hits, surface: Surface, eye: Eye) -> FloatArray:
    if not surface.edges:
        return rgb
    return np.where(_crease(hits, eye)[..., None], np.array(_INK), rgb)


def _blend(
    rgb: FloatArray,
    opaque_depth: FloatArray,
    layers: list[tuple[_Hits, Surface]],
    eye: Eye,
) -> None:
    """Mix translucent layers into ``rgb`` in place, farthest first at every pixel."""
    if not layers:
        return
    depths = np.stack([hits.depth for hits, _ in layers])
    order = np.argsort(-np.where(np.isfinite(depths), depths, np.inf), axis=0)
    colours = np.stack([_shade(hits, s.colour, eye) for hits, s in layers])
    opacity = np.stack([_opacity(hits, s, eye) for hits, s in layers])
    opacity = np.where(depths < opaque_depth, opacity, 0.0)
    for rank in range(len(layers)):
        pick = order[rank][None]
        alpha = np.take_along_axis(opacity, pick, 0)[0][..., None]
        colour = np.take_along_axis(colours, pick[..., None], 0)[0]
        rgb *= 1 - alpha
        rgb += alpha * colour


def _opacity(hits: _Hits, surface: Surface, eye: Eye) -> FloatArray:
    opacity = np.where(hits.hit, surface.opacity, 0.0)
    if surface.edges:
        edge = _crease(hits, eye) & hits.hit
        opacity = np.where(edge, min(1.0, surface.opacity + 0.35), opacity)
    return np.asarray(opacity)


def _shrink(rgb: FloatArray) -> FloatArray:
    rows, columns = rgb.shape[0] // _OVERSAMPLING, rgb.shape[1] // _OVERSAMPLING
    blocks = rgb.reshape(rows, _OVERSAMPLING, columns, _OVERSAMPLING, 3)
    return np.asarray(blocks.mean(axis=(1, 3)))


def _shrink_nearest(depth: FloatArray) -> FloatArray:
    rows, columns = depth.shape[0] // _OVERSAMPLING, depth.shape[1] // _OVERSAMPLING
    blocks = depth.reshape(rows, _OVERSAMPLING, columns, _OVERSAMPLING)
    return np.asarray(blocks.max(axis=(1, 3)))
