"""A cell that was never measured fails honestly, and passes once it knows the truth."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import pytest

from mvp.cell.loading import load_cell
from mvp.cli.main import invoke
from tools.compare_with_truth import Compared, compare, told

if TYPE_CHECKING:
    from pathlib import Path

KINDS = {
    "camera": "camera",
    "lens": "lens_table",
    "hand-eye": "hand_eye",
    "part": "part_pose",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the uncalibrated cell, as `init` makes it."""
    path = tmp_path / "cell"
    assert invoke(["init", str(path), "--from", "virtual_uncalibrated", "--json"]) == 0
    return path


def ran(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> tuple[int, dict, dict, str]:
    """Exit code, run document, plan and what a person read."""
    capsys.readouterr()
    runs = folder / "runs"
    code = invoke(["run", str(folder / "cell.toml"), "--json", "--out", str(runs)])
    told = capsys.readouterr()
    document = json.loads(told.out)
    (path,) = runs.glob("*/plan.json")
    return code, document, json.loads(path.read_text()), told.err


def test_a_cell_that_was_never_measured_is_warned_of_and_fails_verification(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, document, plan, told = ran(folder, capsys)
    assert code == 5
    assert document["status"] == "failed"
    assert all(view["verification"]["verdict"] == "fail" for view in document["views"])
    warned = [note for note in plan["notes"] if "calibration is nominal" in note]
    assert len(warned) == 4
    for name in ("camera", "lens_table", "hand_eye", "part_pose"):
        assert f"the {name} calibration is nominal" in " ".join(told.split())


@pytest.mark.full
def test_the_same_cell_passes_when_it_believes_what_is_true(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in (folder / "truth").glob("*.json"):
        shutil.copyfile(path, folder / "calibration" / path.name)
    code, document, plan, _ = ran(folder, capsys)
    assert code == 0
    assert document["status"] == "verified"
    assert not any("nominal" in note for note in plan["notes"])


def calibrated(
    kind: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> dict[str, object]:
    """What `calibrate KIND` says, left alone on a cell."""
    capsys.readouterr()
    code = invoke(["calibrate", kind, str(folder), "--auto", "--yes", "--json"])
    told = capsys.readouterr()
    assert code == 0, told.err
    document: dict[str, object] = json.loads(told.out)
    return document


def assert_as_good_as_stated(rows: list[Compared]) -> None:
    """One of 19 values lies outside of its 95 % interval; more than three hardly ever.

    Farther off than twice its interval, at four standard deviations, lies none.
    """
    shown = "\n".join(told(rows))
    assert all(row.stated is not None for row in rows), shown
    assert sum(row.inside is False for row in rows) <= 3, shown
    assert all(abs(row.error) <= 2 * (row.stated or 0.0) for row in rows), shown


@pytest.mark.full
@pytest.mark.timeout(3600)
def test_four_calibrations_turn_a_failing_cell_into_one_that_passes(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ran(folder, capsys)[0] == 5
    shutil.rmtree(folder / "runs")
    files = folder / "calibration"
    nominal = {name: (files / f"{name}.json").read_bytes() for name in KINDS.values()}
    for kind, name in KINDS.items():
        document = calibrated(kind, folder, capsys)
        assert document["verdict"] == "go", document["lines"]
        (kept,) = (files / "previous").glob(f"{name}-*.json")
        assert kept.read_bytes() == nominal[name]
    assert_as_good_as_stated(compare(load_cell(str(folder))))
    code, document, plan, _ = ran(folder, capsys)
    assert code == 0
    assert document["status"] == "verified"
    assert not any("nominal" in note for note in plan["notes"])
