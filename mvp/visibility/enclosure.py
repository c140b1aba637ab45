"""Whether the only places that see a feature lie in a closed cavity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.visibility.occluders import Occluders
    from mvp.visibility.region import Region

_PLACES = 32
_DIRECTIONS = 512
_INWARD_SHARE = 1e-4
_GOLDEN_RAD = np.pi * (3 - np.sqrt(5))


def closed_in(region: Region) -> bool:
    """Whether a region, not empty, lies inside the scene with no way to look out.

    Rays in all directions from places of the region meet the scene everywhere: what an
    opening admits from outside would belong to the region itself.
    """
    if region.empty or not region.bindings:
        return False
    occluders = region.bindings[0].occluders
    if not len(occluders.bounds):
        return False
    low_mm, high_mm = occluders.bounds
    vertices = region.mesh.vertices_mm
    slack = occluders.side_tolerance_mm
    if (vertices < low_mm - slack).any() or (vertices > high_mm + slack).any():
        return False
    return _no_way_out(_places(region, occluders), occluders)


def _places(region: Region, occluders: Occluders) -> FloatArray:
    """Places (n, 3) a little inside the boundary of the region."""
    mesh = region.mesh
    chosen = slice(None, None, max(1, len(mesh.faces) // _PLACES))
    middle = mesh.triangles_mm[chosen].mean(axis=1)
    inward_mm = _INWARD_SHARE * occluders.extent_mm
    return np.asarray(middle - inward_mm * mesh.normals[chosen])


def _no_way_out(places_mm: FloatArray, occluders: Occluders) -> bool:
    reach_mm = 4 * occluders.extent_mm
    starts = np.repeat(places_mm, _DIRECTIONS, axis=0)
    along = np.tile(_directions(), (len(places_mm), 1))
    return bool(occluders.rays.blocked(starts, starts + reach_mm * along).all())


def _directions() -> FloatArray:
    """Unit vectors (n, 3) spread evenly over the sphere (golden spiral)."""
    number = np.arange(_DIRECTIONS) + 0.5
    height = 1 - 2 * number / _DIRECTIONS
    radius = np.sqrt(1 - height**2)
    angle = _GOLDEN_RAD * number
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
