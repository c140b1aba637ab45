"""What tests of whole calibrations share: all four wizards, left alone, and the truth."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from mvp.cell.loading import load_cell
from mvp.cli.main import invoke
from tools.compare_with_truth import Compared, compare, told

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

FILES = {
    "camera": "camera",
    "lens": "lens_table",
    "hand-eye": "hand_eye",
    "part": "part_pose",
}


def calibrate_all(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    kinds: tuple[str, ...] = tuple(FILES),
) -> None:
    """The wizards in their order; each is good, and keeps the file before it."""
    files = folder / "calibration"
    before = {name: (files / f"{name}.json").read_bytes() for name in FILES.values()}
    for kind in kinds:
        name = FILES[kind]
        capsys.readouterr()
        code = invoke(["calibrate", kind, str(folder), "--auto", "--yes", "--json"])
        said = capsys.readouterr()
        assert code == 0, said.err
        document = json.loads(said.out)
        assert document["verdict"] == "go", document["lines"]
        (kept,) = (files / "previous").glob(f"{name}-*.json")
        assert kept.read_bytes() == before[name]


def assert_as_good_as_stated(
    folder: Path, kinds: tuple[str, ...] = tuple(FILES)
) -> None:
    """One of 19 values lies outside of its 95 % interval; more than three hardly ever.

    Farther off than twice its interval, at four standard deviations, lies none.
    """
    files = {FILES[kind] for kind in kinds}
    every: list[Compared] = compare(load_cell(str(folder)))
    rows = [row for row in every if row.file in files]
    shown = "\n".join(told(rows))
    assert {row.file for row in rows} == files, shown
    assert all(row.stated is not None for row in rows), shown
    assert sum(row.inside is False for row in rows) <= 3, shown
    assert all(abs(row.error) <= 2 * (row.stated or 0.0) for row in rows), shown
