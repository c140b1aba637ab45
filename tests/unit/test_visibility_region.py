import numpy as np
import pytest
import trimesh

from mvp.errors import FeatureError
from mvp.geometry import Box, FeaturePiece, TriangleMesh, concatenated
from mvp.visibility import (
    exactly_visible,
    intersection,
    line_of_sight,
    paper_distance,
    prepare,
    ray_distance,
    visibility_region,
)

WORKSPACE = Box([-100.0, -100.0, -100.0], [100.0, 100.0, 100.0])


def block(low, high):
    shape = trimesh.creation.box(bounds=[low, high])
    return TriangleMesh(shape.vertices, shape.faces, np.arange(12) // 2)


def soup(*triangles):
    corners = np.array(triangles, dtype=float).reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    return TriangleMesh(corners, faces, np.arange(len(faces)))


def plate_with_window(height, half):
    """A square of half width 1000 with a square window, as eight triangles."""
    out, into = 1000.0, half
    ring = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    triangles = []
    for (x, y), (u, v) in zip(ring, ring[1:] + ring[:1], strict=True):
        a, b = [into * x, into * y, height], [into * u, into * v, height]
        c, d = [out * u, out * v, height], [out * x, out * y, height]
        triangles += [[a, b, c], [a, c, d]]
    return soup(*triangles)


def region_of(mesh, *pieces, **options):
    return visibility_region(prepare(mesh), pieces, WORKSPACE, **options)


def top_edge():
    """The edge x = 10, z = 0 of a block below and left of it."""
    planes = [[0, 0, 1, 0], [1, 0, 0, 10]]
    return FeaturePiece([[10, -10, 0], [10, 10, 0]], planes, "any")


BLOCK = block([-10, -10, -20], [10, 10, 0])


def test_a_convex_edge_is_seen_from_wherever_one_of_its_faces_is_seen():
    region = region_of(BLOCK, top_edge())
    assert region.volume_mm3 == pytest.approx(200 * (200 * 200 - 110 * 100))
    assert region.contains([[-50, 0, 1], [50, 0, -50], [-50, 0, -1]]).tolist() == [
        True,
        True,
        False,
    ]


def test_a_reflex_edge_is_seen_only_where_both_faces_are_seen():
    steps = concatenated([block([-50, -50, -20], [50, 50, 0])])
    wall = block([-50, -50, 0], [0, 50, 30])
    piece = FeaturePiece([[0, -10, 0], [0, 10, 0]], [[0, 0, 1, 0], [1, 0, 0, 0]], "all")
    region = region_of(concatenated([steps, wall]), piece)
    assert region.volume_mm3 == pytest.approx(200 * 100 * 100)


def test_a_point_under_a_square_window_is_seen_through_a_pyramid():
    region = region_of(plate_with_window(20.0, 5.0), FeaturePiece([[0, 0, 0]]))
    above = 4 * 5**2 / (3 * 20**2) * (100**3 - 20**3)
    below = 200 * 200 * 120
    assert region.volume_mm3 == pytest.approx(above + below)
    on_axis = 60 * 5 / np.hypot(5, 20)
    distance, gradient = region.signed_distance_gradient([[1.0, 0, 60]])
    assert distance[0] == pytest.approx(on_axis - 20 / np.hypot(5, 20))
    assert gradient[0] == pytest.approx(np.array([-20, 0, 5]) / np.hypot(5, 20))


def test_a_segment_under_a_window_is_seen_from_less_than_its_ends():
    window = plate_with_window(20.0, 5.0)
    ends = np.array([[-2.0, 0, 0], [2.0, 0, 0]])
    whole = region_of(window, FeaturePiece(ends))
    both = region_of(window, FeaturePiece(ends[:1]), FeaturePiece(ends[1:]))
    assert whole.volume_mm3 == pytest.approx(both.volume_mm3)
    bar = soup([[-0.1, -50, 10], [0.1, -50, 10], [0, 50, 10]])
    whole, both = (
        region_of(bar, FeaturePiece(ends)),
        region_of(bar, FeaturePiece(ends[:1]), FeaturePiece(ends[1:])),
    )
    assert whole.volume_mm3 < both.volume_mm3


def test_no_view_point_inside_the_material_sees_anything():
    region = region_of(BLOCK, top_edge())
    inside = np.random.default_rng(0).uniform([-10, -10, -20], [10, 10, 0], (200, 3))
    assert not region.contains(inside).any()
    assert (region.signed_distance(inside) < 0).all()


def test_an_edge_in_a_closed_cavity_is_seen_only_from_inside_the_cavity():
    outer, inner = (
        block([-30, -30, -30], [30, 30, 30]),
        block([-20, -20, -20], [20, 20, 20]),
    )
    hollow = TriangleMesh(inner.vertices_mm, inner.faces[:, ::-1], inner.face_ids)
    piece = FeaturePiece(
        [[-20, -20, -20], [20, -20, -20]], [[0, 0, 1, -20], [0, 1, 0, -20]], "all"
    )
    region = region_of(concatenated([outer, hollow]), piece)
    assert region.volume_mm3 == pytest.approx(40**3)


def test_a_feature_that_nothing_can_see_has_an_empty_region_and_a_reason():
    lid = block([-10, -10, 0], [10, 10, 5])
    buried = FeaturePiece([[-5, 0, 0], [5, 0, 0]], [[0, 0, 1, 0], [0, 0, -1, 0]], "all")
    region = region_of(concatenated([BLOCK, lid]), buried)
    assert region.empty
    assert region.volume_mm3 == 0
    assert not region.contains([[50, 50, 50]]).any()
    assert region.signed_distance([[50, 50, 50]])[0] == -WORKSPACE.diagonal_mm
    assert region.nearest_facets([[50, 50, 50]], 3).facet.tolist() == [[-1, -1, -1]]
    assert "its own faces hide 100%" in region.binding


def test_the_binding_names_the_faces_that_hide_most():
    lid = soup([[-900, -900, 30], [900, -900, 30], [0, 900, 30]])
    region = region_of(lid, FeaturePiece([[0, 0, 0]]))
    shares = region.bindings[0].face_shares
    assert shares[0] == pytest.approx(0.35, abs=0.05)
    assert "blocked by face 0 (3" in region.binding


def test_nothing_in_the_way_leaves_the_whole_workspace():
    empty = TriangleMesh(
        np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    )
    region = region_of(empty, FeaturePiece([[0, 0, 0]]))
    assert region.volume_mm3 == pytest.approx(200**3)
    assert region.signed_distance([[90, 0, 0]])[0] == WORKSPACE.diagonal_mm
    assert region.binding == "nothing is in the way"


def test_walls_count_only_on_request():
    edge = top_edge()
    without, with_walls = region_of(BLOCK, edge), region_of(BLOCK, edge, walls=True)
    point = [[-50.0, 0.0, 99.0]]
    assert without.signed_distance(point)[0] == pytest.approx(99)
    assert with_walls.signed_distance(point)[0] == pytest.approx(1)
    assert with_walls.nearest_facets(point, 1).direction[0, 0].tolist() == [0, 0, -1]


def test_a_view_point_outside_the_workspace_is_not_visible():
    region = region_of(BLOCK, top_edge())
    assert not region.contains([[0, 0, 101.0]])[0]
    assert region.signed_distance([[0, 0, 101.0]])[0] == pytest.approx(-1)


def test_a_single_triangle_hides_from_both_sides_however_it_is_turned():
    triangle = np.array([[-30.0, -30, 20], [30, -30, 20], [0, 40, 20]])
    point = FeaturePiece([[0, 0, 0]])
    volumes = [
        region_of(soup(triangle[order]), point).volume_mm3
        for order in ([0, 1, 2], [2, 1, 0])
    ]
    assert volumes[0] == pytest.approx(volumes[1])
    assert volumes[0] < 0.85 * 200**3


@pytest.mark.parametrize("damage", ["soup", "open", "flipped", "inside out", "doubled"])
def test_damaged_meshes_give_the_same_region_as_the_solid(damage):
    roof = block([-15, -15, 20], [15, 15, 30])
    faces = np.array(roof.faces)
    if damage == "open":
        faces = faces[:-1]
    if damage == "flipped":
        faces[3] = faces[3][::-1]
    if damage == "inside out":
        faces = faces[:, ::-1]
    if damage == "doubled":
        faces = np.concatenate([faces, faces[:, ::-1]])
    vertices = np.array(roof.vertices_mm)
    if damage == "soup":
        vertices, faces = vertices[faces].reshape(-1, 3), np.arange(36).reshape(-1, 3)
    damaged = TriangleMesh(vertices, faces, np.zeros(len(faces), np.int64))
    edge = top_edge()
    sound = region_of(concatenated([BLOCK, roof]), edge)
    other = region_of(concatenated([BLOCK, damaged]), edge)
    points = np.random.default_rng(1).uniform(-100, 100, (2000, 3))
    inside_roof = roof.bounds.contains(points)
    same = sound.contains(points) == other.contains(points)
    assert same[~inside_roof].all()
    assert not other.contains(
        points[exactly_visible(damaged, [edge], points) == 0]
    ).any()


def test_a_feature_inside_another_solid_is_not_seen_through_its_back_faces():
    holder = block([-40, -40, -40], [40, 40, 40])
    region = region_of(concatenated([BLOCK, holder]), top_edge())
    assert not region.contains(np.random.default_rng(2).uniform(41, 99, (200, 3))).any()


def test_a_pin_through_a_face_hides_a_part_of_it_from_everywhere():
    turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    outline = np.stack([20 * np.cos(turns), 20 * np.sin(turns), 0 * turns], axis=1)
    face = FeaturePiece(outline, [[0, 0, 1, 0]], "all")
    pin = block([-1, -1, -30], [1, 1, 0.5])
    points = np.random.default_rng(3).uniform(-100, 100, (1000, 3))
    assert not exactly_visible(pin, [face], points).any()
    assert not region_of(pin, face).contains(points).any()


def test_a_pin_through_a_hole_mouth_leaves_its_rim_to_be_seen():
    turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    rim = np.stack([20 * np.cos(turns), 20 * np.sin(turns), 0 * turns], axis=1)
    mouth = FeaturePiece(rim, [[0, 0, 1, 0]], "all", mouth=True)
    pin = block([-1, -1, -30], [1, 1, 0.5])
    region = region_of(pin, mouth)
    assert region.statistics.pieces == 12
    points = np.random.default_rng(3).uniform(-100, 100, (3000, 3))
    chords = [
        FeaturePiece(np.stack([rim[i], rim[i - 1]]), mouth.planes, "all")
        for i in range(12)
    ]
    clear = np.abs(region.signed_distance(points)) > 0.01
    seen = exactly_visible(pin, chords, points)
    assert seen.any()
    assert (region.contains(points) == seen)[clear].all()
    assert not exactly_visible(pin, [mouth], points).any()


def test_an_occluder_a_micrometre_over_a_feature_casts_its_whole_shadow():
    cover = soup([[-30.0, -30, 1e-3], [30, -30, 1e-3], [0, 40, 1.1e-3]])
    piece = FeaturePiece([[-3, 0, 0], [3, 0, 0]])
    region = region_of(cover, piece)
    points = np.random.default_rng(4).uniform(-100, 100, (3000, 3))
    clear = np.abs(region.signed_distance(points)) > 0.01
    assert (region.contains(points) == exactly_visible(cover, [piece], points))[
        clear
    ].all()


def test_the_region_of_several_pieces_is_their_intersection():
    window = plate_with_window(20.0, 5.0)
    a = region_of(window, FeaturePiece([[-3, 0, 0]]))
    b = region_of(window, FeaturePiece([[3, 0, 0]]))
    both = intersection([a, b])
    points = np.random.default_rng(5).uniform(-100, 100, (2000, 3))
    inside = both.contains(points)
    assert (inside == (a.contains(points) & b.contains(points))).all()
    smaller = np.minimum(a.signed_distance(points), b.signed_distance(points))
    assert both.signed_distance(points)[inside] == pytest.approx(smaller[inside])


def test_pieces_one_after_the_other_lose_nothing():
    """Each is looked at only from where the ones before are seen."""
    posts = [
        block([x, y, 0], [x + 4, y + 4, 5 + abs(x)])
        for x, y in ((-40, -20), (-15, 25), (20, -5), (35, 30))
    ]
    beyond = [block([x, -20, 60], [x + 10, 20, 70]) for x in (-90, 80)]
    mesh = concatenated([*posts, plate_with_window(50, 30), *beyond])
    pieces = [
        FeaturePiece([[x, y, 0], [x + 8, y, 0], [x, y + 8, 0]], [[0, 0, 1, 0]], "all")
        for x, y in ((-10, -10), (0, 12), (25, 5), (-30, 5), (5, -30))
    ]
    together = region_of(mesh, *pieces)
    alone = intersection([region_of(mesh, piece) for piece in pieces])
    assert together.volume_mm3 > 1e4
    assert together.volume_mm3 == pytest.approx(alone.volume_mm3, rel=1e-9)
    assert together.statistics.pieces == len(pieces)
    assert (together.solid - alone.solid).volume() < 1e-6
    assert (alone.solid - together.solid).volume() < 1e-6
    assert together.statistics.kept < alone.statistics.kept


def test_regions_of_different_workspaces_are_not_mixed():
    a = region_of(BLOCK, top_edge())
    b = visibility_region(prepare(BLOCK), [top_edge()], Box([-9] * 3, [9] * 3))
    with pytest.raises(ValueError, match="different workspaces"):
        intersection([a, b])
    with pytest.raises(ValueError, match="at least one"):
        intersection([])


def test_a_feature_without_points_is_refused():
    with pytest.raises(FeatureError):
        region_of(BLOCK)
    with pytest.raises(FeatureError):
        region_of(BLOCK, FeaturePiece(np.zeros((0, 3))))


def brute_force_facets(region, point):
    """Distance to every facet that is no wall, by dense sampling-free projection."""
    best = {}
    triangles = region.mesh.triangles_mm
    for i in np.flatnonzero(~region.on_wall):
        closest = trimesh.triangles.closest_point(triangles[i : i + 1], point[None])[0]
        facet = int(region.mesh.face_ids[i])
        distance = np.linalg.norm(point - closest)
        if distance < best.get(facet, (np.inf,))[0]:
            best[facet] = (distance, closest)
    return sorted(best.values(), key=lambda entry: entry[0])


def test_the_nearest_facets_are_those_of_brute_force():
    scene = concatenated([BLOCK, block([-15, -15, 20], [15, 15, 30])])
    region = region_of(scene, top_edge())
    points = np.random.default_rng(6).uniform(-100, 100, (60, 3))
    found = region.nearest_facets(points, 6)
    for row, point in enumerate(points):
        expected = brute_force_facets(region, point)[:6]
        assert found.distance_mm[row] == pytest.approx([d for d, _ in expected])
        first = (point - expected[0][1]) / expected[0][0]
        assert found.direction[row, 0] == pytest.approx(first, abs=1e-9)
        assert len(set(found.facet[row])) == 6


def test_one_point_and_many_points_get_the_same_answer():
    region = region_of(
        concatenated([BLOCK, block([-15, -15, 20], [15, 15, 30])]), top_edge()
    )
    points = np.random.default_rng(7).uniform(-100, 100, (5000, 3))
    distance = region.signed_distance(points)
    alone = np.array([region.signed_distance(p[None])[0] for p in points[:50]])
    assert distance[:50] == pytest.approx(alone)
    assert (region.contains(points) == (distance > 0)).all()
    facets = region.nearest_facets(points, 1).distance_mm[:, 0]
    assert facets[distance > 0] == pytest.approx(distance[distance > 0])


def test_coplanar_triangles_are_one_facet():
    region = region_of(BLOCK, top_edge())
    assert (~region.on_wall).sum() > 2
    walls = set(region.mesh.face_ids[region.on_wall])
    others = set(region.mesh.face_ids[~region.on_wall])
    assert len(others) == 2
    assert not walls & others


def test_the_gradient_is_that_of_finite_differences():
    region = region_of(
        concatenated([BLOCK, block([-15, -15, 20], [15, 15, 30])]), top_edge()
    )
    points = np.random.default_rng(8).uniform(-95, 95, (200, 3))
    gradient = region.signed_distance_gradient(points)[1]
    step = 1e-5
    numeric = np.stack(
        [
            (region.signed_distance(points + s) - region.signed_distance(points - s))
            / (2 * step)
            for s in step * np.eye(3)
        ],
        axis=1,
    )
    smooth = np.abs(np.linalg.norm(numeric, axis=1) - 1) < 1e-6
    assert smooth.mean() > 0.9
    assert gradient[smooth] == pytest.approx(numeric[smooth], abs=1e-5)


def test_a_step_never_loses_more_distance_than_its_facets_say():
    region = region_of(
        concatenated([BLOCK, block([-15, -15, 20], [15, 15, 30])]), top_edge()
    )
    rng = np.random.default_rng(9)
    points = rng.uniform(-100, 100, (500, 3))
    points = points[region.contains(points)]
    step = rng.normal(0, 3, points.shape)
    near = region.nearest_facets(points, 12)
    model = near.distance_mm + np.einsum("nkd,nd->nk", near.direction, step)
    safe = np.minimum(
        model.min(axis=1), near.distance_mm[:, -1] - np.linalg.norm(step, axis=1)
    )
    after = region.signed_distance(points + step)
    inside = region.workspace.contains(points + step) & (safe > 0)
    assert (after >= safe - 1e-9)[inside].all()


def test_the_ray_measure_never_falls_below_the_distance_and_approaches_it():
    region = region_of(
        concatenated([BLOCK, block([-15, -15, 20], [15, 15, 30])]), top_edge()
    )
    points = np.random.default_rng(10).uniform(-90, 90, (50, 3))
    exact = paper_distance(region, points)
    few, many = (ray_distance(region, points, rays=n) for n in (16, 2000))
    assert (np.sign(many) == np.sign(exact)).all()
    assert (np.abs(few) >= np.abs(many) - 30).all()
    assert (np.abs(many) >= np.abs(exact) - 1e-9).all()
    assert np.abs(many) == pytest.approx(np.abs(exact), rel=0.15)


def test_clusters_are_labelled_and_never_see_more_than_the_exact_region():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=12)
    dome = TriangleMesh(
        np.add(ball.vertices, [60, 0, 60]),
        ball.faces,
        np.zeros(len(ball.faces), np.int64),
    )
    scene = concatenated([BLOCK, dome])
    exact = region_of(scene, top_edge())
    rough = region_of(scene, top_edge(), cluster_mm=0.2)
    assert exact.exact
    assert not rough.exact
    assert rough.statistics.polygons < 0.5 * exact.statistics.polygons
    assert (rough.solid - exact.solid).volume() < 1e-6 * exact.volume_mm3
    assert rough.volume_mm3 > 0.97 * exact.volume_mm3


def test_lines_of_sight_agree_with_the_exact_test():
    scene = concatenated([BLOCK, block([-15, -15, 20], [15, 15, 30])])
    rng = np.random.default_rng(11)
    views, targets = rng.uniform(-90, 90, (80, 3)), rng.uniform(-30, 30, (20, 3))
    clear = line_of_sight(prepare(scene), views, targets)
    exact = np.stack(
        [exactly_visible(scene, [FeaturePiece(t[None])], views) for t in targets], 1
    )
    assert (clear == exact).mean() > 0.998


def test_statistics_tell_how_the_region_came_about():
    ticks = iter(range(1000))
    region = region_of(BLOCK, top_edge(), clock=lambda: float(next(ticks)))
    assert region.statistics.triangles == 12
    assert region.statistics.two_sided_edges == 0
    assert set(region.statistics.seconds) >= {"cull", "union", "check"}
    assert prepare(soup([[0, 0, 0], [1, 0, 0], [0, 1, 0]])).bad_edges == 3
