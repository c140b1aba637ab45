"""Places that see a feature but lie in a closed cavity are no places for a camera."""

from __future__ import annotations

import numpy as np

from mvp.geometry import Box, TriangleMesh, box_mesh
from mvp.scene import edge_feature
from mvp.visibility import closed_in, prepare, visibility_region

WORKSPACE = Box(np.full(3, -100.0), np.full(3, 100.0))
CAVITY = Box(np.array([-5.0, -5.0, -2.0]), np.array([5.0, 5.0, 2.0]))


def solid(box: Box) -> TriangleMesh:
    return box_mesh(box, name="block")


def joined(first: TriangleMesh, second: TriangleMesh) -> TriangleMesh:
    return TriangleMesh(
        np.vstack([first.vertices_mm, second.vertices_mm]),
        np.vstack([first.faces, second.faces + len(first.vertices_mm)]),
        np.concatenate([first.face_ids, second.face_ids + first.face_ids.max() + 1]),
        "hollow",
    )


def inside_out(mesh: TriangleMesh) -> TriangleMesh:
    return TriangleMesh(mesh.vertices_mm, mesh.faces[:, ::-1], mesh.face_ids, mesh.name)


def block_with(hollow: Box) -> TriangleMesh:
    block = solid(Box(np.array([-20.0, -20.0, -5.0]), np.array([20.0, 20.0, 5.0])))
    return joined(block, inside_out(solid(hollow)))


def test_a_region_in_a_closed_cavity_has_no_way_out():
    mesh = block_with(CAVITY)
    edge = edge_feature("void", (-5, -5, -2), (5, -5, -2), mesh)
    region = visibility_region(prepare(mesh), edge.sight_pieces(), WORKSPACE)
    assert not region.empty
    assert closed_in(region)


def test_an_edge_outside_of_the_same_part_is_not_closed_in():
    mesh = block_with(CAVITY)
    edge = edge_feature("rim", (-20, -20, 5), (20, -20, 5), mesh)
    assert not closed_in(
        visibility_region(prepare(mesh), edge.sight_pieces(), WORKSPACE)
    )


def test_a_pocket_that_is_open_above_is_not_closed_in():
    walls = [
        Box(np.array(low), np.array(high))
        for low, high in (
            ([-20.0, -20.0, -5.0], [20.0, 20.0, -2.0]),
            ([-20.0, -20.0, -2.0], [-5.0, 20.0, 5.0]),
            ([5.0, -20.0, -2.0], [20.0, 20.0, 5.0]),
            ([-5.0, -20.0, -2.0], [5.0, -5.0, 5.0]),
            ([-5.0, 5.0, -2.0], [5.0, 20.0, 5.0]),
        )
    ]
    mesh = solid(walls[0])
    for wall in walls[1:]:
        mesh = joined(mesh, solid(wall))
    edge = edge_feature("floor", (-4, 0, -2), (4, 0, -2), mesh)
    # Small enough to lie within the part's own bounds: only the rays can tell.
    inner = Box(np.array([-4.5, -4.5, -1.9]), np.array([4.5, 4.5, 4.9]))
    region = visibility_region(prepare(mesh), edge.sight_pieces(), inner)
    assert not region.empty
    assert not closed_in(region)
