"""A disk that fills up at any moment of a run costs nothing but the rest of the run."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from mvp.cell.loading import load_cell
from mvp.cell.places import bundled_root
from mvp.cell.records import Captured, RunFinished, Verified, read_records
from mvp.cell.resume_job import resume_run
from mvp.cell.run_folder import RunFolder
from mvp.cell.run_job import RunOptions
from mvp.cell.session import Watcher

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs RLIMIT_FSIZE")

HERE = Path(__file__).parent
FULL_DISK = HERE / "start_on_a_full_disk.py"
TASK = """
schema_version = 1
name = "one after the other"
[part]
file = "../parts/paper_object.stl"
units = "mm"
[resolution]
detail_mm = 1.0
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
"""
JUDGED = (0, 5)


@dataclass(frozen=True)
class Stage:
    """The n-th time that a file is opened, and which file the message names."""

    file: str
    count: int = 1

    @property
    def named(self) -> str:
        return self.file.removeprefix(".").removesuffix(".part").lstrip("*.")

    def __str__(self) -> str:
        return f"{self.named} {self.count}"


# Before the run can be resumed at all.
AT_THE_START = [
    Stage(".plan.json.part"),
    Stage("records.jsonl"),
    Stage(".run.json.part"),
]
# In the order in which they come, of a run that goes on before its first view.
ON_THE_WAY = [
    Stage("records.jsonl", 1),
    Stage(".run.json.part", 1),
    Stage("records.jsonl", 2),
    Stage(".v1.png.part"),
    Stage("records.jsonl", 3),
    Stage("records.jsonl", 4),
    Stage("records.jsonl", 5),
    Stage(".v2.png.part"),
    Stage("records.jsonl", 6),
    Stage("records.jsonl", 7),
    Stage("records.jsonl", 8),
    Stage(".run.json.part", 2),
]
# What is only a convenience.
BESIDE = [
    Stage("log.jsonl"),
    Stage(".scene.png.part"),
    Stage(".report.html.part"),
]


def always(stages: list[Stage], *names: str) -> list[object]:
    """The named ones in every test run, all of them in the full one."""
    full = pytest.mark.full
    return [
        pytest.param(s, id=str(s), marks=() if str(s) in names else full)
        for s in stages
    ]


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    cell = tmp_path_factory.mktemp("full") / "cell"
    shutil.copytree(bundled_root() / "virtual", cell, copy_function=shutil.copyfile)
    text = (cell / "cell.toml").read_text()
    text = text.replace("clock_speed = 1.0", "clock_speed = 100.0")
    (cell / "cell.toml").write_text(text)
    (cell / "tasks" / "two.toml").write_text(TASK)
    return cell


@pytest.fixture(scope="module")
def begun(cell: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two views that was cut short before the first of them."""
    out = tmp_path_factory.mktemp("begun")
    done = start("limit", Stage("records.jsonl", 2), run_words(cell, out))
    assert done.returncode == 2, done.stderr
    (folder,) = runs_in(out)
    return folder


def run_words(cell: Path, out: Path) -> list[str]:
    return ["run", str(cell), "--task", "two", "--out", str(out), "--json"]


def resume_words(cell: Path, folder: Path) -> list[str]:
    return [*run_words(cell, folder.parent), "--resume", folder.name]


def runs_in(out: Path) -> list[Path]:
    return [p for p in out.iterdir() if p.is_dir()]


def start(how: str, stage: Stage, words: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, FULL_DISK, how, stage.file, str(stage.count), *words],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def check_said(done: subprocess.CompletedProcess[str], named: str) -> dict[str, str]:
    """One message for the person, one document for the program."""
    assert done.returncode == 2, done.stderr
    document: dict[str, str] = json.loads(done.stdout)
    assert document["schema"] == "mvp-cell/error/1"
    assert document["kind"] == "OutputError"
    assert named in document["message"]
    assert " free" in document["message"]
    assert "make room on that disk" in document["hint"]
    assert "Traceback" not in done.stderr
    assert "Logging error" not in done.stderr
    assert done.stderr.count("error: ") == 1
    assert document["message"] in done.stderr
    return document


def check_whole(folder: Path) -> None:
    """Every file that is there can be read, and nobody holds the cell."""
    run = RunFolder(folder)
    run.read_plan()
    run.read_document()
    raw = run.records_file.read_bytes()
    assert raw.endswith(b"\n")
    assert [json.loads(line)["seq"] for line in raw.splitlines()] == list(
        range(raw.count(b"\n"))
    )
    for record in run.records():
        if isinstance(record, Captured):
            run.load(record)
    if run.log_file.exists():
        assert all(map(json.loads, run.log_file.read_text().splitlines()))
    assert not list(folder.rglob("*.part"))
    assert not list(folder.parent.glob(".*.lock"))


def check_resumed(cell: Path, folder: Path) -> None:
    """After room was made, the run ends as if nothing had happened."""
    before = {
        r.view: r.sha256
        for r in read_records(folder / "records.jsonl")
        if isinstance(r, Captured)
    }
    watcher = Watcher(lambda motion: True, lambda runner: None)
    result = resume_run(
        load_cell(str(cell)), folder.name, RunOptions(out=folder.parent), watcher
    )
    assert result.outcome.reason == "completed"
    check_whole(folder)
    records = read_records(folder / "records.jsonl")
    captured = {r.view: r.sha256 for r in records if isinstance(r, Captured)}
    assert captured.keys() == {"v1", "v2"}
    assert before.items() <= captured.items()
    verified = [r.view for r in records if isinstance(r, Verified)]
    assert sorted(verified) == ["v1", "v2"]
    assert isinstance(records[-1], RunFinished)
    assert sorted(p.name for p in (folder / "images").iterdir()) == ["v1.png", "v2.png"]


def copied(begun: Path, out: Path) -> Path:
    return Path(shutil.copytree(begun, out / begun.name))


@pytest.mark.parametrize("stage", always(AT_THE_START, "plan.json 1"))
def test_a_run_that_cannot_be_begun_leaves_nothing_behind(
    stage: Stage, cell: Path, tmp_path: Path
) -> None:
    out = tmp_path / "runs"
    done = start("limit", stage, run_words(cell, out))
    check_said(done, stage.named)
    assert not out.exists()


@pytest.mark.parametrize("stage", always(ON_THE_WAY, "records.jsonl 6", "run.json 2"))
def test_a_run_whose_disk_filled_up_goes_on_after_room_was_made(
    stage: Stage, cell: Path, begun: Path, tmp_path: Path
) -> None:
    folder = copied(begun, tmp_path)
    done = start("limit", stage, resume_words(cell, folder))
    said = check_said(done, stage.named)
    assert "--resume" in said["hint"] or "same command again" in said["hint"]
    check_whole(folder)
    check_resumed(cell, folder)


@pytest.mark.parametrize("stage", always(BESIDE, "report.html 1"))
def test_a_log_or_report_that_finds_no_room_does_not_spoil_the_run(
    stage: Stage, cell: Path, begun: Path, tmp_path: Path
) -> None:
    folder = copied(begun, tmp_path)
    done = start("limit", stage, resume_words(cell, folder))
    if stage.named == "log.jsonl":
        # The limit of this process holds for the pictures as well.
        assert done.returncode == 2
    else:
        assert done.returncode in JUDGED
        assert json.loads(done.stdout)["status"] in ("verified", "failed")
        assert f"{stage.named}: the disk" in done.stderr
        assert "--resume" in done.stderr
    assert "Traceback" not in done.stderr
    assert "Logging error" not in done.stderr
    assert not (folder / "report.html").exists()
    check_whole(folder)
    check_resumed(cell, folder)


def test_a_program_that_takes_no_output_is_told_so_once() -> None:
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "mvp", "drivers", "--json"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr.count("error: standard output: ") == 1
    assert "Traceback" not in done.stderr


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own, large enough for a run to begin."""
    place = tmp_path / "disk"
    place.mkdir()
    if sys.platform != "linux" or os.geteuid() != 0 or not shutil.which("mount"):
        pytest.skip("only root on Linux may mount a file system")
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=160m", "tmpfs", place],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode != 0:
        pytest.skip(f"no file system can be mounted here: {mounted.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", place], check=True)


@pytest.mark.parametrize("stage", always(ON_THE_WAY, "v2.png 1"))
def test_a_small_disk_that_fills_up_keeps_what_was_promised(
    stage: Stage, cell: Path, begun: Path, small_disk: Path
) -> None:
    ballast = small_disk / "ballast"
    folder = copied(begun, small_disk)
    done = start(str(ballast), stage, resume_words(cell, folder))
    ballast.unlink(missing_ok=True)
    if done.returncode in JUDGED:
        # The last lines found room in a block that the file had already.
        assert stage.file == "records.jsonl"
    else:
        said = check_said(done, str(folder))
        assert "the disk is full, 0 kB free" in said["message"]
    check_whole(folder)
    check_resumed(cell, folder)
