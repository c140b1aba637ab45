"""A cell in use is refused at once, with the same answer wherever the results go."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from mvp.cell.in_use import devices_lock, using_devices
from mvp.cell.init_job import copy_cell
from mvp.cell.loading import load_cell
from mvp.cell.lock import cell_lock
from mvp.cell.run_folder import create_run_folder, parent_dropped_on_error
from mvp.cell.simulation import Simulation, announcement, simulation_lock
from mvp.cli.main import invoke

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mvp.cell.loading import LoadedCell


@pytest.fixture
def simulated(tmp_path: Path) -> Iterator[LoadedCell]:
    """A cell whose simulation somebody keeps running."""
    folder = tmp_path / "cell"
    copy_cell("simulated_gantry", folder)
    cell = load_cell(str(folder))
    with cell_lock(simulation_lock(cell.source.path), run_id="simulate"):
        yield cell


@pytest.fixture
def real(tmp_path: Path) -> LoadedCell:
    """A cell of real devices that nobody has."""
    folder = tmp_path / "cell"
    copy_cell("gantry_scf4_opencv", folder)
    return load_cell(str(folder), accept_calibration="a trial")


def test_nobody_disturbs_the_world_that_a_command_makes_for_itself(
    virtual_copy: Path,
) -> None:
    assert devices_lock(load_cell(str(virtual_copy))) is None
    assert devices_lock(load_cell("simulated_gantry")) is None


def test_a_simulation_that_others_use_has_one_lock(simulated: LoadedCell) -> None:
    lock = devices_lock(simulated)
    assert lock is not None
    with using_devices(simulated, who="the first"):
        assert lock.exists()
    assert not lock.exists()


@pytest.mark.parametrize("kind", ["simulated", "real"])
@pytest.mark.parametrize(
    "command", ["run", "run --dry-run", "check", "home", "recover"]
)
def test_a_cell_in_use_is_refused_before_any_work_and_leaves_no_folder(
    kind: str,
    command: str,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    capsys: pytest.CaptureFixture[str],
) -> None:
    cell = request.getfixturevalue(kind)
    name, *options = command.split()
    words = [name, str(cell.folder), *options, "--json"]
    words += ["--accept-calibration", "a trial"]
    before = sorted(tmp_path.iterdir())
    outs = [["--out", str(tmp_path / x)] for x in "ab"] if name == "run" else [[]]
    with using_devices(cell, who="the first"):
        for out in outs:
            assert invoke([*words, *out]) == 2
            said, told = capsys.readouterr()
            assert "(the first) is running on this cell" in json.loads(said)["message"]
            assert "planning" not in told
            assert "connecting" not in told
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("options", ["", "--dry-run", "--locate --yes"])
def test_a_simulation_of_another_task_is_refused_before_planning(
    simulated: LoadedCell,
    options: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    wanted = simulated.folder / "tasks" / "paper_object.toml"
    shown = str(simulated.folder / "tasks" / "other.toml")
    said = Simulation(cell=simulated.config.name, task=shown, devices={})
    place = announcement(simulated.source.path)
    place.write_text(said.model_dump_json(by_alias=True), encoding="utf-8")
    words = ["run", str(simulated.folder), "--task", str(wanted), *options.split()]
    out = tmp_path / "runs"
    try:
        assert invoke([*words, "--out", str(out), "--json"]) == 2
    finally:
        place.unlink()
    told = json.loads(capsys.readouterr().out)
    assert shown in told["message"]
    assert f"--task {shown}" in told["hint"]
    assert f"--task {wanted}" in told["hint"]
    assert not out.exists()


def test_folders_made_for_a_run_that_never_began_are_taken_away(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    out = tmp_path / "there" / "deep" / "runs"

    def begin() -> None:
        with parent_dropped_on_error(out):
            with create_run_folder(out, "r").dropped_on_error():
                raise RuntimeError

    with pytest.raises(RuntimeError):
        begin()
    assert list((tmp_path / "there").iterdir()) == []


def test_a_folder_that_others_have_used_meanwhile_stays(tmp_path: Path) -> None:
    out = tmp_path / "runs"

    def begin() -> None:
        with parent_dropped_on_error(out):
            create_run_folder(out, "r")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        begin()
    assert [path.name for path in out.iterdir()] == ["r"]
