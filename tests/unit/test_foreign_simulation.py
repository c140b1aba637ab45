"""Somebody simulates the same cell with another task: nothing is opened or resumed."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import pytest

from mvp.cell.loading import load_cell, load_task
from mvp.cell.places import bundled_root
from mvp.cell.resume_job import resume_run
from mvp.cell.run_job import RunOptions
from mvp.cell.session import Watcher
from mvp.cell.simulation import Simulation, simulation_of
from mvp.cell.simulation_host import found_by_others
from mvp.errors import UsageError
from tests.unit.test_report_page import plan_document

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mvp.cell.loading import LoadedCell

OURS, THEIRS = "tasks/paper_object.toml", "tasks/other.toml"


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[LoadedCell]:
    """A simulated cell whose simulation runs, and shows the other task."""
    folder = tmp_path / "cell"
    shutil.copytree(bundled_root() / "simulated_gantry", folder)
    shutil.copyfile(folder / OURS, folder / THEIRS)
    loaded = load_cell(str(folder))
    theirs = load_task(loaded, str(folder / THEIRS))
    shown = Simulation(
        cell=loaded.config.name, task=str(theirs.source.path), devices={}
    )
    with found_by_others(loaded, shown):
        yield loaded


def run_of(folder: Path, task: str) -> Path:
    """A run that broke off, as far as it is read before anything else."""
    plan = plan_document()
    plan["task"] = {**plan["task"], "file": task}  # type: ignore[dict-item]
    folder.mkdir()
    (folder / "plan.json").write_text(json.dumps(plan))
    (folder / "records.jsonl").write_text("")
    return folder


def test_a_run_is_not_resumed_in_the_world_of_another_task(
    cell: LoadedCell, tmp_path: Path
) -> None:
    run = run_of(tmp_path / "run", OURS)
    asked: list[object] = []
    watcher = Watcher(lambda motion: bool(asked.append(motion)), lambda runner: None)
    with pytest.raises(UsageError, match="that runs shows") as told:
        resume_run(cell, str(run), RunOptions(tmp_path), watcher)
    assert THEIRS in told.value.message
    assert f"--task {cell.folder / OURS}" in told.value.hint
    assert asked == []
    left = sorted(path.name for path in run.iterdir())
    assert left == ["plan.json", "records.jsonl"]
    assert (run / "records.jsonl").read_text() == ""


def test_only_the_task_that_is_shown_finds_the_simulation(cell: LoadedCell) -> None:
    theirs = load_task(cell, str(cell.folder / THEIRS))
    with simulation_of(cell, theirs) as announced:
        assert announced == {}
    ours = load_task(cell, str(cell.folder / OURS))
    with pytest.raises(UsageError), simulation_of(cell, ours):
        pass
