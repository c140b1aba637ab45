"""Whole runs on parts of the NIST, from plan to a measured picture."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from mvp.cell.loading import load_cell, load_task
from mvp.cell.places import bundled_root
from mvp.cell.plan_job import make_plan
from mvp.cell.run_job import RunOptions, start_run
from mvp.cell.session import RunResult, Watcher

SHARED = Path(__file__).parents[2].parent / "shared" / "data" / "nist_step"
FTC_09 = SHARED / "nist_ftc_09_asme1_rd.stp"
TASK = """
schema_version = 1
name = "ftc_09"

[part]
file = "../parts/{part}"
units = "in"

[resolution]
detail_mm = 0.3
pixels = 1.0

[lens]
f_mm = 12.5
a_mm = 0.78125

[[features]]
id = "upper border"
ref = "E8"

[[features]]
id = "large hole"
ref = "H2"

[[features]]
id = "end face"
ref = "F6"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A virtual cell of one's own whose clock runs a hundred times as fast."""
    copy = tmp_path / "cell"
    shutil.copytree(bundled_root() / "virtual", copy, copy_function=shutil.copyfile)
    text = (copy / "cell.toml").read_text()
    text = text.replace("clock_speed = 1.0", "clock_speed = 100.0")
    (copy / "cell.toml").write_text(text)
    return copy


def run(folder: Path, task: str) -> RunResult:
    cell = load_cell(str(folder))
    planned = make_plan(cell, load_task(cell, task))
    watcher = Watcher(lambda motion: motion.simulated, lambda runner: None)
    options = RunOptions(folder.parent / "runs")
    return start_run(planned.setting, planned.plan, options, watcher)


def measured(result: RunResult) -> dict[str, set[str]]:
    """Names of what was measured, by kind."""
    (view,) = result.document.views
    found = view.verification
    assert found is not None
    extra = found.model_extra or {}
    return {
        "edges": {str(e["name"]) for e in found.edges if e["measured_px"] is not None},
        "holes": {
            str(h["feature"]) for h in extra["holes"] if h["measured_px"] is not None
        },
    }


@pytest.mark.full
def test_an_edge_a_hole_and_a_face_of_ctc_01_are_measured(folder: Path):
    result = run(folder, "nist_ctc_01")
    assert result.document.status == "verified"
    found = measured(result)
    assert {"upper front edge", *(f"front face:{k}" for k in range(1, 5))} <= (
        found["edges"]
    )
    assert found["holes"] == {"left hole", "front face"}


@pytest.mark.full
@pytest.mark.skipif(not FTC_09.is_file(), reason="the NIST part is not here")
def test_an_edge_a_hole_and_a_face_of_ftc_09_are_measured(folder: Path):
    shutil.copyfile(FTC_09, folder / "parts" / FTC_09.name)
    (folder / "tasks" / "ftc_09.toml").write_text(TASK.format(part=FTC_09.name))
    result = run(folder, "ftc_09")
    assert result.document.status == "verified"
    found = measured(result)
    assert {"upper border", *(f"end face:{k}" for k in range(1, 5))} <= found["edges"]
    assert found["holes"] == {"large hole"}
