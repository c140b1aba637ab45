"""Solids in double precision: workspace, own faces, ordered unions, meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from manifold3d import Manifold, Mesh64

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import Box, FloatArray, IntArray
    from mvp.visibility.culling import OwnFaces


def box_solid(box: Box) -> Manifold:
    """The workspace as a solid."""
    return Manifold.cube(tuple(box.size_mm)).translate(tuple(box.low_mm))


def seen_side(solid: Manifold, own: OwnFaces) -> Manifold:
    """The part of a solid that faces enough of the own faces."""
    if not own.any_suffices:
        return _trimmed_by(solid, own.planes)
    hidden = _trimmed_by(solid, -own.planes)
    return solid - hidden if len(own.planes) else solid


def _trimmed_by(solid: Manifold, planes: FloatArray) -> Manifold:
    """What lies in front of every plane; trimming nothing would give an invalid solid."""
    for *normal, offset in planes.tolist():
        if solid.is_empty():
            break
        solid = solid.trim_by_plane(normal, offset)
    return solid


def union(solids: Sequence[Manifold], directions: FloatArray) -> Manifold:
    """Union of solids, neighbours in direction (n, 3) first.

    Nearby shadows cancel most of each other's faces; uniting them first keeps every
    intermediate solid small.
    """
    if not len(solids):
        return Manifold()
    if len(solids) == 1:
        return solids[0]
    if len(solids) == 2:
        both = solids[0] + solids[1]
    else:
        axis = int(np.ptp(directions, axis=0).argmax())
        order = np.argsort(directions[:, axis], kind="stable")
        half = len(order) // 2
        both = union([solids[i] for i in order[:half]], directions[order[:half]])
        both = both + union([solids[i] for i in order[half:]], directions[order[half:]])
    both.num_tri()  # evaluates now: a lazy tree would be flattened into another order
    return both


def without_slivers(
    solid: Manifold, thickness_mm: float, volume_mm3: float
) -> Manifold:
    """Drop components too thin for any ball: safe, as it only takes viewpoints away.

    A convex solid holds no ball of a radius above 3 volume / area.
    """
    parts = solid.decompose()
    if len(parts) <= 1 and solid.volume() > volume_mm3:
        return solid
    kept = [
        part
        for part in parts
        if part.volume() > volume_mm3
        or 3 * part.volume() > thickness_mm * part.surface_area()
    ]
    if len(kept) == len(parts):
        return solid
    return Manifold.compose(kept) if kept else Manifold()


def mesh_arrays(solid: Manifold) -> tuple[FloatArray, IntArray]:
    """Vertices (n, 3) and faces (m, 3) of a solid, double precision."""
    mesh: Mesh64 = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    faces = np.array(mesh.tri_verts, dtype=np.int64)
    merge = np.arange(len(vertices))
    merge[np.asarray(mesh.merge_from_vert, dtype=np.int64)] = mesh.merge_to_vert
    return np.ascontiguousarray(vertices), np.ascontiguousarray(merge[faces])
