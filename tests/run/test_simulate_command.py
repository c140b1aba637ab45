"""``mvp-cell simulate``: the far ends stay, and other commands use them."""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from mvp.cell.places import bundled_root
from mvp.cli.main import invoke

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_START_S = 120


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """A simulated cell of our own whose camera needs nothing that may be missing."""
    folder = tmp_path / "cell"
    shutil.copytree(bundled_root() / "simulated_ur", folder)
    file = folder / "cell.toml"
    text = file.read_text(encoding="utf-8")
    begin, end = text.index("[camera]\n"), text.index("[calibration]")
    text = text[:begin] + '[camera]\ndriver = "opencv"\n\n' + text[end:]
    begin = text.index("[simulators.camera]")
    text = text[:begin] + ('[simulators.camera]\nkind = "mjpeg"\n')
    text = text.replace("[simulators.lens]\n", "[simulators.lens]\n", 1)
    file.write_text(text, encoding="utf-8")
    return folder


@pytest.fixture
def simulation(cell: Path) -> Iterator[tuple[subprocess.Popen[str], dict]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "mvp", "simulate", str(cell)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        assert select.select([process.stdout], [], [], _START_S)[0]
        line = process.stdout.readline()
        assert line.startswith("READY "), process.stderr
        yield process, json.loads(line.removeprefix("READY "))
    finally:
        process.kill()
        process.communicate()


def test_other_commands_find_it_and_ctrl_c_ends_it_with_its_children(
    cell: Path,
    simulation: tuple[subprocess.Popen[str], dict],
    capsys: pytest.CaptureFixture[str],
) -> None:
    process, said = simulation
    assert set(said["devices"]) == {"arm", "lens", "camera"}
    code = invoke(["jog", str(cell), "--do", "home", "--do", "j1 3", "--json"])
    first = json.loads(capsys.readouterr().out)
    assert code == 0, first
    code = invoke(["jog", str(cell), "--do", "where", "--json"])
    second = json.loads(capsys.readouterr().out)
    # The arm is still where the first command left it.
    assert second["joints"] == pytest.approx(first["joints"], abs=1e-3)
    children = _children(process.pid)
    assert children
    process.send_signal(signal.SIGINT)
    _, words = process.communicate(timeout=60)
    assert process.returncode == 6, words
    assert "Traceback" not in words
    assert "starting the far end of the arm ..." in words
    assert not [pid for pid in children if _alive(pid)]


def test_there_is_one_simulation_of_a_cell(
    cell: Path,
    simulation: tuple[subprocess.Popen[str], dict],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert simulation
    done = subprocess.run(
        [sys.executable, "-m", "mvp", "simulate", str(cell)],
        capture_output=True,
        text=True,
        timeout=_START_S,
        check=False,
    )
    assert done.returncode == 2
    assert "is running on this cell" in done.stderr
    assert "starting" not in done.stderr


def test_a_virtual_cell_has_nothing_to_simulate(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert invoke(["simulate", "virtual"]) == 2
    assert "[simulators]" in capsys.readouterr().err


def _children(pid: int) -> list[int]:
    listed = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(pid)],
        capture_output=True,
        text=True,
        check=False,
    )
    return [int(word) for word in listed.stdout.split()]


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
