"""Rims of holes, corners and faces measured in pictures of a drilled plate."""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d
import numpy as np
import pytest

from mvp.geometry import FloatArray, TriangleMesh, planar_patches
from mvp.imaging import (
    Illumination,
    RenderBody,
    RenderScene,
    Requirement,
    ViewExpectation,
    ViewTolerance,
    expect_view,
    expose,
    render,
    verify_view,
)
from mvp.scene import (
    FaceFeature,
    PointFeature,
    cad_edges,
    face_feature_at,
    point_feature,
)
from tools.picture_trials import A_MM, C_MM, PAPER, intrinsics_of, look_along, metered_s

CENTRE, RADIUS = np.array([5.0, 3.0, 5.0]), 8.0
TILTED = np.array([60.0, -80.0, 150.0])
D_MM = 13.4


@dataclass(frozen=True)
class Rim:
    """A hole given by its circle alone."""

    id: str = "bore"
    kind: str = "hole"

    @property
    def outline_mm(self) -> tuple[FloatArray, ...]:
        turn = np.linspace(0, 2 * np.pi, 129)
        circle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
        return (CENTRE + RADIUS * circle,)

    @property
    def key_points_mm(self) -> FloatArray:
        return self.outline_mm[0]


def plate(radius: float = RADIUS) -> TriangleMesh:
    solid = manifold3d.Manifold.cube((60, 50, 10), True)
    bore = manifold3d.Manifold.cylinder(30, radius, radius, 128, True)
    mesh = (solid - bore.translate((5, 3, 0))).to_mesh64()
    faces = np.asarray(mesh.tri_verts, dtype=np.int64)
    bare = TriangleMesh(
        np.asarray(mesh.vert_properties)[:, :3], faces, np.zeros(len(faces), np.int64)
    )
    return TriangleMesh(bare.vertices_mm, faces, planar_patches(bare), "plate")


@pytest.fixture(scope="module")
def mesh() -> TriangleMesh:
    return plate()


def expectation(
    mesh: TriangleMesh, features: list[Rim | PointFeature | FaceFeature]
) -> ViewExpectation:
    return expect_view(
        features,  # type: ignore[arg-type]
        mesh,
        cad_edges(mesh),
        look_along(TILTED, -TILTED),
        f_mm=12.5,
        d_mm=D_MM,
        a_mm=A_MM,
        e_mm=0.0,
        intrinsics=intrinsics_of(PAPER),
        c_mm=C_MM,
        tolerance=ViewTolerance(0.5, 0.1, 0.02),
        requirements={"bore": Requirement(0.5, 1.0)},
        light=Illumination(),
    )


def picture(mesh: TriangleMesh, planned: ViewExpectation, *, noise: bool) -> np.ndarray:
    image = render(
        RenderScene([RenderBody(mesh)]),
        look_along(TILTED, -TILTED),
        d_mm=D_MM,
        f_mm=12.5,
        a_mm=A_MM,
        intrinsics=intrinsics_of(PAPER),
    )
    rng = np.random.default_rng(4) if noise else None
    return np.asarray(expose(image, metered_s(image, planned), rng=rng))


@pytest.mark.parametrize(("noise", "error_px"), [(False, 0.1), (True, 0.2)])
def test_both_axes_of_a_rim_are_measured(
    mesh: TriangleMesh, noise: bool, error_px: float
) -> None:
    planned = expectation(mesh, [Rim()])
    result = verify_view(picture(mesh, planned, noise=noise), 255.0, planned)
    assert result.verdict == "pass"
    hole = result.holes[0]
    assert hole.measured_axes_px == pytest.approx(hole.predicted_axes_px, abs=error_px)
    assert hole.offset_px is not None
    assert hole.offset_px < 0.1
    assert hole.visible_fraction > 0.9
    assert hole.detail_px == pytest.approx(planned.rims[0].detail_px, rel=0.01)


def test_a_bore_of_another_size_is_measured_as_it_is(mesh: TriangleMesh) -> None:
    planned = expectation(mesh, [Rim()])
    result = verify_view(picture(plate(8.25), planned, noise=True), 255.0, planned)
    hole = result.holes[0]
    assert hole.measured_px is not None
    assert hole.predicted_px == pytest.approx(planned.rims[0].axes_px[0])
    assert hole.measured_px / hole.predicted_px == pytest.approx(8.25 / 8, abs=0.006)
    assert result.verdict == "fail"
    assert result.cause == "shape"


def test_a_filled_bore_does_not_pass(mesh: TriangleMesh) -> None:
    planned = expectation(mesh, [Rim()])
    solid = plate(0.01)
    result = verify_view(picture(solid, planned, noise=True), 255.0, planned)
    assert result.verdict == "fail"


def test_a_corner_is_found_where_its_edges_cross(mesh: TriangleMesh) -> None:
    corner = point_feature("corner", (30, 25, 5), mesh)
    planned = expectation(mesh, [corner])
    result = verify_view(picture(mesh, planned, noise=True), 255.0, planned)
    assert result.verdict == "pass"
    assert result.points[0].offset_px is not None
    assert result.points[0].offset_px < 0.15


def test_a_face_is_measured_by_its_boundary(mesh: TriangleMesh) -> None:
    face = face_feature_at("side", (0, -25, 0), mesh)
    planned = expectation(mesh, [face])
    assert {e.feature for e in planned.feature_edges} == {"side"}
    result = verify_view(picture(mesh, planned, noise=True), 255.0, planned)
    assert len(result.edges) == 4
    for edge in result.edges:
        assert edge.measured_px == pytest.approx(edge.predicted_px, abs=0.5)
    assert result.verdict == "pass"
