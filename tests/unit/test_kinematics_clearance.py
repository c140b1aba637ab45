import igl
import numpy as np
import pytest

from mvp.geometry import (
    Box,
    TriangleMesh,
    box_mesh,
)
from mvp.kinematics import (
    Capsule,
    CellBodies,
    JointPath,
    NoPath,
    Obstacle,
    arm_model,
    blocked_sight,
    find_path,
    obstacles,
    segment_clearance,
)
from mvp.kinematics.distance import TriangleBlocks, segment_segment, segment_triangle

HOME = np.radians([0.0, -90, 90, -90, -90, 0])
TOOL = (Capsule("camera", np.array([0.0, 0, 20]), np.array([0.0, 0, 95]), 32.0),)


def soup(rng: np.random.Generator, count: int, size: float = 60.0) -> TriangleMesh:
    corners = rng.uniform(-200, 200, (count, 1, 3)) + rng.normal(0, size, (count, 3, 3))
    faces = np.arange(3 * count).reshape(-1, 3)
    return TriangleMesh(corners.reshape(-1, 3), faces, np.arange(count), "soup")


def sampled(p: np.ndarray, q: np.ndarray, mesh: TriangleMesh) -> tuple[float, float]:
    """Bounds of a segment's distance from points on it; no code in common."""
    count = 4000
    points = p + np.linspace(0, 1, count)[:, None] * (q - p)
    squared = igl.point_mesh_squared_distance(points, mesh.vertices_mm, mesh.faces)[0]
    upper = float(np.sqrt(squared.min()))
    return upper - float(np.linalg.norm(q - p)) / count, upper


@pytest.mark.parametrize("count", [1, 7, 400])
def test_segment_distances_agree_with_sampled_points(count):
    rng = np.random.default_rng(count)
    mesh = soup(rng, count)
    p, q = rng.uniform(-300, 300, (2, 40, 3))
    found = TriangleBlocks.of(mesh).distance(p, q, 1e4)
    for k in range(len(p)):
        lower, upper = sampled(p[k], q[k], mesh)
        assert lower - 1e-9 <= found[k] <= upper + 1e-9


def test_a_segment_through_a_triangle_is_at_distance_zero():
    triangle = np.array([[[0.0, 0, 0], [10, 0, 0], [0, 10, 0]]])
    through = segment_triangle(
        np.array([[2.0, 2, -5]]), np.array([[2.0, 2, 5]]), triangle
    )
    above = segment_triangle(np.array([[2.0, 2, 3]]), np.array([[2.0, 2, 5]]), triangle)
    assert through[0] == 0
    assert above[0] == pytest.approx(3)


def test_degenerate_segments_and_triangles_have_a_distance():
    point = np.array([[1.0, 2, 3]])
    flat = np.array([[[0.0, 0, 0], [10, 0, 0], [5, 0, 0]]])
    assert segment_triangle(point, point, flat)[0] == pytest.approx(np.hypot(2, 3))
    assert segment_segment(point, point, point, point)[0] == 0


def test_parallel_segments_have_the_distance_of_their_lines():
    a, b = np.array([0.0, 0, 0]), np.array([10.0, 0, 0])
    c, d = np.array([4.0, 3, 0]), np.array([25.0, 3, 0])
    assert segment_segment(a, b, c, d) == pytest.approx(3)
    assert segment_segment(a, b, d, np.add(d, [5, 0, 0])) == pytest.approx(
        np.hypot(15, 3)
    )


def test_far_obstacles_are_reported_at_the_ceiling():
    mesh = soup(np.random.default_rng(1), 30)
    away = np.full((1, 3), 5000.0)
    assert TriangleBlocks.of(mesh).distance(away, away, 250.0)[0] == 250


def test_a_capsule_inside_a_solid_counts_as_deep_inside():
    box = box_mesh(Box(np.full(3, -100.0), np.full(3, 100.0)), name="block")
    point = np.array([[0.0, 0, 10]])
    assert Obstacle("block", box).distance(point, point, 250.0)[0] == pytest.approx(-90)


def test_a_box_mesh_is_closed_and_points_outwards():
    mesh = box_mesh(Box(np.zeros(3), np.array([1.0, 2, 3])), name="box")
    a, b, c = np.moveaxis(mesh.triangles_mm, 1, 0)
    assert (np.einsum("ij,ij->i", a, np.cross(b, c)) / 6).sum() == pytest.approx(6)


def cell(*boxes: tuple[str, list[float], list[float]]) -> CellBodies:
    found = [(name, Box(np.array(low), np.array(high))) for name, low, high in boxes]
    return CellBodies(arm_model("ur5e"), TOOL, obstacles(None, (), found))


def test_the_closest_pair_is_named():
    # The camera hangs over (-492, -133) with its lens at 488 - 95 - 32 mm.
    bodies = cell(("table", [-700, -300, 0], [-300, 0, 300]))
    nearest = bodies.nearest(HOME)
    assert (nearest.body, nearest.other) == ("camera", "table")
    assert nearest.distance_mm == pytest.approx(487.9 - 95 - 32 - 300, abs=1e-6)


def test_an_arm_that_folds_onto_itself_is_noticed():
    folded = np.radians([0.0, -90, 179, -90, -90, 0])
    assert cell().nearest(folded).distance_mm < 0
    assert cell().nearest(HOME).distance_mm > 30


def test_no_configuration_on_a_path_is_closer_than_certified():
    bodies = cell(("post", [-520, 80, 0], [-480, 120, 700]))
    goal = HOME + np.radians([-25, 5, -5, 0, 10, 40])
    found = segment_clearance(bodies, HOME, goal)
    shares = np.linspace(0, 1, 400)[:, None]
    dense = bodies.smallest(HOME + shares * (goal - HOME)).min()
    assert found.certified_mm <= dense + 1e-9
    assert found.certified_mm >= min(dense, 50.0) - 2.0


def test_a_thin_post_between_two_clear_ends_is_found():
    bodies = cell(("post", [-512, -2, 0], [-508, 2, 700]))
    goal = HOME + np.radians([-30.0, 0, 0, 0, 0, 0])
    assert bodies.nearest(HOME).distance_mm > 0
    assert bodies.nearest(goal).distance_mm > 0
    found = segment_clearance(bodies, HOME, goal)
    assert found.certified_mm < 0
    assert found.nearest.other == "post"


def test_a_way_over_the_post_is_found_and_named():
    bodies = cell(("post", [-500, 20, 0], [-470, 60, 390]))
    goal = HOME + np.radians([-40.0, 0, 0, 0, 0, 0])
    path = find_path(bodies, HOME, goal, required_mm=5.0)
    assert isinstance(path, JointPath)
    assert path.via
    assert path.clearance.certified_mm >= 5
    np.testing.assert_array_equal(path.waypoints[[0, -1]], [HOME, goal])


def test_when_every_way_is_blocked_the_bodies_are_named():
    bodies = cell(("wall", [-900, 20, -200], [-100, 60, 2000]))
    goal = HOME + np.radians([-60.0, 0, 0, 0, 0, 0])
    path = find_path(bodies, HOME, goal, home=HOME, required_mm=5.0)
    assert isinstance(path, NoPath)
    assert "wall" in path.reason


def test_a_body_in_the_line_of_sight_is_named_but_the_lens_itself_is_not():
    bodies = cell().moving(HOME[None])
    pupil = np.array([-491.9, -133.3, 487.9 - 95])
    down = pupil - [0, 0, 300.0]
    up_through_the_flange = np.add(pupil, [0, 0, 300.0])
    assert blocked_sight(bodies, pupil, down[None]) == ()
    assert "wrist 3 link" in blocked_sight(bodies, pupil, up_through_the_flange[None])


def test_a_way_that_no_simple_move_gives_is_searched_and_certified():
    bodies = cell(("wall", [-900, 90, -200], [-330, 130, 1200]))
    goal = HOME + np.radians([-70.0, 0, 0, 0, 0, 0])
    path = find_path(bodies, HOME, goal, required_mm=5.0)
    assert isinstance(path, JointPath), path.reason
    assert "searched" in path.via
    assert path.clearance.certified_mm >= 5
    again = find_path(bodies, HOME, goal, required_mm=5.0)
    assert isinstance(again, JointPath)
    np.testing.assert_array_equal(again.waypoints, path.waypoints)


def test_a_goal_that_is_itself_too_close_is_named():
    bodies = cell(("wall", [-900, -300, 300], [-100, 60, 420]))
    path = find_path(bodies, np.radians([90.0, -90, 90, -90, -90, 0]), HOME)
    assert isinstance(path, NoPath)
    assert "at the goal" in path.reason
