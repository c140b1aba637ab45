"""Regions against the independent test of single view points, on real scenes."""

import sys
from pathlib import Path

import numpy as np
import pytest

from mvp.geometry import (
    Box,
    FeaturePiece,
    TriangleMesh,
    edge_table,
    load_part,
)
from mvp.scene import edge_feature, extract_features, paper_object
from mvp.visibility import exactly_visible, prepare, visibility_region

NIST = Path(__file__).parents[2].parent / "shared" / "data" / "nist_step"
PAPER_VIEWS = {
    "V_f": ([107.58, -231.43, 258.68], 8.4),
    "V_f1": ([197.10, 100.58, 330.45], 25.0),
    "V_f2": ([112.78, 110.49, 159.77], 17.7),
    "V_i": ([165.1, -279.4, 368.3], -0.1),
    "V_i1": ([228.6, 0.0, 368.3], 32.6),
    "V_i2": ([2.54, 2.54, 2.54], -2.5),
}


def paper_edges():
    mesh = paper_object()
    horizontal = edge_feature("horizontal", [-12.7, 0, 12.7], [12.7, 0, 12.7], mesh)
    vertical = edge_feature("vertical", [12.7, 0, -12.7], [12.7, 0, 12.7], mesh)
    return mesh, horizontal, vertical


def paper_case(_rng):
    mesh, horizontal, vertical = paper_edges()
    pieces = [*horizontal.pieces, *vertical.pieces]
    yield mesh, pieces, Box([-650.0] * 3, [650.0] * 3)


def nist_case(name, *, with_catalogue=False):
    """Four sharp edges; with the catalogue also two holes and two faces."""

    def cases(rng):
        path = NIST / name
        if not path.exists():
            pytest.skip(f"{path} is not here")
        mesh = load_part(path).mesh
        workspace = Box.around(mesh.vertices_mm, grow_mm=mesh.extent_mm / 2)
        table = edge_table(mesh)
        ends = mesh.vertices_mm[table.vertices]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        sharp = table.regular & (np.abs(table.angle_rad) > 0.4) & (length > 5)
        for row in rng.choice(np.flatnonzero(sharp), 4, replace=False):
            normals = mesh.normals[table.faces[row]]
            planes = np.column_stack([normals, normals @ ends[row, 0]])
            facing = "any" if table.angle_rad[row] > 0 else "all"
            yield mesh, [FeaturePiece(ends[row], planes, facing)], workspace
        if with_catalogue:
            catalogue = extract_features(mesh)
            for kind, count in (("H", catalogue.holes), ("F", catalogue.patches)):
                for number in rng.choice(len(count), 2, replace=False):
                    feature = catalogue.feature(f"{kind}{number + 1}")
                    yield mesh, list(feature.sight_pieces()), workspace

    return cases


def soup_case(rng):
    """Triangles of all sizes anywhere, features of all kinds anywhere."""
    for kind in ("point", "segment", "polygon", "segment"):
        count = int(rng.integers(5, 60))
        spread = rng.choice([5.0, 20.0, 60.0])
        corners = rng.uniform(-100, 100, (count, 1, 3))
        corners = corners + rng.normal(0, spread, (count, 3, 3))
        faces = np.arange(3 * count).reshape(-1, 3)
        mesh = TriangleMesh(corners.reshape(-1, 3), faces, np.arange(count))
        piece = FeaturePiece(some_piece(kind, rng))
        yield mesh, [piece], Box([-200.0] * 3, [200.0] * 3)


def some_piece(kind, rng):
    origin = rng.normal(0, 10, 3)
    if kind == "point":
        return origin[None]
    if kind == "segment":
        return origin + rng.normal(0, 10, (2, 3))
    turns = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 9))))
    u, v = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    return origin + 10 * (np.cos(turns)[:, None] * u + np.sin(turns)[:, None] * v)


def near_boundary(region, count, rng):
    """View points within 1 mm of the boundary, walls left out."""
    counted = ~region.on_wall
    area = region.mesh.areas_mm2[counted]
    chosen = rng.choice(counted.sum(), count, p=area / area.sum())
    share = rng.dirichlet([1, 1, 1], count)
    points = np.einsum("nk,nkd->nd", share, region.mesh.triangles_mm[counted][chosen])
    offset = rng.uniform(-1, 1, (count, 1))
    return points + offset * region.mesh.normals[counted][chosen]


def compare(mesh, pieces, workspace, count, rng):
    """Number of points, of those in the band, and of disagreements outside it."""
    region = visibility_region(prepare(mesh), pieces, workspace)
    points = rng.uniform(workspace.low_mm, workspace.high_mm, (count, 3))
    if not region.on_wall.all():
        points[: count // 2] = near_boundary(region, count // 2, rng)
    points = points[workspace.contains(points)]
    distance = region.signed_distance(points)
    band = 0.01 + 1e-6 * workspace.diagonal_mm
    differ = (distance > 0) != exactly_visible(mesh, pieces, points)
    inside_band = np.abs(distance) <= band
    return len(points), int(inside_band.sum()), int((differ & ~inside_band).sum())


CASES = {
    "paper": paper_case,
    "ctc_01": nist_case("nist_ctc_01_asme1_rd.stp"),
    "ftc_09": nist_case("nist_ftc_09_asme1_rd.stp"),
    "soup": soup_case,
}


FULL_CASES = {
    **CASES,
    "ctc_01": nist_case("nist_ctc_01_asme1_rd.stp", with_catalogue=True),
    "ftc_09": nist_case("nist_ftc_09_asme1_rd.stp", with_catalogue=True),
}


def agreement(name, cases_of, count, record_property):
    rng = np.random.default_rng(2026)
    cases = list(cases_of[name](rng))
    results = [compare(*case, count // len(cases), rng) for case in cases]
    total, banded, wrong = np.sum(results, axis=0)
    record_property("view points", int(total))
    record_property("share in band", float(banded / total))
    sys.stdout.write(
        f"\n{name}: {total} view points, {banded / total:.2%} in the band, "
        f"{wrong} disagreements outside it\n"
    )
    return wrong


@pytest.mark.parametrize("name", CASES)
def test_regions_agree_with_the_independent_test(name, record_property):
    assert agreement(name, CASES, 2_500, record_property) == 0


@pytest.mark.full
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", CASES)
def test_regions_agree_with_the_independent_test_on_many_view_points(
    name, record_property
):
    assert agreement(name, FULL_CASES, 25_000, record_property) == 0


def test_the_views_of_the_1995_experiments_lie_where_they_were_reported():
    mesh, horizontal, vertical = paper_edges()
    occluders, workspace = prepare(mesh), Box([-650.0] * 3, [650.0] * 3)
    points = np.array([point for point, _ in PAPER_VIEWS.values()])
    expected = np.array([distance for _, distance in PAPER_VIEWS.values()])
    pieces = [*horizontal.pieces, *vertical.pieces]
    region = visibility_region(occluders, pieces, workspace)
    distance = region.signed_distance(points)
    assert distance == pytest.approx(expected, abs=0.2)
    assert (exactly_visible(mesh, pieces, points) == (distance > 0)).all()
    assert distance[0] == distance[:3].min()
    alone = visibility_region(occluders, horizontal.pieces, workspace)
    assert alone.signed_distance(points[:1]) == pytest.approx(distance[:1])
