"""Technical illustrations: shaded solids with drawn edges and translucent regions.

An orthographic picture by ray casting, so that surfaces which pass through each other
are ordered correctly at every pixel. Points can be asked whether they are hidden, so
that labels and arrows on top of the picture tell the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mvp.cell.figures.ray_layers import Raster, TriangleArray, cast_layers
from mvp.geometry import Box, as_points, unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import BoolArray, FloatArray, TriangleMesh

Float32Array: TypeAlias = NDArray[np.float32]
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
    """One layer of a surface: depth (h, w) in mm, inf for none, and triangle (h, w)."""

    surface: Surface
    depth: Float32Array
    triangle: TriangleArray

    @property
    def hit(self) -> BoolArray:
        return np.asarray(self.triangle >= 0)


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
    start = _start(fine, surfaces)
    shape = (rows * _OVERSAMPLING, columns * _OVERSAMPLING)
    rgb = np.ones((*shape, 3), np.float32)
    depth = np.full(shape, np.inf, np.float32)
    for surface in (s for s in surfaces if s.opacity >= 1):
        hits = _cast(surface, fine, start, 1)[0]
        nearer = hits.depth < depth
        rgb[nearer] = _colours(hits, fine, nearer)
        depth = np.minimum(depth, hits.depth)
    layers: list[_Hits] = []
    for surface in (s for s in surfaces if s.opacity < 1):
        layers += _cast(surface, fine, start, _LAYERS)
    _blend(rgb, depth, layers, fine)
    return Drawing(_shrink(rgb), _shrink_nearest(depth) + start, eye)


def _start(eye: Eye, surfaces: Sequence[Surface]) -> float:
    """Depth of a plane in front of everything, where rays begin."""
    nearest = min(
        (float(eye.project(s.mesh.vertices_mm)[1].min()) for s in surfaces), default=0.0
    )
    return nearest - 1.0


def _cast(surface: Surface, eye: Eye, start_mm: float, layers: int) -> list[_Hits]:
    """The first layers of a surface; rays only where it can be hit at all."""
    mesh, (columns, rows) = surface.mesh, eye.size_px
    depths = np.full((layers, rows, columns), np.inf, np.float32)
    triangles = np.full((layers, rows, columns), -1, np.int32)
    across, down = _window(mesh, eye)
    size = (down.stop - down.start, across.stop - across.start)
    if min(size) > 0:
        raster = _raster(eye, start_mm, (across.start, down.start), size)
        depth, triangle = cast_layers(mesh, raster, layers)
        depths[:, down, across] = depth.reshape(layers, *size)
        triangles[:, down, across] = triangle.reshape(layers, *size)
    return [_Hits(surface, depths[k], triangles[k]) for k in range(layers)]


def _window(mesh: TriangleMesh, eye: Eye) -> tuple[slice, slice]:
    """Columns and rows that the mesh can fall on."""
    pixels, _ = eye.project(mesh.vertices_mm)
    low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - 1, 0, eye.size_px)
    high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + 2, 0, eye.size_px)
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))


def _raster(
    eye: Eye, start_mm: float, first: tuple[int, int], size: tuple[int, int]
) -> Raster:
    """The rays of some columns and rows, from the first ones on."""
    right, down, forward = eye.axes
    x, y = (np.array(first) - (np.array(eye.size_px) - 1) / 2) * eye.mm_per_px
    plane = eye.target_mm + start_mm * forward
    across_mm, down_mm = right * eye.mm_per_px, down * eye.mm_per_px
    return Raster(plane + x * right + y * down, across_mm, down_mm, forward, size)


def _colours(hits: _Hits, eye: Eye, where: BoolArray) -> Float32Array:
    """Two-sided Lambert with a key and a fill light fixed to the eye, (n, 3)."""
    right, down, forward = eye.axes
    normals = hits.surface.mesh.normals
    towards = np.where((normals @ forward)[:, None] > 0, -normals, normals)
    light = np.full(len(normals), _AMBIENT)
    for x, y, z, strength in _LIGHTS:
        direction = unit(x * right - y * down - z * forward)
        light = light + strength * np.clip(towards @ direction, 0, 1)
    table = np.clip(light, 0, 1.15)[:, None] * np.array(hits.surface.colour)
    rgb = np.clip(table, 0, 1).astype(np.float32)[hits.triangle[where]]
    if hits.surface.edges and hits.surface.opacity >= 1:
        rgb[_crease(hits, eye)[where]] = _INK
    return np.asarray(rgb)


def _crease(hits: _Hits, eye: Eye) -> BoolArray:
    """Pixels next to a fold, a silhouette or a step in depth."""
    jump = 6 * eye.mm_per_px
    normals = hits.surface.mesh.normals
    mask = np.zeros(hits.depth.shape, dtype=bool)
    for axis in (0, 1):
        near = np.swapaxes(mask, 0, axis)
        triangle = np.swapaxes(hits.triangle, 0, axis)
        depth = np.swapaxes(hits.depth, 0, axis)
        rows, columns = np.nonzero(triangle[1:] != triangle[:-1])
        one, other = triangle[rows, columns], triangle[rows + 1, columns]
        silhouette = (one < 0) | (other < 0)
        folded = (normals[one] * normals[other]).sum(axis=-1) < _CREASE_COSINE
        with np.errstate(invalid="ignore"):
            step = np.abs(depth[rows + 1, columns] - depth[rows, columns]) > jump
        edge = silhouette | folded | step
        near[rows[edge] + 1, columns[edge]] = True
    return mask


def _blend(
    rgb: Float32Array, opaque_depth: Float32Array, layers: list[_Hits], eye: Eye
) -> None:
    """Mix translucent layers into ``rgb`` in place, farthest first at every pixel."""
    if not layers:
        return
    opacity = [
        np.where(hits.depth < opaque_depth, _opacity(hits, eye), np.float32(0))
        for hits in layers
    ]
    touched = np.logical_or.reduce([values > 0 for values in opacity])
    mixed = rgb[touched]
    order = np.argsort([-hits.depth[touched] for hits in layers], axis=0)
    colours = [_colours(hits, eye, touched) for hits in layers]
    strength = [values[touched] for values in opacity]
    for rank in range(len(layers)):
        for number, colour in enumerate(colours):
            mine = (order[rank] == number) & (strength[number] > 0)
            alpha = strength[number][mine][:, None]
            mixed[mine] = (1 - alpha) * mixed[mine] + alpha * colour[mine]
    rgb[touched] = mixed


def _opacity(hits: _Hits, eye: Eye) -> Float32Array:
    stated = hits.surface.opacity
    opacity = np.where(hits.hit, np.float32(stated), np.float32(0))
    if hits.surface.edges:
        opacity[_crease(hits, eye) & hits.hit] = min(1.0, stated + 0.35)
    return np.asarray(opacity)


def _shrink(rgb: Float32Array) -> FloatArray:
    """The mean of every block of fine pixels."""
    total = _parts(rgb)[0].astype(np.float64)
    for part in _parts(rgb)[1:]:
        total += part
    return np.asarray(total / _OVERSAMPLING**2)


def _shrink_nearest(depth: Float32Array) -> FloatArray:
    """The farthest depth of every block."""
    return np.asarray(np.maximum.reduce(_parts(depth)), dtype=np.float64)


def _parts(fine: Float32Array) -> list[Float32Array]:
    """One picture for each place within a block."""
    step = _OVERSAMPLING
    return [fine[y::step, x::step] for y in range(step) for x in range(step)]
