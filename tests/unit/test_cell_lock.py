"""One command at a time on one real cell, and no lock file left behind."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from typing import TYPE_CHECKING

import pytest

from mvp.cell.lock import (
    cell_lock,
    held_by,
    holding,
    lock_file,
    private_file,
    refuse_held,
    remove_dead,
)
from mvp.cell.places import bundled_root
from mvp.errors import OutputError, RecordError

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def cell_file(tmp_path: Path) -> Path:
    file = tmp_path / "cell" / "cell.toml"
    file.parent.mkdir()
    file.write_text("")
    return file


def test_a_real_cell_has_one_lock_wherever_the_results_go(
    cell_file: Path, tmp_path: Path
) -> None:
    link = tmp_path / "link"
    link.symlink_to(cell_file.parent)
    files = {lock_file(cell) for cell in (cell_file, link / "cell.toml")}
    assert files == {cell_file.parent / ".mvp-cell.lock"}


def test_a_bundled_or_read_only_cell_is_locked_in_a_private_folder(
    cell_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    bundled = bundled_root() / "virtual" / "cell.toml"
    lock = lock_file(bundled)
    assert lock.parent == tmp_path / f"mvp-cell-{os.getuid()}"
    assert lock.parent.stat().st_mode & 0o777 == 0o700
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    other = lock_file(cell_file)
    assert other.parent == lock.parent
    assert other != lock
    lock.parent.chmod(0o777)
    with pytest.raises(OutputError, match="private"):
        lock_file(bundled)


def test_a_file_is_held_as_it_is_and_looking_at_it_takes_nothing(
    tmp_path: Path,
) -> None:
    file = tmp_path / "records.jsonl"
    file.write_text("one line\n")
    refuse_held(file)
    with holding(file, what="the run"):
        with pytest.raises(RecordError, match="the run is going on"):
            holding(file, what="the run").__enter__()
        with pytest.raises(RecordError, match="another process"):
            refuse_held(file)
        assert held_by(file) == ""
    assert held_by(file) is None
    assert file.read_text() == "one line\n"


def test_what_dead_processes_left_in_the_private_folder_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    dead = private_file(tmp_path / "one" / "cell.toml", ".simulation.lock")
    dead.write_text('{"pid": 1, "host": "x", "run": "simulate"}')
    dead.with_suffix(".json").write_text("{}")
    alive = private_file(tmp_path / "two" / "cell.toml", ".simulation.lock")
    with cell_lock(alive, run_id="simulate"):
        alive.with_suffix(".json").write_text("{}")
        remove_dead()
        assert sorted(dead.parent.iterdir()) == sorted(
            [alive, alive.with_suffix(".json")]
        )


def test_the_lock_is_refused_while_held_and_gone_afterwards(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "x.lock"
    with cell_lock(path, run_id="first") as crashed:
        assert not crashed
        assert held_by(path) == "first"
        with pytest.raises(RecordError, match="first"), cell_lock(path, run_id="b"):
            pass
    assert held_by(path) is None
    assert not path.exists()


def test_a_lock_left_by_a_dead_process_is_recognised(tmp_path: Path) -> None:
    path = tmp_path / "x.lock"
    code = (
        "import os, sys; from pathlib import Path; from mvp.cell.lock import cell_lock\n"
        "with cell_lock(Path(sys.argv[1]), run_id='dead'): os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", code, path], check=False)
    assert path.exists()
    assert held_by(path) is None
    with cell_lock(path, run_id="next") as crashed:
        assert crashed
    assert not path.exists()


def test_many_processes_never_hold_the_lock_together(tmp_path: Path) -> None:
    code = """
import sys, time
from pathlib import Path
from mvp.cell.lock import cell_lock
from mvp.errors import RecordError
lock, inside = Path(sys.argv[1]), Path(sys.argv[2])
held = 0
while held < 40:
    try:
        with cell_lock(lock, run_id="x"):
            inside.open("x").close()
            inside.unlink()
            held += 1
    except RecordError:
        time.sleep(0.001)
"""
    words = [sys.executable, "-c", code, tmp_path / "x.lock", tmp_path / "inside"]
    runs = [subprocess.Popen(words) for _ in range(3)]
    assert [run.wait(timeout=120) for run in runs] == [0, 0, 0]
