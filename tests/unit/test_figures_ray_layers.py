"""One ray for a patch of pixels tells what a ray for every pixel tells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh as EmbreeMesh

from mvp.cell.figures.ray_layers import Raster, cast_layers
from mvp.cell.places import bundled_root
from mvp.geometry import Box, TriangleMesh, box_mesh, concatenated, load_part, unit

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.geometry import FloatArray, IntArray


def cube(side_mm: float, at_mm: float = 0.0) -> TriangleMesh:
    low = np.array([at_mm, at_mm, 0.8 * at_mm])
    return box_mesh(Box(low, low + side_mm), name="cube")


def seen_by(mesh: TriangleMesh) -> Raster:
    """A raster from above and aside that the mesh fills."""
    forward = unit(np.array([0.3, 0.5, -0.8]))
    across = unit(np.cross(forward, [0.0, 0.0, 1.0]))
    step = mesh.bounds.diagonal_mm / 180
    across, down = across * step, np.cross(forward, across) * step
    corner = mesh.bounds.centre_mm - mesh.bounds.diagonal_mm * forward
    return Raster(corner - 90 * across - 80 * down, across, down, forward, (160, 180))


def one_by_one(mesh: TriangleMesh, raster: Raster) -> tuple[FloatArray, IntArray]:
    """First depth and triangle of every pixel's own ray."""
    scene = rtcore_scene.EmbreeScene()
    EmbreeMesh(scene, mesh.vertices_mm.astype(np.float32), mesh.faces.astype(np.int32))
    origins = raster.origins(np.arange(np.prod(raster.shape))).astype(np.float32)
    along = np.tile(raster.forward.astype(np.float32), (len(origins), 1))
    found = scene.run(origins, along, output=True)
    hit = found["primID"] >= 0
    return np.where(hit, found["tfar"], np.inf), found["primID"]


def paper_part() -> TriangleMesh:
    return load_part(bundled_root() / "virtual" / "parts" / "paper_object.stl").mesh


def through_each_other() -> TriangleMesh:
    first, second = cube(40.0), cube(30.0, at_mm=14.0)
    return concatenated([first, second])


@pytest.mark.parametrize("made", [paper_part, through_each_other])
def test_all_but_few_pixels_have_the_triangle_and_depth_of_their_own_ray(
    made: Callable[[], TriangleMesh],
) -> None:
    mesh = made()
    raster = seen_by(mesh)
    depth, triangle = cast_layers(mesh, raster, 1)
    true_depth, true_triangle = one_by_one(mesh, raster)
    assert 0.2 < (true_triangle >= 0).mean() < 0.9
    assert (triangle[0] != true_triangle).mean() < 2e-3
    same = (triangle[0] == true_triangle) & (true_triangle >= 0)
    np.testing.assert_allclose(depth[0][same], true_depth[same], atol=2e-3)
    assert np.isinf(depth[0][triangle[0] < 0]).all()


def test_behind_a_hit_lies_the_next_one() -> None:
    mesh = cube(40.0)
    raster = seen_by(mesh)
    depth, triangle = cast_layers(mesh, raster, 2)
    hit = triangle[0] >= 0
    assert (triangle[1][~hit] == -1).all()
    both = hit & (triangle[1] >= 0)
    assert both.sum() > 0.98 * hit.sum()
    assert (depth[1][both] > depth[0][both]).all()
    facing = mesh.normals @ raster.forward
    assert (facing[triangle[0][both]] < 0).all()
    assert (facing[triangle[1][both]] > 0).all()
