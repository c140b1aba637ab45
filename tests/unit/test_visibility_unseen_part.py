"""A part that nobody drew: random pockets, bosses, holes and dents in a tilted plate.

As a solid, as a single-precision file, and with one triangle in twenty missing.
"""

import numpy as np
import pytest
import trimesh
from manifold3d import CrossSection, JoinType, Manifold

from mvp.geometry import Box, TriangleMesh, load_part
from mvp.scene import extract_features
from mvp.visibility import exactly_visible, prepare, visibility_region

SIZE_MM = np.array([160.0, 100.0, 24.0])
SEGMENTS = 20
VIEW_POINTS = 300


def somewhere(rng, border):
    return rng.uniform([border, border], SIZE_MM[:2] - border)


def pocket(rng):
    width, length = rng.uniform(8, 30, 2)
    depth, (x, y) = rng.uniform(3, 15), somewhere(rng, 20)
    outline = CrossSection.square((width, length), True)
    outline = outline.offset(rng.uniform(2, 6), JoinType.Round, 2.0, SEGMENTS)
    turned = outline.extrude(depth + 1).rotate((0, 0, rng.uniform(0, 90)))
    return turned.translate((x, y, SIZE_MM[2] - depth))


def boss_with_fillet(rng):
    radius, height, (x, y) = rng.uniform(3, 9), rng.uniform(5, 30), somewhere(rng, 14)
    top = rng.uniform(0.6, 1) * radius
    boss = Manifold.cylinder(height + 10, radius, top, SEGMENTS).translate((0, 0, -10))
    fillet = min(2.0, radius / 2)
    turns = np.linspace(0, np.pi / 2, 5)[1:]
    arc = [
        (radius + fillet - fillet * np.sin(t), fillet - fillet * np.cos(t))
        for t in turns
    ]
    profile = [(0, 0), (radius + fillet, 0), *arc, (0, fillet)]
    foot = CrossSection([profile]).revolve(SEGMENTS)
    return (boss + foot).translate((x, y, SIZE_MM[2]))


def hole(rng):
    radius, (x, y) = rng.uniform(1.5, 6), somewhere(rng, 8)
    return Manifold.cylinder(60, radius, radius, SEGMENTS).translate((x, y, -1))


def dent(rng):
    radius, (x, y) = rng.uniform(6, 16), somewhere(rng, 14)
    height = SIZE_MM[2] + rng.uniform(0, 0.5) * radius
    return Manifold.sphere(radius, SEGMENTS).translate((x, y, height))


def unseen_part(rng):
    solid = Manifold.cube(tuple(SIZE_MM))
    for count, sign, make in (
        (5, -1, pocket),
        (4, 1, boss_with_fillet),
        (6, -1, hole),
        (3, -1, dent),
    ):
        for _ in range(count):
            solid = solid + make(rng) if sign > 0 else solid - make(rng)
    mesh = solid.rotate(tuple(rng.uniform(0, 360, 3))).to_mesh64()
    faces = np.array(mesh.tri_verts, dtype=np.int64)
    ids = np.zeros(len(faces), dtype=np.int64)
    return TriangleMesh(np.array(mesh.vert_properties[:, :3]), faces, ids, "unseen")


def as_drawn(mesh, _rng, _folder):
    return mesh


def from_stl(mesh, _rng, folder):
    path = folder / "unseen.stl"
    trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False).export(path)
    return load_part(path, units="mm").mesh


def damaged(mesh, rng, _folder):
    kept = rng.random(len(mesh.faces)) > 0.05
    return TriangleMesh(mesh.vertices_mm, mesh.faces[kept], mesh.face_ids[kept])


def some_features(catalogue, count, rng):
    """Edges, a hole and a face or more, as far as there are any."""
    kinds = {"E": catalogue.edges, "H": catalogue.holes, "F": catalogue.patches}
    wanted = {"E": count, "H": count // 2, "F": count // 2}
    return [
        catalogue.feature(f"{kind}{number + 1}")
        for kind, found in kinds.items()
        for number in rng.choice(
            len(found), min(wanted[kind], len(found)), replace=False
        )
    ]


def view_points(region, workspace, count, rng):
    """Anywhere, and half of them close to the boundary if there is one."""
    points = rng.uniform(workspace.low_mm, workspace.high_mm, (count, 3))
    counted = ~region.on_wall
    if counted.any():
        some = rng.choice(np.flatnonzero(counted), count // 2)
        share = rng.dirichlet([1, 1, 1], count // 2)
        near = np.einsum("nk,nkd->nd", share, region.mesh.triangles_mm[some])
        points[: count // 2] = near + rng.uniform(-1, 1, near.shape)
    return points[workspace.contains(points)]


def disagreements(mesh, features, count, rng):
    occluders = prepare(mesh)
    workspace = Box.around(mesh.vertices_mm, grow_mm=mesh.extent_mm / 2)
    band = 0.01 + 1e-6 * workspace.diagonal_mm
    wrong = seen = 0
    for feature in features:
        pieces = feature.sight_pieces()
        region = visibility_region(occluders, pieces, workspace)
        points = view_points(region, workspace, count, rng)
        distance = region.signed_distance(points)
        visible = exactly_visible(mesh, pieces, points)
        wrong += int((((distance > 0) != visible) & (np.abs(distance) > band)).sum())
        seen += int(visible.sum())
    return wrong, seen


@pytest.mark.parametrize("as_found", [as_drawn, from_stl, damaged])
def test_a_part_that_nobody_drew_is_seen_as_the_exact_test_sees_it(as_found, tmp_path):
    rng = np.random.default_rng(20)
    mesh = as_found(unseen_part(rng), rng, tmp_path)
    assert len(mesh.faces) > 2_000
    features = some_features(extract_features(mesh), 2, rng)
    assert len(features) >= 3
    wrong, seen = disagreements(mesh, features, VIEW_POINTS, rng)
    assert wrong == 0
    assert seen > 0


@pytest.mark.full
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("as_found", [as_drawn, from_stl, damaged])
def test_more_such_parts_and_features(as_found, seed, tmp_path):
    rng = np.random.default_rng(100 + seed)
    mesh = as_found(unseen_part(rng), rng, tmp_path)
    features = some_features(extract_features(mesh), 5, rng)
    wrong, seen = disagreements(mesh, features, VIEW_POINTS, rng)
    assert wrong == 0
    assert seen > 0
