"""Features found by coordinates, their pieces, and what is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from mvp.errors import FeatureError
from mvp.geometry import TriangleMesh
from mvp.scene import (
    Scene,
    edge_feature,
    face_feature,
    face_feature_at,
    hole_feature_at,
    paper_object,
    point_feature,
    without_slit,
)

CORNER = (12.7, 0.0, 12.7)


@pytest.fixture(scope="module")
def part() -> TriangleMesh:
    return paper_object()


def test_the_paper_object_is_one_closed_solid_with_the_volume_of_its_boxes(
    part: TriangleMesh,
) -> None:
    a, b, c = np.moveaxis(part.triangles_mm, 1, 0)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    shell = 203.2**2 * 76.2 - 190.5**2 * 63.5
    openings = 6.35 * (53 * 64 + 23 * 8 + 38.5 * 36.05)
    assert volume == pytest.approx(shell + 25.4**3 - openings, rel=1e-12)


def test_all_coordinates_of_the_paper_object_are_its_sizes(part: TriangleMesh) -> None:
    known = [-101.6, -95.25, -66, -29.95, -19.05, -12.7, -6, -4, 0, 4, 4.5, 9, 12.7]
    known += [25.4, 43, 50.8, 57.15, 58, 62, 85, 95.25, 101.6]
    assert set(np.unique(part.vertices_mm)) == set(known)


def test_the_variant_without_slit_has_other_holes() -> None:
    plain = paper_object(without_slit())
    assert -75.0 in plain.vertices_mm
    assert 85.0 not in plain.vertices_mm


def test_both_edges_of_the_paper_lie_in_the_sphere_about_the_origin(
    part: TriangleMesh,
) -> None:
    one = edge_feature("h", (-12.7, 0, 12.7), CORNER, part)
    two = edge_feature("v", (12.7, 0, -12.7), CORNER, part)
    for edge in (one, two):
        assert edge.length_mm == pytest.approx(25.4)
        radius = np.linalg.norm(edge.key_points_mm, axis=1)
        np.testing.assert_allclose(radius, 12.7 * math.sqrt(2))
        (piece,) = edge.sight_pieces()
        assert piece.facing == "any"
        assert len(piece.planes) == 2


def test_planes_of_a_convex_edge_pass_through_it_and_look_outwards(
    part: TriangleMesh,
) -> None:
    edge = edge_feature("h", (-12.7, 0, 12.7), CORNER, part)
    (piece,) = edge.sight_pieces()
    for plane in piece.planes:
        np.testing.assert_allclose(edge.key_points_mm @ plane[:3], plane[3], atol=1e-12)
    assert {tuple(n) for n in np.round(piece.planes[:, :3])} == {(0, 0, 1), (0, -1, 0)}


def test_a_reflex_edge_needs_both_faces(part: TriangleMesh) -> None:
    edge = edge_feature("floor", (-12.7, 0, -12.7), (12.7, 0, -12.7), part)
    assert edge.sight_pieces()[0].facing == "all"
    assert len(edge.sight_pieces()[0].planes) == 2


def test_part_of_an_edge_is_an_edge(part: TriangleMesh) -> None:
    edge = edge_feature("half", (-5, 0, 12.7), (6, 0.004, 12.695), part)
    np.testing.assert_allclose(edge.key_points_mm[:, 1:], [[0, 12.7]] * 2, atol=1e-12)
    assert edge.length_mm == pytest.approx(11, abs=1e-5)


def test_ends_near_a_vertex_become_the_vertex(part: TriangleMesh) -> None:
    edge = edge_feature("h", (-12.693, 0.003, 12.7), (12.706, 0, 12.695), part)
    np.testing.assert_array_equal(edge.start_mm, [-12.7, 0, 12.7])
    np.testing.assert_array_equal(edge.end_mm, CORNER)


def test_a_line_across_a_face_must_have_that_face_looking(part: TriangleMesh) -> None:
    line = edge_feature("scribe", (-3, 4, 12.7), (5, 20, 12.695), part)
    (piece,) = line.sight_pieces()
    assert piece.facing == "all"
    np.testing.assert_allclose(piece.planes, [[0, 0, 1, 12.7]])
    np.testing.assert_allclose(piece.vertices_mm[:, 2], 12.7)


def test_an_edge_may_run_on_over_a_face_but_not_over_air(part: TriangleMesh) -> None:
    on = edge_feature("rim and plate", (9, 58, 57.15), (85, 58, 57.15), part)
    assert [piece.facing for piece in on.sight_pieces()] == ["any", "all"]
    assert on.length_mm == pytest.approx(76)
    with pytest.raises(FeatureError, match="not on the part"):
        edge_feature("over the slit", (62, -6, 57.15), (62, 58, 57.15), part)


def test_an_open_edge_has_no_planes() -> None:
    square = TriangleMesh(
        np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
        np.zeros(2, np.int64),
    )
    edge = edge_feature("border", (0, 0, 0), (10, 0, 0), square)
    assert len(edge.sight_pieces()[0].planes) == 0
    diagonal = edge_feature("diagonal", (0, 0, 0), (10, 10, 0), square)
    np.testing.assert_allclose(diagonal.sight_pieces()[0].planes, [[0, 0, 1, 0]])


def test_points_take_the_rule_of_what_they_lie_on(part: TriangleMesh) -> None:
    def rule(at: tuple[float, float, float]) -> tuple[str, int]:
        piece = point_feature("p", at, part).sight_pieces()[0]
        return piece.facing, len(piece.planes)

    assert rule(CORNER) == ("any", 3)
    assert rule((12.7, 0, 0)) == ("any", 2)
    assert rule((12.7, 0, -12.7)) == ("all", 3)
    assert rule((0, 5, 12.7)) == ("all", 1)


def test_a_face_is_found_from_a_point_with_its_holes(part: TriangleMesh) -> None:
    face = face_feature_at("top", (-90, 5, 57.15), part)
    assert face.area_mm2 == pytest.approx(203.2**2 - 53 * 64 - 23 * 8 - 38.5 * 36.05)
    assert sorted(len(ring) for ring in face.holes_mm) == [4, 8]
    assert len(face.outer_mm) == 4
    sides = np.linalg.norm(np.diff(face.segments_mm, axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(sides, 203.2)


def test_a_drawn_concave_face_is_split_into_convex_pieces(part: TriangleMesh) -> None:
    corners = [(-10, 5, 12.7), (5, 5, 12.7), (5, 20, 12.7), (0, 10, 12.7)]
    face = face_feature(
        "L", corners, part, holes_mm=[[(2, 6, 12.7), (3, 6, 12.7), (3, 7, 12.7)]]
    )
    total = 0.0
    for piece in face.sight_pieces():
        ring = piece.vertices_mm[:, :2]
        step = np.roll(ring, -1, axis=0) - ring
        after = np.roll(step, -1, axis=0)
        assert (step[:, 0] * after[:, 1] - step[:, 1] * after[:, 0] > 0).all()
        x, y = ring.T
        total += float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    assert total == pytest.approx(face.area_mm2) == pytest.approx(75 - 0.5)
    np.testing.assert_allclose(face.normal, [0, 0, 1], atol=1e-12)


def test_a_face_drawn_clockwise_still_looks_outwards(part: TriangleMesh) -> None:
    corners = [(-10, 5, 12.7), (0, 10, 12.7), (5, 5, 12.7)]
    np.testing.assert_allclose(face_feature("c", corners, part).normal, [0, 0, 1])


def test_a_scene_refuses_two_features_of_one_name(part: TriangleMesh) -> None:
    edge = edge_feature("e", (-12.7, 0, 12.7), CORNER, part)
    assert len(Scene(part, (part,), (edge,)).occluders.faces) == 2 * len(part.faces)
    with pytest.raises(ValueError, match="differ"):
        Scene(part, (), (edge, edge))


NAN = float("nan")


@pytest.mark.parametrize(
    ("start", "end", "told"),
    [
        ((0, 0, 12.7), (0, 0, 12.7), "no length"),
        ((0, 0, 12.7), (0.004, 0, 12.7), "no length"),
        ((NAN, 0, 12.7), (1, 0, 12.7), "finite"),
        ((0, 0, 12.7), (math.inf, 0, 12.7), "finite"),
        ((0, 0), (1, 0), "shape"),
        ((0, 0, "x"), (1, 0, 0), "float"),
        ((0, 5, 0), (5, 5, 0), "inside the solid"),
        ((-12.7, 0.02, 12.68), (12.7, 0.02, 12.68), "inside the solid"),
        ((-12.7, 0, 12.72), (12.7, 0, 12.72), "not on the part"),
        ((-12.7, 0, 12.7), (12.75, 0, 12.7), "not on the part"),
        ((0, 0, 500), (25.4, 0, 500), "not on the part"),
    ],
)
def test_an_edge_that_is_not_there_is_refused(
    part: TriangleMesh, start: object, end: object, told: str
) -> None:
    with pytest.raises(FeatureError, match=told) as caught:
        edge_feature("bad", start, end, part)  # type: ignore[arg-type]
    assert "'bad'" in str(caught.value)
    assert caught.value.hint


def test_the_distance_to_the_part_is_told(part: TriangleMesh) -> None:
    with pytest.raises(FeatureError, match=r"1\.3 mm from the nearest surface"):
        edge_feature("far", (-12.7, 0, 14), (12.7, 0, 14), part)


@pytest.mark.parametrize(
    ("corners", "told"),
    [
        ([(0, 5, 12.7), (5, 5, 12.7)], "no area"),
        ([(0, 5, 12.7), (5, 5, 12.7), (10, 5, 12.7)], "no area"),
        ([(0, 5, 12.7), (5, 5, 12.7), (5, 10, 12.6), (0, 10, 12.7)], "not plane"),
        ([(-9, 2, 12.7), (9, 9, 12.7), (9, 2, 12.7), (-9, 8, 12.7)], "cross|no area"),
        ([(0, 5, 13), (5, 5, 13), (5, 10, 13)], "not on the part"),
        ([(0, 5, 0), (5, 5, 0), (5, 10, 0)], "inside the solid"),
        ([(-90, 5, 57.15), (95, 5, 57.15), (95, 6, 57.15)], "not on the part"),
        ([(0, NAN, 12.7), (5, 5, 12.7), (5, 10, 12.7)], "finite"),
    ],
)
def test_a_face_that_is_not_there_is_refused(
    part: TriangleMesh, corners: list[tuple[float, float, float]], told: str
) -> None:
    with pytest.raises(FeatureError, match=told):
        face_feature("bad", corners, part)


def test_a_feature_needs_a_part_with_a_surface() -> None:
    none = TriangleMesh(
        np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    )
    with pytest.raises(FeatureError, match="no surface"):
        point_feature("p", (0, 0, 0), none)


@dataclass(frozen=True)
class Wanted:
    id: str
    centre_mm: tuple[float, float, float]
    axis: tuple[float, float, float]
    diameter_mm: float


def test_a_hole_where_there_is_none_is_refused(part: TriangleMesh) -> None:
    with pytest.raises(FeatureError, match="has no round hole"):
        hole_feature_at(Wanted("bore", (0, 0, 0), (0, 0, 1), 10), part)
    with pytest.raises(FeatureError, match="axis"):
        hole_feature_at(Wanted("bore", (0, 0, 0), (0, 0, 0), 10), part)
