"""Features do not depend on where a part lies or how its file is ordered."""

from __future__ import annotations

import manifold3d
import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mvp.geometry import Pose, TriangleMesh, edge_table, face_groups, healed
from mvp.scene import edge_feature, extract_features

angles = st.tuples(*[st.floats(-3, 3)] * 3)


def drilled() -> TriangleMesh:
    solid = manifold3d.Manifold.cube((40, 30, 20))
    solid -= manifold3d.Manifold.cylinder(30, 6, 6, 40).translate((14, 15, -1))
    solid -= manifold3d.Manifold.cube((10, 40, 12)).translate((28, -5, 12))
    raw = solid.to_mesh64()
    faces = np.asarray(raw.tri_verts, dtype=np.int64)
    vertices = np.asarray(raw.vert_properties)[:, :3]
    bare = TriangleMesh(vertices, faces, np.zeros(len(faces), np.int64))
    return TriangleMesh(vertices, faces, face_groups(bare))


@settings(max_examples=15, deadline=None)
@given(rotvec=angles, shift=st.tuples(*[st.floats(-500, 500)] * 3))
def test_a_moved_part_has_the_same_features_moved(
    rotvec: tuple[float, float, float], shift: tuple[float, float, float]
) -> None:
    mesh = drilled()
    pose = Pose("b", "a", Rotation.from_rotvec(rotvec).as_matrix(), np.array(shift))
    here, there = extract_features(mesh), extract_features(mesh.moved(pose))
    assert len(here.edges) == len(there.edges)
    np.testing.assert_allclose(here.edges.length_mm, there.edges.length_mm, atol=2e-3)
    centres = pose.apply(np.stack([hole.centre_mm for hole in here.holes]))
    found = np.stack([hole.centre_mm for hole in there.holes])
    gap = np.linalg.norm(centres[:, None] - found, axis=2)
    assert gap.min(axis=1).max() < 1e-6
    assert len(here.patches) == len(there.patches)
    middles = (here.edges.start_mm + here.edges.end_mm) / 2
    moved = (there.edges.start_mm + there.edges.end_mm) / 2
    gap = np.linalg.norm(pose.apply(middles)[:, None] - moved, axis=2)
    assert gap.min(axis=1).max() < 1e-6


@settings(max_examples=15, deadline=None)
@given(rotvec=angles, low=st.floats(0, 0.4), high=st.floats(0.6, 1.0))
def test_any_stretch_of_any_edge_is_found_with_planes_through_it(
    rotvec: tuple[float, float, float], low: float, high: float
) -> None:
    pose = Pose("b", "a", Rotation.from_rotvec(rotvec).as_matrix(), np.ones(3))
    mesh = drilled().moved(pose)
    edges = extract_features(mesh).edges
    for number in range(len(edges)):
        start, end = edges.start_mm[number], edges.end_mm[number]
        along = end - start
        feature = edge_feature("e", start + low * along, start + high * along, mesh)
        for piece in feature.sight_pieces():
            height = piece.vertices_mm @ piece.planes[:, :3].T - piece.planes[:, 3]
            assert np.abs(height).max() < 1e-9
            assert piece.facing == ("any" if edges.convex[number] else "all")


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), share=st.floats(0, 0.5))
def test_healing_any_soup_counts_its_open_edges_like_brute_force(
    seed: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    shape = trimesh.creation.icosphere(subdivisions=1, radius=10)
    kept = rng.random(len(shape.faces)) >= share
    kept[0] = True
    corners = np.asarray(shape.triangles)[kept][rng.permutation(int(kept.sum()))]
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    flipped = rng.random(len(faces)) < 0.3
    faces = np.where(flipped[:, None], faces[:, ::-1], faces)
    mesh, report = healed(
        TriangleMesh(corners.reshape(-1, 3), faces, np.zeros(len(faces), np.int64))
    )
    sides: dict[frozenset[tuple[float, ...]], int] = {}
    for triangle in corners:
        for a, b in ((0, 1), (1, 2), (2, 0)):
            key = frozenset((tuple(triangle[a].round(9)), tuple(triangle[b].round(9))))
            sides[key] = sides.get(key, 0) + 1
    assert report.open_edges == sum(count == 1 for count in sides.values())
    assert report.triangles == len(corners)
    assert not edge_table(mesh).non_manifold.any()
