"""First and further hits of parallel rays through every pixel of a raster.

Between the projected edges of a mesh all rays meet the same triangles: one ray tells for
a whole patch of pixels, and its neighbours' depths follow from the triangle's plane. A
ray every few pixels shows where that does not hold, because the mesh passes through
itself; such patches are cast pixel by pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import cv2
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh as EmbreeMesh
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray, TriangleMesh

Float32Array: TypeAlias = NDArray[np.float32]
TriangleArray: TypeAlias = NDArray[np.int32]

_EDGE_PX = 3
_CHECKED_PX = 6
_RAYS_AT_ONCE = 200_000


@dataclass(frozen=True, eq=False)
class Raster:
    """Parallel rays, one through every pixel.

    Attributes:
        corner_mm: (3,) where the ray of the first pixel begins.
        across_mm: (3,) from one column to the next.
        down_mm: (3,) from one row to the next.
        forward: (3,) direction of all rays, a unit vector.
        shape: rows and columns.
    """

    corner_mm: FloatArray
    across_mm: FloatArray
    down_mm: FloatArray
    forward: FloatArray
    shape: tuple[int, int]

    def origins(self, pixels: IntArray) -> FloatArray:
        """Where the rays of pixels (n,), counted row by row, begin: (n, 3) mm."""
        row, column = np.divmod(pixels, self.shape[1])
        return np.asarray(
            self.corner_mm
            + column[:, None] * self.across_mm
            + row[:, None] * self.down_mm
        )

    def places(self, points: FloatArray) -> FloatArray:
        """Column and row (..., 2) on which points (..., 3) fall."""
        axes = np.stack([self.across_mm, self.down_mm])
        away = points - self.corner_mm
        return np.asarray(away @ (axes / (axes**2).sum(axis=1, keepdims=True)).T)


def cast_layers(
    mesh: TriangleMesh, raster: Raster, layers: int
) -> tuple[Float32Array, TriangleArray]:
    """Depth, mm, inf for none, and triangle, -1 for none, of each layer.

    Both are (layers, pixels). Only a hit has another layer behind it.
    """
    caster = _Caster(mesh, raster, layers)
    near = _near_edges(mesh, raster)
    patch = _patches(~near).reshape(-1)
    first = _first_of_each(patch)
    asked = near
    asked[::_CHECKED_PX, ::_CHECKED_PX] = True
    asked.reshape(-1)[first] = True
    pixels = np.flatnonzero(asked)
    found = caster.cast(pixels)
    alike = found[1][:, np.searchsorted(pixels, first)]
    own = patch[pixels]
    wrong = (own > 0) & (found[1] != alike[:, own]).any(axis=0)
    triangle = np.stack([layer[patch] for layer in alike])
    depth = _plane_depths(mesh, raster, alike, patch)
    depth[:, pixels], triangle[:, pixels] = found
    if wrong.any():
        doubtful = np.flatnonzero(np.isin(patch, own[wrong]))
        depth[:, doubtful], triangle[:, doubtful] = caster.cast(doubtful)
    return depth, triangle


class _Caster:
    """Casts the rays of some pixels into one mesh."""

    def __init__(self, mesh: TriangleMesh, raster: Raster, layers: int) -> None:
        self._scene = rtcore_scene.EmbreeScene()
        vertices, faces = mesh.vertices_mm, mesh.faces
        EmbreeMesh(self._scene, vertices.astype(np.float32), faces.astype(np.int32))
        self._raster = raster
        self._step = np.float32(1e-4 * max(1.0, mesh.extent_mm))
        self._layers = layers

    def cast(self, pixels: IntArray) -> tuple[Float32Array, TriangleArray]:
        """Depth and triangle (layers, n) of the rays of pixels (n,)."""
        parts = np.array_split(pixels, len(pixels) // _RAYS_AT_ONCE + 1)
        found = [self._cast(self._raster.origins(part)) for part in parts]
        depths, triangles = zip(*found, strict=True)
        return np.concatenate(depths, axis=1), np.concatenate(triangles, axis=1)

    def _cast(self, origins: FloatArray) -> tuple[Float32Array, TriangleArray]:
        count, alive = len(origins), np.arange(len(origins))
        begin, forward = origins.astype(np.float32), self._raster.forward
        travelled = np.zeros(count, np.float32)
        depth = np.full((self._layers, count), np.inf, np.float32)
        triangle = np.full((self._layers, count), -1, np.int32)
        for layer in range(self._layers):
            along = np.tile(forward.astype(np.float32), (len(alive), 1))
            starts = begin[alive] + travelled[alive, None] * along
            found = self._scene.run(starts, along, output=True)
            hit = found["primID"] >= 0
            alive = alive[hit]
            triangle[layer, alive] = found["primID"][hit]
            depth[layer, alive] = travelled[alive] + found["tfar"][hit]
            travelled[alive] = depth[layer, alive] + self._step
        return depth, triangle


def _near_edges(mesh: TriangleMesh, raster: Raster) -> BoolArray:
    """(rows, columns) pixels next to a projected edge of any triangle."""
    corners = raster.places(mesh.vertices_mm)
    mask = np.zeros(raster.shape, dtype=np.uint8)
    lines = np.rint(corners[mesh.faces]).astype(np.int32)
    cv2.polylines(mask, list(lines), isClosed=True, color=1, thickness=_EDGE_PX)
    return mask > 0


def _patches(free: BoolArray) -> TriangleArray:
    """(rows, columns) number of each patch of free pixels; 0 for all others."""
    _, patch = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    return np.asarray(patch, dtype=np.int32)


def _first_of_each(patch: TriangleArray) -> IntArray:
    """A pixel of every patch, by its number."""
    first = np.zeros(int(patch.max(initial=0)) + 1, dtype=np.int64)
    first[patch[::-1]] = np.arange(len(patch) - 1, -1, -1)
    return first


def _plane_depths(
    mesh: TriangleMesh, raster: Raster, alike: TriangleArray, patch: TriangleArray
) -> Float32Array:
    """Depths (layers, pixels) of the planes of each patch's triangles (layers, k)."""
    normals = np.vstack([mesh.normals, raster.forward])
    corner = np.vstack([mesh.triangles_mm[:, 0], raster.corner_mm])
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = 1.0 / (normals @ raster.forward)
        start = ((corner - raster.corner_mm) * normals).sum(axis=1) * slope
        steps = (normals @ np.stack([raster.across_mm, raster.down_mm], 1)) * slope[
            :, None
        ]
    start[-1], steps[-1] = np.inf, 0.0
    rows, columns = (np.arange(size, dtype=np.float32) for size in raster.shape)
    depth = np.empty((len(alike), *raster.shape), np.float32)
    where = patch.reshape(raster.shape)
    for layer, triangle in enumerate(alike):
        own = steps[triangle].astype(np.float32)
        depth[layer] = start[triangle].astype(np.float32)[where]
        depth[layer] -= own[:, 0][where] * columns
        depth[layer] -= own[:, 1][where] * rows[:, None]
    return depth.reshape(len(alike), -1)
