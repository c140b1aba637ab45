"""``mvp-cell target``: the target of a cell as a PDF, or why there is none."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from calibration.targets import Detection, detect, target_of_print
from mvp.cell.loading import read_cell
from mvp.cell.places import template_names
from mvp.cli.main import invoke

if TYPE_CHECKING:
    from pathlib import Path

MM_TO_PT = 72 / 25.4


def with_target(folder: Path, old: str, new: str) -> str:
    """A copy of the uncalibrated cell with another [target]."""
    assert invoke(["init", str(folder), "--from", "virtual_uncalibrated"]) == 0
    path = folder / "cell.toml"
    head, _, rest = path.read_text().partition("[target]")
    assert old in rest
    path.write_text(f"{head}[target]{rest.replace(old, new, 1)}")
    return str(folder)


def test_the_sheet_is_the_target_of_the_cell_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "board.pdf"
    line = ["target", "virtual_uncalibrated", "--out", str(path), "--json"]
    assert invoke(line) == 0
    told = capsys.readouterr()
    document = json.loads(told.out)
    assert document["schema"] == "mvp-cell/target/1"
    assert document["target_mm"] == [180.0, 135.0]
    assert document["page_mm"] == [210.0, 297.0]
    for words in ("A4 (210 x 297 mm)", "actual size", "150 mm between its end ticks"):
        assert words in told.err
    box = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", path.read_bytes())
    assert box is not None
    size = [float(number) / MM_TO_PT for number in box.groups()]
    assert size == pytest.approx([210.0, 297.0])
    if not shutil.which("pdftoppm"):
        pytest.skip("poppler is not installed")
    command = ["pdftoppm", "-r", "127", "-gray", "-singlefile", str(path), str(path)]
    subprocess.run(command, check=True, capture_output=True)
    picture = cv2.imread(f"{path}.pgm", cv2.IMREAD_GRAYSCALE)
    printed = read_cell("virtual_uncalibrated")[1].target
    assert picture is not None
    assert printed is not None
    target = target_of_print(printed, 0.01)
    found = detect(np.asarray(picture, np.uint8), target)
    assert isinstance(found, Detection)
    assert len(found.ids) == len(target.points_mm)
    across = np.ptp(found.pixels, axis=0) / 5
    assert across == pytest.approx(np.ptp(target.points_mm, axis=0)[:2], abs=0.06)


def test_a_target_that_is_too_large_names_the_paper_that_takes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = with_target(tmp_path / "cell", "square_mm = 15.0", "square_mm = 25.0")
    capsys.readouterr()
    out = tmp_path / "board.pdf"
    assert invoke(["target", cell, "--out", str(out), "--json"]) == 2
    error = json.loads(capsys.readouterr().out)
    assert "300 x 225 mm does not fit on A4" in error["message"]
    assert "--paper A3" in error["hint"]
    assert not out.exists()
    assert invoke(["target", cell, "--out", str(out), "--paper", "A3"]) == 0


@pytest.mark.parametrize("name", template_names())
def test_a_template_has_a_target_to_uncomment(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = tmp_path / "cell"
    assert invoke(["init", str(cell), "--from", name]) == 0
    capsys.readouterr()
    line = ["target", str(cell), "--out", str(tmp_path / "t.pdf"), "--json"]
    assert invoke(line) == 2
    assert "no [target]" in json.loads(capsys.readouterr().out)["message"]
    path = cell / "cell.toml"
    head, mark, rest = path.read_text().partition("# [target]")
    block, _, tail = rest.partition("\n\n")
    shown = f"{mark}{block}".replace("\n# ", "\n").removeprefix("# ")
    path.write_text(f"{head}{shown}\n\n{tail}")
    assert invoke(line) == 0
    assert json.loads(capsys.readouterr().out)["target_mm"] == [180.0, 135.0]


@pytest.mark.parametrize(("paper", "name"), [("a4", "A4"), ("Letter", "letter")])
def test_the_name_of_the_paper_may_have_capitals_or_not(
    paper: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["target", "virtual_uncalibrated", "--out", str(tmp_path / "t.pdf")]
    assert invoke([*line, "--paper", paper, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["paper"] == name


@pytest.mark.parametrize(
    ("out", "named"),
    [
        (".", "target.pdf"),
        ("", "target.pdf"),
        ("/", "/target.pdf"),
        ("..", "../target.pdf"),
        ("board", "board.pdf"),
    ],
)
def test_a_folder_is_no_pdf_file_and_a_name_is_proposed(
    out: str, named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(["target", "virtual_uncalibrated", "--out", out, "--json"]) == 2
    error = json.loads(capsys.readouterr().out)
    assert "a PDF file" in error["message"]
    assert error["hint"] == f"name it {named}"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"5X5_250"', '"9X9_1"', "no marker dictionary '9X9_1'"),
        ('"5X5_250"', '"5X5_50"', "has 50 markers, the board needs 54"),
    ],
)
def test_markers_that_are_not_there_are_named(
    old: str,
    new: str,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    cell = with_target(tmp_path / "cell", old, new)
    capsys.readouterr()
    line = ["target", cell, "--out", str(tmp_path / "t.pdf"), "--json"]
    assert invoke(line) == 2
    assert words in json.loads(capsys.readouterr().out)["message"]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["virtual"], "no [target]"),
        (["virtual_uncalibrated", "--paper", "A5"], "unknown paper 'A5'"),
        (["virtual_uncalibrated", "--out", "board.png"], "a PDF file"),
        (["virtual_uncalibrated", "--out", "nowhere/board.pdf"], "nowhere"),
    ],
)
def test_what_cannot_be_printed_is_refused(
    line: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke(["target", *line, "--json"]) == 2
    error = json.loads(capsys.readouterr().out)
    assert words in error["message"]
    assert error["hint"]
    assert not list(tmp_path.rglob("*.pdf"))
