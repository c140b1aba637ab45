"""A cell that was never measured fails honestly, and passes once it knows the truth."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import pytest

from mvp.cli.main import invoke
from tests.calibrated_cells import assert_as_good_as_stated, calibrate_all
from tests.complete_results import missing_of

if TYPE_CHECKING:
    from pathlib import Path


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


@pytest.mark.timeout(3600)
def test_four_calibrations_turn_a_failing_cell_into_one_that_passes(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibrate_all(folder, capsys)
    assert_as_good_as_stated(folder)
    results = sorted(folder.glob("calibration/sessions/*/result.json"))
    missing = {p.parent.name: missing_of(json.loads(p.read_text())) for p in results}
    assert len(missing) == 4
    assert not any(missing.values()), missing
    code, document, plan, _ = ran(folder, capsys)
    assert code == 0
    assert document["status"] == "verified"
    assert not any("nominal" in note for note in plan["notes"])
