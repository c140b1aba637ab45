"""Files of every kind come in as the same part, in mm."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mvp.errors import GeometryError, OutputError
from mvp.geometry import TriangleMesh, load_part, planar_patches, write_stl

NIST = Path(__file__).parents[2].parent / "shared/data/nist_step"
CTC_01 = (
    Path(__file__).parents[2] / "cell_configs/virtual/parts/nist_ctc_01_asme1_rd.stp"
)


def box_mesh(size: tuple[float, float, float] = (20.0, 30.0, 40.0)) -> TriangleMesh:
    box = trimesh.creation.box(size)
    return TriangleMesh(box.vertices, box.faces, np.zeros(12, np.int64), "box")


def written(folder: Path, kind: str, size: tuple[float, float, float]) -> Path:
    path = folder / f"box.{kind}"
    trimesh.creation.box(size).export(path)
    return path


@pytest.mark.parametrize("kind", ["stl", "obj", "ply"])
def test_mesh_formats_without_units_are_read_as_mm_and_say_so(
    tmp_path: Path, kind: str
) -> None:
    part = load_part(written(tmp_path, kind, (20, 30, 40)))
    np.testing.assert_allclose(part.mesh.bounds.size_mm, [20, 30, 40], rtol=1e-6)
    assert (part.units, part.units_source) == ("mm", "guessed")
    assert part.healing.watertight
    assert any("guess" in line for line in part.lines())


def test_a_glb_is_in_metres(tmp_path: Path) -> None:
    part = load_part(written(tmp_path, "glb", (0.02, 0.03, 0.04)))
    np.testing.assert_allclose(part.mesh.bounds.size_mm, [20, 30, 40], rtol=1e-6)
    assert (part.units, part.units_source) == ("m", "file")


@pytest.mark.parametrize(
    ("units", "factor"), [("mm", 1.0), ("in", 25.4), ("m", 1000.0)]
)
def test_given_units_scale_the_part(tmp_path: Path, units: str, factor: float) -> None:
    path = written(tmp_path, "stl", (2, 3, 4))
    part = load_part(path, units=units)  # type: ignore[arg-type]
    np.testing.assert_allclose(
        part.mesh.bounds.size_mm, np.array([2, 3, 4]) * factor, rtol=1e-6
    )
    assert part.units_source == "given"


def test_a_suspicious_size_is_told_with_what_it_would_be_in_inches(
    tmp_path: Path,
) -> None:
    part = load_part(written(tmp_path, "stl", (2, 3, 4)))
    assert len(part.warnings) == 1
    assert "101.6 mm if the file is in in" in part.warnings[0]
    assert not load_part(written(tmp_path, "stl", (20, 30, 40))).warnings


def test_a_text_stl_keeps_every_digit_and_its_units(tmp_path: Path) -> None:
    mesh = box_mesh((20.1, 30.2, 1 / 3 + 40))
    write_stl(mesh, tmp_path / "box.stl")
    part = load_part(tmp_path / "box.stl")
    assert part.units_source == "file"
    assert set(part.mesh.vertices_mm.ravel()) == set(mesh.vertices_mm.ravel())


def test_an_stl_of_a_part_with_any_name_is_written(tmp_path: Path) -> None:
    write_stl(replace(box_mesh(), name="Gehäuse"), tmp_path / "box.stl")
    assert len(load_part(tmp_path / "box.stl").mesh.faces) == 12
    assert [file.name for file in tmp_path.iterdir()] == ["box.stl"]


def test_an_stl_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "box.stl").mkdir()
    with pytest.raises(OutputError, match=r"box\.stl"):
        write_stl(box_mesh(), tmp_path / "box.stl")
    assert [file.name for file in tmp_path.iterdir()] == ["box.stl"]


def test_a_step_file_in_mm_has_the_published_size_and_is_a_closed_solid() -> None:
    part = load_part(CTC_01)
    np.testing.assert_allclose(part.mesh.bounds.size_mm, [800, 450, 150], atol=1e-6)
    assert (part.units, part.units_source) == ("mm", "file")
    assert part.healing.watertight
    assert len(np.unique(part.mesh.face_ids)) == 139


def test_corners_of_planar_step_faces_lie_on_their_planes_in_double_precision() -> None:
    mesh = load_part(CTC_01).mesh
    for face in np.unique(mesh.face_ids):
        members = np.flatnonzero(mesh.face_ids == face)
        normals = mesh.normals[members]
        if (normals @ normals[0]).min() > 1 - 1e-9:
            largest = members[np.argmax(mesh.areas_mm2[members])]
            heights = mesh.triangles_mm[members] @ mesh.normals[largest]
            assert np.ptp(heights) < 1e-9


def test_a_step_file_in_inches_is_converted_once() -> None:
    path = NIST / "nist_ftc_09_asme1_rd.stp"
    if not path.exists():
        pytest.skip("NIST FTC-09 is not in ../shared/data")
    part = load_part(path)
    np.testing.assert_allclose(part.mesh.bounds.size_mm, [190.5, 3.03784, 279.4])
    assert (part.units, part.units_source) == ("in", "file")
    assert part.healing.watertight
    wrong = load_part(path, units="mm")
    np.testing.assert_allclose(
        wrong.mesh.bounds.size_mm, [7.5, 0.1196, 11.0], rtol=1e-4
    )


def test_the_healing_report_is_plain_data() -> None:
    part = load_part(CTC_01)
    document = json.loads(json.dumps(part.to_json(), allow_nan=False))
    assert document["healing"]["bodies"] == 1
    assert document["size_mm"] == pytest.approx([800, 450, 150])


def test_planar_patches_of_a_box_are_its_six_sides() -> None:
    assert len(np.unique(planar_patches(box_mesh()))) == 6


def bad(content: bytes, name: str) -> object:
    return pytest.param(content, name, id=name)


BINARY_CUT = b"\0" * 80 + struct.pack("<I", 7) + b"\0" * 60
NAN_STL = (
    b"\0" * 80
    + struct.pack("<I", 1)
    + struct.pack("<12f", *([float("nan")] * 12))
    + b"\0\0"
)
FLAT_STL = b"solid s\n" + b"facet\n" + b"vertex 1 1 1\n" * 3 + b"endfacet\nendsolid\n"


@pytest.mark.parametrize(
    ("content", "name"),
    [
        bad(b"", "empty.stl"),
        bad(b"   \n", "blank.stl"),
        bad(b"hello, this is no mesh at all" * 9, "text.stl"),
        bad(b"solid s\nendsolid s\n", "no_facets.stl"),
        bad(b"solid s\nvertex 1 2 x\nvertex 1 2 3\nvertex 3 2 1\n", "letters.stl"),
        bad(b"solid s\nvertex 1 2 3\nvertex 3 2 1\n", "odd_vertices.stl"),
        bad(BINARY_CUT, "cut_short.stl"),
        bad(NAN_STL, "nan.stl"),
        bad(FLAT_STL, "only_slivers.stl"),
        bad(b"", "empty.step"),
        bad(b"this is no step file", "text.step"),
        bad(b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\n", "hollow.step"),
        bad(b"ISO-10303-21;\nHEADER; garbage", "broken.stp"),
        bad(b"S      1\nnothing", "broken.igs"),
        bad(b"not a ply", "text.ply"),
        bad(b"v 1 2 3\n", "points.obj"),
        bad(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "missing_vertex.obj"),
        bad(b"v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", "nan.obj"),
        bad(b"glTF nonsense", "broken.glb"),
        bad(b"anything", "part.docx"),
        bad(b"anything", "no_extension"),
    ],
)
def test_a_file_that_is_no_part_is_refused_with_a_hint(
    tmp_path: Path, content: bytes, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(GeometryError) as caught:
        load_part(path)
    assert name in str(caught.value)
    assert caught.value.hint
    assert caught.value.exit_code == 2
    assert capfd.readouterr() == ("", "")


def test_a_missing_file_and_a_folder_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match="no such file"):
        load_part(tmp_path / "none.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(GeometryError, match="cannot be read"):
        load_part(tmp_path / "folder.stl")


def test_a_huge_mesh_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.stl"
    path.write_bytes(b"\0" * 80 + struct.pack("<I", 4_000_000))
    with pytest.raises(
        GeometryError, match="4000000 triangles are more than the limit"
    ):
        load_part(path)
    with pytest.raises(
        GeometryError, match="12 triangles are more than the limit of 11"
    ):
        load_part(written(tmp_path, "ply", (20, 30, 40)), max_triangles=11)
