"""Runs with a lens whose zoom changes more than f, on the virtual cell."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import pytest

from mvp.cell.loading import load_cell, load_task
from mvp.cell.places import bundled_root
from mvp.cell.plan_job import make_plan
from mvp.cli.main import invoke
from mvp.optics import LensTable

if TYPE_CHECKING:
    from pathlib import Path


def changing(steps: list[int]) -> dict[str, list[int] | list[float]]:
    """What a varifocal lens may do from one end of the zoom to the other."""
    return {
        "steps": [steps[0], steps[-1]],
        "pupil_offset_mm": [2.0, 5.0],
        "focus_shift_mm": [-0.03, 0.06],
        "centre_x_px": [790.0, 830.0],
        "centre_y_px": [590.0, 620.0],
        "k1": [-0.08, 0.02],
        "pupil_shift_mm": [0.0, 6.0],
    }


def cell_in(folder: Path, *, believed: bool) -> Path:
    """The truth is a zoom that changes; the cell knows that, or does not."""
    shutil.copytree(bundled_root() / "virtual", folder, copy_function=shutil.copyfile)
    shutil.copytree(folder / "calibration", folder / "truth")
    for name, changed in (("truth", True), ("calibration", believed)):
        path = folder / name / "lens_table.json"
        table = json.loads(path.read_text())
        if changed:
            table["by_zoom"] = changing(table["zoom_f_mm"]["steps"])
        path.write_text(json.dumps(table))
    text = (folder / "cell.toml").read_text()
    text = text.replace("clock_speed = 1.0", "clock_speed = 100.0")
    (folder / "cell.toml").write_text(f'{text}\ntruth = "truth"\n')
    task = folder / "tasks" / "paper_object.toml"
    words = task.read_text()
    assert "f_mm = 12.5" in words
    task.write_text(words.replace("f_mm = 12.5", "f_mm = [12.0, 15.0]"))
    return folder


def test_a_plan_takes_the_camera_as_it_is_at_its_zoom(tmp_path: Path) -> None:
    cell = load_cell(str(cell_in(tmp_path / "cell", believed=True)))
    plan = make_plan(cell, load_task(cell, None)).plan
    assert plan.status == "admissible"
    (view,) = plan.views
    table = LensTable.from_calibration(cell.calibrations.lens_table)
    steps = view.lens_steps
    lens = table.setting(steps.zoom, steps.focus, steps.iris)
    assert view.pupil_offset_mm == pytest.approx(lens.e_mm, abs=1e-9)
    assert view.d_mm == pytest.approx(lens.d_mm, abs=1e-9)
    assert 2.0 < view.pupil_offset_mm < 5.0
    assert not any("carried" in note for note in view.notes)


@pytest.mark.full
@pytest.mark.parametrize("believed", [True, False])
def test_a_run_keeps_its_promise_only_with_what_the_zoom_changes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], believed: bool
) -> None:
    cell = cell_in(tmp_path / "cell", believed=believed)
    out = tmp_path / "runs"
    code = invoke(["run", str(cell), "--out", str(out), "--json"])
    assert code == (0 if believed else 5), capsys.readouterr().out[-2000:]
