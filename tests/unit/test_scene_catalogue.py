"""Edges, holes and faces found on parts whose features are known."""

from __future__ import annotations

import json
import math
import struct
from collections import Counter, defaultdict
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh

from mvp.errors import FeatureError
from mvp.geometry import TriangleMesh, face_groups, load_part
from mvp.scene import FeatureCatalogue, HoleFeature, cad_edges, extract_features

NIST = Path(__file__).parents[2].parent / "shared/data/nist_step"
CTC_01 = (
    Path(__file__).parents[2] / "cell_configs/virtual/parts/nist_ctc_01_asme1_rd.stp"
)
Solid = manifold3d.Manifold


def as_mesh(solid: Solid, order_seed: int | None = None) -> TriangleMesh:
    raw = solid.to_mesh64()
    vertices = np.asarray(raw.vert_properties)[:, :3]
    faces = np.asarray(raw.tri_verts, dtype=np.int64)
    if order_seed is not None:
        rng = np.random.default_rng(order_seed)
        faces = faces[rng.permutation(len(faces))]
        faces = np.roll(faces, 1, axis=1)
    bare = TriangleMesh(vertices, faces, np.zeros(len(faces), np.int64), "plate")
    return TriangleMesh(vertices, faces, face_groups(bare), "plate")


def drill(radius: float, x: float, y: float, low: float, high: float) -> Solid:
    return Solid.cylinder(high - low, radius, radius, 48).translate((x, y, low))


def plate() -> Solid:
    """A 100 x 60 x 10 plate: through 12, blind 8 x 6 deep, counterbore, pin, boss."""
    solid = Solid.cube((100, 60, 10))
    solid -= drill(6, 20, 20, -1, 11)
    solid -= drill(4, 50, 20, 4, 11)
    solid -= drill(3, 75, 40, -1, 11)
    solid -= drill(5, 75, 40, 7, 11)
    solid -= drill(7, 30, 42, 5, 11)
    solid += drill(2, 30, 42, 4, 14)
    return solid + drill(5, 50, 45, 9, 18)


@pytest.fixture(scope="module")
def catalogue() -> FeatureCatalogue:
    return extract_features(as_mesh(plate()))


def hole(catalogue: FeatureCatalogue, at: tuple[float, float, float]) -> HoleFeature:
    found = [h for h in catalogue.holes if np.allclose(h.centre_mm, at, atol=1e-6)]
    assert len(found) == 1
    return found[0]


def test_a_through_hole_has_a_rim_on_each_side(catalogue: FeatureCatalogue) -> None:
    for z, axis in ((10.0, 1.0), (0.0, -1.0)):
        rim = hole(catalogue, (20, 20, z))
        assert rim.through
        assert rim.diameter_mm == pytest.approx(12)
        assert rim.depth_mm == pytest.approx(10)
        np.testing.assert_allclose(rim.axis, [0, 0, axis], atol=1e-12)


def test_a_blind_hole_has_a_depth_and_one_rim(catalogue: FeatureCatalogue) -> None:
    rim = hole(catalogue, (50, 20, 10))
    assert not rim.through
    assert rim.depth_mm == pytest.approx(6)
    assert not [h for h in catalogue.holes if np.allclose(h.centre_mm, (50, 20, 4))]


def test_a_stepped_hole_shows_both_steps(catalogue: FeatureCatalogue) -> None:
    assert hole(catalogue, (75, 40, 10)).diameter_mm == pytest.approx(10)
    inner = hole(catalogue, (75, 40, 7))
    assert inner.diameter_mm == pytest.approx(6)
    assert inner.through
    assert inner.depth_mm == pytest.approx(7)


def test_a_boss_is_no_hole(catalogue: FeatureCatalogue) -> None:
    assert not [h for h in catalogue.holes if np.allclose(h.centre_mm[:2], (50, 45))]
    assert len(catalogue.holes) == 7


def test_the_polygon_error_is_the_sagitta_of_its_sides(
    catalogue: FeatureCatalogue,
) -> None:
    rim = hole(catalogue, (20, 20, 10))
    assert rim.polygon_error_mm == pytest.approx(6 * (1 - math.cos(math.pi / 48)))
    assert rim.residual_mm < 1e-9


def test_an_open_mouth_is_one_polygon_and_one_with_a_pin_is_its_chords(
    catalogue: FeatureCatalogue,
) -> None:
    assert len(hole(catalogue, (20, 20, 10)).sight_pieces()) == 1
    pinned = hole(catalogue, (30, 42, 10))
    assert len(pinned.sight_pieces()) == 48
    assert all(len(piece.vertices_mm) == 2 for piece in pinned.sight_pieces())


def test_a_block_has_its_twelve_edges_whatever_is_drilled_into_it(
    catalogue: FeatureCatalogue,
) -> None:
    lengths = Counter(np.round(catalogue.edges.length_mm, 6).tolist())
    assert lengths == {100.0: 4, 60.0: 4, 10.0: 4}
    assert catalogue.edges.convex.all()


def test_face_areas_and_holes_agree_with_the_drawing(
    catalogue: FeatureCatalogue,
) -> None:
    top = max(
        (catalogue.feature(f"F{i + 1}") for i in range(len(catalogue.patches))),
        key=lambda face: (round(face.key_points_mm[:, 2].min()), 0),
    )
    assert top.key_points_mm[:, 2].min() == pytest.approx(18)  # the boss
    entries = [e for e in catalogue.entries if e.kind == "face"]
    upper = next(
        e for e in entries if e.direction[2] > 0.9 and abs(e.position_mm[2] - 10) < 1e-9
    )
    sides = 48 / 2 * math.sin(2 * math.pi / 48)
    expected = 6000 - sides * (36 + 16 + 25 + 49 + 25)
    assert upper.size == pytest.approx(expected)
    face = catalogue.feature(upper.id)
    assert len(face.outline_mm) == 1 + 5


def test_pieces_of_a_face_cover_it_and_fill_only_empty_holes(
    catalogue: FeatureCatalogue,
) -> None:
    entries = [e for e in catalogue.entries if e.kind == "face"]
    upper = next(
        e for e in entries if e.direction[2] > 0.9 and abs(e.position_mm[2] - 10) < 1e-9
    )
    pieces = catalogue.feature(upper.id).sight_pieces()
    area = sum(
        abs(np.cross(p.vertices_mm, np.roll(p.vertices_mm, -1, axis=0)).sum(axis=0)[2])
        / 2
        for p in pieces
    )
    sides = 48 / 2 * math.sin(2 * math.pi / 48)
    # Boss and pinned hole stay open, the three empty holes are covered.
    assert area == pytest.approx(6000 - sides * (25 + 49))


def test_ids_do_not_depend_on_the_order_of_the_triangles() -> None:
    first = extract_features(as_mesh(plate()))
    second = extract_features(as_mesh(plate(), order_seed=3))
    for a, b in zip(first.entries, second.entries, strict=True):
        assert (a.id, a.kind) == (b.id, b.kind)
        assert a.size == pytest.approx(b.size)
        np.testing.assert_allclose(a.position_mm, b.position_mm, atol=1e-6)


def test_a_missing_triangle_opens_edges_but_loses_no_other_feature() -> None:
    whole = as_mesh(plate())
    kept = np.arange(len(whole.faces)) != np.argmax(whole.areas_mm2)
    torn = TriangleMesh(whole.vertices_mm, whole.faces[kept], whole.face_ids[kept])
    edges = cad_edges(torn)
    assert 0 < edges.boundary.sum() <= 3 + 2
    assert len(extract_features(torn).holes) >= 6


def test_a_hole_in_a_bare_sheet_is_found() -> None:
    ring = trimesh.creation.annulus(r_min=5, r_max=20, height=1, sections=48)
    faces = ring.faces[np.asarray(ring.face_normals)[:, 2] > 0.9]
    sheet = TriangleMesh(ring.vertices, faces, np.zeros(len(faces), np.int64))
    holes = extract_features(sheet).holes
    assert len(holes) == 1
    assert holes[0].diameter_mm == pytest.approx(10)
    assert holes[0].through


def test_a_hexagonal_socket_is_not_a_round_hole() -> None:
    block = Solid.cube((30, 30, 10)) - Solid.cylinder(20, 5, 5, 6).translate(
        (15, 15, 5)
    )
    found = extract_features(as_mesh(block))
    assert not found.holes
    assert len(found.edges) == 12 + 6 * 3


def test_an_unknown_id_is_answered_with_what_there_is(
    catalogue: FeatureCatalogue,
) -> None:
    with pytest.raises(FeatureError, match="E1-E12, H1-H7") as caught:
        catalogue.feature("E99")
    assert "mvp-cell features" in caught.value.hint
    for ref in ("", "E0", "X1", "E-1", "H1.5", "E²"):
        with pytest.raises(FeatureError):
            catalogue.feature(ref)


def test_a_feature_keeps_the_name_that_the_task_gives_it(
    catalogue: FeatureCatalogue,
) -> None:
    for ref in ("E1", "H1", "F1"):
        assert catalogue.feature(ref, id="mine").id == "mine"


def brep_cylinders(path: Path) -> Counter[float]:
    """Diameters of the full cylinders in a STEP file, from its own surfaces."""
    import cascadio

    glb = cascadio.load(path.read_bytes(), include_brep=True, tol_linear=0.1)
    length = struct.unpack_from("<I", glb, 12)[0]
    primitive = json.loads(glb[20 : 20 + length])["meshes"][0]["primitives"][0]
    turn: dict[tuple[object, ...], float] = defaultdict(float)
    for face in primitive["extensions"]["TM_brep_faces"]["faces"]:
        if face["type"] == "cylinder":
            axis = np.array(face["axis"])
            axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
            foot = np.array(face["origin"]) - axis * (axis @ face["origin"])
            low, high = face["extent_angle"]
            key = (*np.round(foot * 1e3, 2) + 0.0, round(face["radius"] * 2e3, 2))
            turn[key] += high - low
    full = [key[-1] for key, angle in turn.items() if abs(angle - 2 * np.pi) < 0.05]
    return Counter(full)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["nist_ctc_01_asme1_rd", "nist_ftc_09_asme1_rd"])
def test_nist_holes_are_the_full_cylinders_of_the_b_rep(
    name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = CTC_01 if CTC_01.stem == name else NIST / f"{name}.stp"
    if not path.exists():
        pytest.skip(f"{name} is not in ../shared/data")
    holes = extract_features(load_part(path).mesh).holes
    rims = Counter(round(hole.diameter_mm, 2) for hole in holes)
    for diameter, count in brep_cylinders(path).items():
        blind = sum(
            not hole.through for hole in holes if round(hole.diameter_mm, 2) == diameter
        )
        assert rims.pop(diameter) == 2 * count - blind
    # What is left are the wide ends of countersinks.
    assert sum(rims.values()) == (4 if "ftc" in name else 0)
    capfd.readouterr()
