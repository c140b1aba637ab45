"""Single-precision ray casting on Embree, recentred to keep its precision."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mvp.geometry import BoolArray, FloatArray, IntArray, as_points

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from mvp.visibility.occluders import Occluders

Float32Array: TypeAlias = NDArray[np.float32]
_CHUNK = 1 << 15
_TINY = np.float32(1e-30)


class RayScene:
    """Triangles (m, 3, 3), mm, in an Embree scene.

    Embree works in float32: positions are good to about 1e-7 of the scene's extent,
    so answers close to an edge are a check and never a proof.
    """

    def __init__(self, triangles_mm: FloatArray) -> None:
        from embreex.mesh_construction import TriangleMesh as EmbreeMesh
        from embreex.rtcore_scene import EmbreeScene

        corners = triangles_mm.reshape(-1, 3)
        empty = len(corners) == 0
        self._centre = np.zeros(3) if empty else (corners.min(0) + corners.max(0)) / 2
        self._empty = empty
        self._scene = EmbreeScene(robust=True)
        if not empty:
            EmbreeMesh(self._scene, (triangles_mm - self._centre).astype(np.float32))

    def blocked(self, starts_mm: FloatArray, ends_mm: FloatArray) -> BoolArray:
        """Which of the segments (n, 3) to (n, 3) meet a triangle."""
        return self._hits(starts_mm, ends_mm, "OCCLUDED") >= 0

    def first_hit(self, starts_mm: FloatArray, ends_mm: FloatArray) -> IntArray:
        """Index (n,) of the first triangle on each segment, -1 for none."""
        return self._hits(starts_mm, ends_mm, "INTERSECT")

    def recentred(self, points_mm: FloatArray) -> Float32Array:
        """Points (..., 3) in the scene's own coordinates and precision."""
        return (points_mm - self._centre).astype(np.float32)

    def blocked_rays(self, origins: Float32Array, along: Float32Array) -> BoolArray:
        """Which segments, recentred origin (n, 3) plus along (n, 3), are blocked."""
        return self._run(origins, along, "OCCLUDED") >= 0

    def _hits(self, starts_mm: FloatArray, ends_mm: FloatArray, query: str) -> IntArray:
        along = (ends_mm - starts_mm).astype(np.float32)
        return self._run(self.recentred(starts_mm), along, query)

    def _run(self, origins: Float32Array, along: Float32Array, query: str) -> IntArray:
        if self._empty or not len(origins):
            return np.full(len(origins), -1, dtype=np.int64)
        lengths = np.ones(len(origins), dtype=np.float32)
        hits = self._scene.run(origins, along, dists=lengths, query=query)
        return np.asarray(hits, dtype=np.int64)


def line_of_sight(
    occluders: Occluders,
    viewpoints_mm: ArrayLike,
    targets_mm: ArrayLike,
    *,
    gap_mm: float | None = None,
) -> BoolArray:
    """Which targets are seen from which view points, by float32 rays.

    Args:
        occluders: what can hide a target.
        viewpoints_mm: (N, 3).
        targets_mm: (M, 3) points on or outside the surfaces.
        gap_mm: how far before the target a ray ends, mm, so that the surface which
            the target lies on does not hide it; 2e-5 of the extent by default.

    Returns:
        (N, M) bool.
    """
    views = as_points(viewpoints_mm, name="viewpoints_mm").reshape(-1, 3)
    targets = as_points(targets_mm, name="targets_mm").reshape(-1, 3)
    gap = 2e-5 * occluders.extent_mm if gap_mm is None else gap_mm
    clear = np.empty((len(views), len(targets)), dtype=np.bool_)
    views32 = occluders.rays.recentred(views)
    targets32 = occluders.rays.recentred(targets)
    step = max(1, _CHUNK // max(1, len(targets)))
    for start in range(0, len(views), step):
        some = views32[start : start + step]
        clear[start : start + step] = _clear(occluders.rays, some, targets32, gap)
    return clear


def _clear(
    rays: RayScene, views: Float32Array, targets: Float32Array, gap_mm: float
) -> BoolArray:
    """The block of :func:`line_of_sight` for a few view points."""
    shape = (len(views), len(targets), 3)
    along = (views[:, None] - targets[None]).reshape(-1, 3)
    length = np.sqrt(np.einsum("nk,nk->n", along, along))
    share = np.minimum(np.float32(gap_mm) / np.maximum(length, _TINY), 1)[:, None]
    origins = share * along
    along -= origins
    origins += np.broadcast_to(targets, shape).reshape(-1, 3)
    return ~rays.blocked_rays(origins, along).reshape(shape[:2])
