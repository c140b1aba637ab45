"""A plan keeps to where the lens table holds, and says so when that is what binds."""

from __future__ import annotations

import json
import re
import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvp.calibrated import LensTableCalibration
from mvp.cell.calibration_gates import of_views
from mvp.cell.loading import load_cell, load_task
from mvp.cell.places import bundled_root
from mvp.cell.plan_job import make_plan
from mvp.errors import CalibrationError
from mvp.optics import LensTable

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.planning.plan import Plan

BEYOND = 4100  # a free plan focuses below
ALL = {"zoom_steps": [0, 3200], "focus_steps": [0, 8000], "iris_steps": [0, 600]}


def folder_with(tmp_path: Path, **steps: list[int]) -> Path:
    """The virtual cell with a lens table that holds over less than was measured; no tubes, one edge."""
    source = bundled_root() / "virtual"
    folder = shutil.copytree(source, tmp_path / "cell", copy_function=shutil.copyfile)
    path = folder / "calibration" / "lens_table.json"
    content = json.loads(path.read_text())
    content["validity"] = ALL | steps
    path.write_text(json.dumps(content))
    bare = (folder / "cell.toml").read_text()
    bare = re.sub(r"extension_tubes_mm = \[.*?\]", "extension_tubes_mm = []", bare)
    (folder / "cell.toml").write_text(bare)
    task = folder / "tasks" / "paper_object.toml"
    head, first = task.read_text().split("[[features]]")[:2]
    task.write_text(f"{head}[[features]]{first}")
    return folder


def planned(folder: Path) -> tuple[Plan, list[str]]:
    cell = load_cell(str(folder))
    plan = make_plan(cell, load_task(cell, None)).plan
    return plan, [one.text for one in of_views(cell.calibrations, plan.views)]


def test_a_plan_keeps_to_the_steps_over_which_the_table_holds(tmp_path: Path) -> None:
    plan, refused = planned(folder_with(tmp_path, focus_steps=[BEYOND, 8000]))
    assert plan.status == "admissible"
    assert all(view.lens_steps.focus >= BEYOND for view in plan.views)
    assert refused == []


def test_where_nothing_is_admissible_inside_the_range_itself_is_named(
    tmp_path: Path,
) -> None:
    plan, _ = planned(folder_with(tmp_path, focus_steps=[0, 200]))
    assert plan.status == "infeasible"
    (entry,) = plan.not_covered
    assert "what binds is the range over which the lens table holds" in entry.reason
    assert "focus steps 0 to 200" in entry.reason
    assert "lens_table.json" in entry.reason
    assert "`mvp-cell calibrate lens CELL`" in entry.fix
    assert "includes focus step" in entry.fix


def test_a_narrowed_table_has_the_same_values(tmp_path: Path) -> None:
    path = bundled_root() / "virtual" / "calibration" / "lens_table.json"
    content = json.loads(path.read_text()) | {
        "validity": ALL | {"focus_steps": [1000, 7000], "iris_steps": [-5, 300]}
    }
    model = LensTableCalibration.model_validate(content)
    whole = LensTable.from_calibration(model)
    held = whole.within(model.validity)
    steps = np.linspace(500, 7500, 50)
    np.testing.assert_array_equal(
        held.focus.value_mm(steps), whole.focus.value_mm(steps)
    )
    values = whole.focus.value_mm(steps)
    np.testing.assert_array_equal(
        held.focus.fractional_steps(values), whole.focus.fractional_steps(values)
    )
    ends = np.sort(whole.focus.value_mm([1000, 7000]))
    assert held.focus.range_mm == pytest.approx(tuple(ends), abs=1e-12)
    assert held.iris.range_steps == (0, 300)
    assert held.focus.nearest_step(float(whole.focus.value_mm(7100))) == 7000
    assert not held.reaches(12.5, 12.5 + float(whole.focus.value_mm(7100)), 0.8)


def test_a_table_that_holds_nowhere_is_not_used() -> None:
    table = LensTable.from_calibration(load_cell("virtual").calibrations.lens_table)
    with pytest.raises(CalibrationError, match="hold from step 9000 to 9500, but was"):
        table.focus.within((9000, 9500))
