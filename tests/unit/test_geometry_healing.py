"""What healing repairs, what it reports, and what it leaves alone."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mvp.geometry import TriangleMesh, edge_table, healed


def as_mesh(shape: trimesh.Trimesh) -> TriangleMesh:
    ids = np.zeros(len(shape.faces), np.int64)
    return TriangleMesh(shape.vertices, shape.faces, ids)


def soup(shape: trimesh.Trimesh) -> TriangleMesh:
    """The same triangles, none sharing a vertex."""
    corners = np.asarray(shape.triangles).reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    return TriangleMesh(corners, faces, np.zeros(len(faces), np.int64))


def volume(mesh: TriangleMesh) -> float:
    return float(trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False).volume)


def sphere() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=2, radius=10.0)


def test_a_soup_of_a_closed_body_becomes_watertight() -> None:
    mesh, report = healed(soup(sphere()))
    assert report.watertight
    assert report.bodies == 1
    assert report.vertices_merged == 3 * 320 - 162
    assert volume(mesh) == pytest.approx(sphere().volume)


def test_points_closer_than_a_tenth_of_a_micrometre_are_one() -> None:
    loose = soup(sphere())
    shaken = loose.vertices_mm + np.random.default_rng(1).uniform(
        -2e-5, 2e-5, loose.vertices_mm.shape
    )
    mesh, report = healed(TriangleMesh(shaken, loose.faces, loose.face_ids))
    assert report.watertight
    assert len(mesh.vertices_mm) == 162


def test_flipped_triangles_are_turned_back() -> None:
    mesh = as_mesh(sphere())
    wrong = np.random.default_rng(2).random(len(mesh.faces)) < 0.3
    faces = np.where(wrong[:, None], mesh.faces[:, ::-1], mesh.faces)
    fixed, report = healed(TriangleMesh(mesh.vertices_mm, faces, mesh.face_ids))
    assert report.faces_flipped == wrong.sum()
    assert report.watertight
    assert volume(fixed) == pytest.approx(sphere().volume)


def test_a_body_that_is_inside_out_is_turned_as_a_whole() -> None:
    mesh = as_mesh(sphere())
    fixed, report = healed(
        TriangleMesh(mesh.vertices_mm, mesh.faces[:, ::-1], mesh.face_ids)
    )
    assert report.faces_flipped == len(mesh.faces)
    assert volume(fixed) > 0


def test_a_cavity_keeps_looking_inwards() -> None:
    cavity = trimesh.creation.icosphere(subdivisions=2, radius=4.0)
    cavity.invert()
    hollow = trimesh.util.concatenate([sphere(), cavity])
    mesh, report = healed(as_mesh(hollow))
    assert report.faces_flipped == 0
    assert report.bodies == 2
    assert volume(mesh) == pytest.approx(hollow.volume)


def test_duplicates_and_slivers_are_dropped_and_counted() -> None:
    mesh = as_mesh(trimesh.creation.box((10, 10, 10)))
    vertices = np.vstack([mesh.vertices_mm, [[5, 5, 0.0]]])
    faces = np.vstack([mesh.faces, mesh.faces[:3, [1, 2, 0]], [[0, 1, 1]]])
    ids = np.zeros(len(faces), np.int64)
    fixed, report = healed(TriangleMesh(vertices, faces, ids))
    assert (report.duplicates_dropped, report.degenerate_dropped) == (3, 1)
    assert len(fixed.faces) == 12
    assert report.watertight


def test_an_open_shell_is_reported_not_refused() -> None:
    mesh = as_mesh(sphere())
    kept = np.arange(5, len(mesh.faces))
    fixed, report = healed(
        TriangleMesh(mesh.vertices_mm, mesh.faces[kept], mesh.face_ids[kept])
    )
    assert not report.watertight
    assert report.open_edges == int(edge_table(fixed).boundary.sum()) > 0
    assert any("open edges" in line for line in report.lines())


def test_two_boxes_that_share_an_edge_are_non_manifold_there() -> None:
    a = trimesh.creation.box((10, 10, 10))
    b = trimesh.creation.box((10, 10, 10))
    b.apply_translation((10, 10, 0))
    _, report = healed(as_mesh(trimesh.util.concatenate([a, b])))
    assert report.non_manifold_edges == 1
    assert not report.watertight


def test_a_moebius_strip_is_left_as_it_is() -> None:
    count = 24
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    rim = []
    for side in (-1.0, 1.0):
        radius = 10 + side * np.cos(turn / 2)
        rim.append(
            np.stack(
                [radius * np.cos(turn), radius * np.sin(turn), side * np.sin(turn / 2)],
                1,
            )
        )
    faces = []
    for i in range(count):
        a, b, c, d = i, (i + 1) % count, count + i, count + (i + 1) % count
        if i == count - 1:
            b, d = d, b
        faces += [[a, b, c], [b, d, c]]
    mesh = TriangleMesh(np.vstack(rim), np.array(faces), np.zeros(2 * count, np.int64))
    _, report = healed(mesh)
    assert report.triangles == 2 * count
    assert not report.watertight


def test_the_edge_table_of_a_box_has_twelve_right_angles() -> None:
    mesh = as_mesh(trimesh.creation.box((1, 2, 3)))
    table = edge_table(mesh)
    assert table.regular.all()
    assert np.isclose(table.angle_rad, np.pi / 2).sum() == 12
    assert np.isclose(table.angle_rad, 0).sum() == 6
    inverted = TriangleMesh(mesh.vertices_mm, mesh.faces[:, ::-1], mesh.face_ids)
    assert np.isclose(edge_table(inverted).angle_rad, -np.pi / 2).sum() == 12
