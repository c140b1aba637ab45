"""``mvp-cell features``: one document, one picture, one clear error."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.image import imread

from mvp.cell.features_document import FeaturesDocument
from mvp.cell.label_layout import Label, placed
from mvp.cell.places import bundled_root
from mvp.cli.features import features
from mvp.errors import GeometryError, OutputError, UsageError
from mvp.geometry import load_part, write_stl
from mvp.scene import paper_object

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def part(tmp_path: Path) -> Path:
    path = tmp_path / "object.stl"
    write_stl(paper_object(), path)
    return path


def test_the_document_is_the_only_thing_on_stdout_and_keeps_its_schema(
    part: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert features(part, as_json=True) == 0
    told = capsys.readouterr()
    document = FeaturesDocument.model_validate(json.loads(told.out))
    assert document.schema_ == "mvp-cell/features/1"
    assert document.part.size_mm == pytest.approx((203.2, 203.2, 76.2))
    ends = {(edge.from_mm, edge.to_mm) for edge in document.edges}
    assert ((-12.7, 0.0, 12.7), (12.7, 0.0, 12.7)) in ends
    assert ((12.7, 0.0, -12.7), (12.7, 0.0, 12.7)) in ends
    assert "203.2 x 203.2 x 76.2 mm" in told.err
    assert "72 straight edges" in told.err


def test_the_table_shows_the_largest_unless_all_are_wanted(
    part: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    features(part)
    few = capsys.readouterr().err
    features(part, every=True)
    assert "E72" not in few
    assert "E72" in capsys.readouterr().err


def test_the_picture_shows_the_part_and_labels_in_three_colours(
    part: Path, tmp_path: Path
) -> None:
    picture = tmp_path / "part.png"
    features(part, picture=picture)
    pixels = imread(picture)[..., :3]
    blue = (np.abs(pixels - np.array([11, 92, 173]) / 255) < 0.02).all(axis=2)
    green = (np.abs(pixels - np.array([21, 128, 61]) / 255) < 0.02).all(axis=2)
    grey = (np.ptp(pixels, axis=2) < 0.01) & (pixels[..., 0] < 0.97)
    assert blue.sum() > 5000
    assert green.sum() > 5000
    assert grey.mean() > 0.15


def test_a_picture_is_readable_like_any_other_file(part: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.touch()
    picture = tmp_path / "part.png"
    features(part, picture=picture)
    assert picture.stat().st_mode == other.stat().st_mode


def test_a_picture_of_an_unknown_kind_is_refused_before_the_work(
    tmp_path: Path,
) -> None:
    with pytest.raises(UsageError, match=r"x\.xyz.*PNG"):
        features(tmp_path / "nothing.stl", picture=tmp_path / "x.xyz")


def test_units_against_those_of_the_file_are_taken_with_a_warning() -> None:
    step = bundled_root() / "virtual" / "parts" / "nist_ctc_01_asme1_rd.stp"
    assert load_part(step, units="mm").warnings == load_part(step).warnings
    part = load_part(step, units="in")
    assert "the file says mm; the given units, in, override it" in part.warnings
    assert part.units_source == "given"


def test_a_part_without_features_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import trimesh

    path = tmp_path / "ball.stl"
    trimesh.creation.icosphere(subdivisions=4, radius=20.0).export(path)
    assert features(path, units="mm", as_json=True) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["edges"] == []
    assert "no straight sharp edge, round hole or planar face" in told.err
    assert "use an id" not in told.err


def test_a_picture_that_cannot_be_written_leaves_nothing(part: Path) -> None:
    with pytest.raises(OutputError):
        features(part, picture=part.parent / "no folder" / "part.png")
    assert sorted(p.name for p in part.parent.iterdir()) == ["object.stl"]


def test_a_file_that_is_no_part_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(GeometryError):
        features(tmp_path / "none.step")


def test_labels_never_cover_each_other() -> None:
    rng = np.random.default_rng(4)
    labels = [Label(f"E{i}", rng.uniform(-1, 1, 2), "k") for i in range(120)]
    corner = np.array([1.2, 1.2])
    centres = placed(
        labels, width_per_letter=0.03, height=0.05, low=-corner, high=corner
    )
    boxes = [
        (centre, np.array([0.03 * (len(label.text) + 0.6), 0.05 * 1.15]) / 2)
        for label, centre in zip(labels, centres, strict=True)
        if centre is not None
    ]
    assert len(boxes) > 60
    for i, (a, half_a) in enumerate(boxes):
        for b, half_b in boxes[:i]:
            assert (np.abs(a - b) >= half_a + half_b - 1e-12).any()
