"""A run that was killed at any moment goes on where it was, or says why it cannot."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mvp.cell.loading import load_cell, load_task
from mvp.cell.places import bundled_root
from mvp.cell.plan_job import make_plan
from mvp.cell.records import Captured, RunFinished, RunStarted, Verified, read_records
from mvp.cell.run_folder import RunFolder
from mvp.cli.main import invoke

TASK = """
schema_version = 1
name = "two views"
[part]
file = "../parts/paper_object.stl"
units = "mm"
[resolution]
detail_mm = 0.5
[lens]
f_mm = 12.5
a_mm = 0.78125
[[features]]
id = "inside"
kind = "edge"
from_mm = [-12.7, 0.0, 12.7]
to_mm = [12.7, 0.0, 12.7]
[[features]]
id = "outside"
kind = "edge"
from_mm = [-101.6, -101.6, -19.05]
to_mm = [-101.6, 101.6, -19.05]
resolution = { detail_mm = 1.0 }
"""
START = Path(__file__).with_name("start_and_die.py")
MOMENTS = [
    "moving v1",
    "adjusting v1",
    "capturing v1",
    "verifying v1",
    "moving v2",
    "capturing v2",
    "verifying v2",
    "finishing v2",
    "finished v2",
]


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A fast virtual cell and a plan of two views for it."""
    cell = tmp_path_factory.mktemp("resume") / "cell"
    shutil.copytree(bundled_root() / "virtual", cell, copy_function=shutil.copyfile)
    text = (cell / "cell.toml").read_text()
    text = text.replace("clock_speed = 1.0", "clock_speed = 100.0")
    (cell / "cell.toml").write_text(text)
    (cell / "tasks" / "two.toml").write_text(TASK)
    loaded = load_cell(str(cell))
    plan = make_plan(loaded, load_task(loaded, "two")).plan
    assert [view.id for view in plan.views] == ["v1", "v2"]
    assert plan.task.file == "tasks/two.toml"
    assert plan.part.file == "parts/paper_object.stl"
    plan_file = cell.parent / "plan.json"
    plan_file.write_text(plan.model_dump_json(by_alias=True))
    return cell, plan_file


def killed_run(planned: tuple[Path, Path], out: Path, moment: str) -> Path:
    """The folder that a run leaves behind when it is killed at a moment."""
    cell, plan = planned
    done = subprocess.run(
        [sys.executable, START, cell, "two", plan, out, moment],
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == -9, done.stderr.decode()
    (folder,) = [p for p in out.iterdir() if p.is_dir()]
    return folder


def resume(planned: tuple[Path, Path], folder: Path) -> int:
    words = ["run", str(planned[0]), "--resume", str(folder), "--json"]
    return invoke(words)


# The views are taken and judged; whether the second one, which looks along a face,
# can be measured is not the subject here.
JUDGED = (0, 5)


def check_complete(folder: Path) -> None:
    """Every view captured once and verified once, and the end is the last line."""
    records = read_records(folder / "records.jsonl")
    captured = [r for r in records if isinstance(r, Captured)]
    verified = [r for r in records if isinstance(r, Verified)]
    assert [r.view for r in captured] == ["v1", "v2"]
    assert sorted(r.view for r in verified) == ["v1", "v2"]
    assert isinstance(records[-1], RunFinished)
    assert records[-1].reason == "completed"
    images = sorted(p.name for p in (folder / "images").iterdir())
    assert images == ["v1.png", "v2.png"]
    document = json.loads((folder / "run.json").read_text())
    assert document["status"] in ("verified", "failed")


@pytest.mark.full
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_killed_run_is_completed(
    moment: str, planned: tuple[Path, Path], tmp_path: Path
) -> None:
    folder = killed_run(planned, tmp_path, moment)
    assert resume(planned, folder) in JUDGED
    check_complete(folder)


def test_a_picture_without_a_record_is_set_aside_and_taken_again(
    planned: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = killed_run(planned, tmp_path, "verifying v1")
    file = folder / "records.jsonl"
    lines = file.read_bytes().splitlines(keepends=True)
    assert json.loads(lines[-1])["type"] == "captured"
    # What a power cut leaves: the picture is there, its line only half.
    file.write_bytes(b"".join(lines[:-1]) + lines[-1][:40])
    (folder / "images" / ".v2.png.part").write_bytes(b"half a picture")
    assert resume(planned, folder) in JUDGED
    shown = capsys.readouterr().err  # what is left, before anything is asked
    assert "2 views" in shown.partition("begun")[0]
    assert "binding" in shown.partition("begun")[0]
    check_complete(folder)
    aside = sorted(p.name for p in (folder / "quarantine").iterdir())
    assert aside == ["000-v2.png.part", "001-v1.png"]


def damage_record(folder: Path, cell: Path) -> str:
    file = folder / "records.jsonl"
    file.write_bytes(file.read_bytes().replace(b'"captured"', b'"capturde"', 1))
    return "records.jsonl:3: damaged record"


def drop_record(folder: Path, cell: Path) -> str:
    file = folder / "records.jsonl"
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join([*lines[:1], *lines[2:]]))
    return "records.jsonl:2: damaged record"


def change_picture(folder: Path, cell: Path) -> str:
    file = folder / "images" / "v1.png"
    file.write_bytes(file.read_bytes()[:-9] + b"x" * 9)
    return "v1.png: the picture has changed"


def lose_picture(folder: Path, cell: Path) -> str:
    (folder / "images" / "v1.png").unlink()
    return "v1.png"


def change_plan(folder: Path, cell: Path) -> str:
    file = folder / "plan.json"
    file.write_text(file.read_text().replace('"roll_rad": ', '"roll_rad": 1e-9 '[:-1]))
    return "plan"


def change_calibration(folder: Path, cell: Path) -> str:
    file = cell / "calibration" / "hand_eye.json"
    file.write_text(file.read_text() + "\n")
    return "changed since it began: hand_eye calibration ("


def change_cell(folder: Path, cell: Path) -> str:
    file = cell / "cell.toml"
    file.write_text(file.read_text() + "\n# a thought\n")
    return f"cell ({cell}"


def change_part(folder: Path, cell: Path) -> str:
    file = cell / "parts" / "paper_object.stl"
    content = file.read_bytes()
    assert b"paper_object" in content[:80]
    file.write_bytes(content.replace(b"paper_object", b"paper_0bject", 1))
    return f"part ({file})"


@pytest.fixture(scope="module")
def broken_off(
    planned: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """One run that was killed after its first picture."""
    return killed_run(planned, tmp_path_factory.mktemp("runs"), "moving v2")


@pytest.mark.parametrize(
    "change",
    [
        damage_record,
        drop_record,
        change_picture,
        lose_picture,
        change_plan,
        change_calibration,
        change_cell,
        change_part,
    ],
)
def test_a_run_whose_files_changed_is_not_resumed(
    change: object,
    planned: tuple[Path, Path],
    broken_off: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    cell, _ = planned
    folder = tmp_path / "runs" / broken_off.name
    shutil.copytree(broken_off, folder)
    kept = tmp_path / "kept"
    shutil.copytree(cell, kept)
    try:
        says = change(folder, cell)  # type: ignore[operator]
        before = (folder / "records.jsonl").read_bytes()
        code = resume(planned, folder)
    finally:
        shutil.rmtree(cell)
        shutil.move(kept, cell)
    document = json.loads(capsys.readouterr().out)
    assert code == document["code"] == 2
    assert says in document["message"]
    assert (folder / "records.jsonl").read_bytes() == before


def test_a_run_whose_process_died_is_listed_as_broken_off_with_its_command(
    planned: tuple[Path, Path],
    broken_off: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "my runs"
    shutil.copytree(broken_off, out / broken_off.name)
    monkeypatch.chdir(tmp_path)
    assert invoke(["runs", "--out", "my runs", "--json"]) == 0
    said = capsys.readouterr()
    (listed,) = json.loads(said.out)["runs"]
    assert (listed["status"], listed["captured"], listed["views"]) == (
        "broken off",
        1,
        2,
    )
    assert "1 of 2 captured" in said.err
    assert f"go on with: {listed['resume']}\n" in said.err
    words = shlex.split(listed["resume"])
    assert words[1:] == [
        *("run", str(planned[0]), "--out", "my runs", "--resume", broken_off.name)
    ]
    with RunFolder(out / broken_off.name).in_progress():
        assert invoke(["runs", "--out", "my runs", "--json"]) == 0
        (listed,) = json.loads(capsys.readouterr().out)["runs"]
        assert listed["status"] == "running"
    assert invoke(words[1:]) in JUDGED
    check_complete(out / broken_off.name)
    assert [path.name for path in out.iterdir()] == [broken_off.name]


def test_a_complete_run_is_resumed_without_opening_a_device(
    planned: tuple[Path, Path],
    broken_off: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From another folder than the one it began in, too."""
    folder = tmp_path / broken_off.name
    shutil.copytree(broken_off, folder)
    monkeypatch.chdir(tmp_path)
    assert resume(planned, folder) in JUDGED
    count = len(read_records(folder / "records.jsonl"))
    assert resume(planned, folder) in JUDGED
    records = read_records(folder / "records.jsonl")
    assert len(records) == count
    assert sum(isinstance(r, RunStarted) for r in records) == 2
