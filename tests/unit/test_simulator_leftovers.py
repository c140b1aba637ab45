"""What a killed simulation leaves behind is removed by the next one, nothing else."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from drivers.simulators.gige.address import AddressLock, CameraProblem
from drivers.simulators.leftovers import OwnFolder, remove_dead_folders

HOST = "127.0.0.123"
KILLED = """
import os
from drivers.simulators.gige.address import AddressLock
from drivers.simulators.line_ends import PtyEnd
end = PtyEnd("arm")
end.plug_in()
AddressLock("127.0.0.124", 1).take()
os.kill(os.getpid(), 9)
"""


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for temporary files of one's own."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def test_folders_and_locks_of_a_killed_process_are_removed_by_the_next_one(
    temporary: Path,
) -> None:
    subprocess.run([sys.executable, "-c", KILLED], check=False)
    assert len(list(temporary.iterdir())) == 2
    lock = AddressLock(HOST, 1.0)
    lock.take()
    mine = OwnFolder()
    assert sorted(temporary.iterdir()) == sorted(
        [mine.path, temporary / f"mvp-cell-gige-{HOST}.lock"]
    )
    mine.remove()
    lock.release()
    assert list(temporary.iterdir()) == []


def test_folders_of_processes_that_live_are_left_alone(temporary: Path) -> None:
    code = (
        "from drivers.simulators.leftovers import OwnFolder\n"
        "import sys; own = OwnFolder(); print(own.path, flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        path = Path(process.stdout.readline().decode().strip())
        remove_dead_folders()
        assert path.is_dir()
        process.kill()
    remove_dead_folders()
    assert not path.exists()
    (temporary / "mvp-cell-simulator-of-somebody").mkdir()
    remove_dead_folders()
    assert list(temporary.iterdir())  # not marked as ours


def test_an_address_is_held_by_one_camera_and_then_by_the_next(temporary: Path) -> None:
    first, second = AddressLock(HOST, 1.0), AddressLock(HOST, 0.1)
    first.take()
    with pytest.raises(CameraProblem, match="another camera"):
        second.take()
    first.release()
    second.take()
    second.release()
    second.release()
