"""Wizards left alone over real drivers and wires with simulated far ends."""

from __future__ import annotations

import json
import select
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from drivers._genicam import installed_backends
from mvp.cli.main import invoke
from tests.calibrated_cells import FILES, assert_as_good_as_stated, calibrate_all

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_START_S = 120
_FASTER_THAN_LIFE = 40  # motors only: the protocols keep their times
# One zoom, at which 70 pictures tell d as well as 90 over all of the zoom range do.
_ONE_ZOOM = """
[lens_calibration]
zooms = 1
f_mm = 12.5
focuses = 7
"""
# What that zoom offers: f as it was measured, and pupils that blur enough to be measured,
# which are wide and need some distance.
_TASK = {
    "f_mm = 12.5\n": "f_mm = [12.0, 13.0]\n",
    "a_mm = 0.78125\n": "",
    "detail_mm = 0.25 ": "detail_mm = 0.4 ",
}


@pytest.fixture(
    params=[
        pytest.param("one zoom", id="one-zoom"),
        pytest.param("bundled lens", id="bundled-lens", marks=pytest.mark.full),
        pytest.param("all zooms", id="all-zooms", marks=pytest.mark.full),
    ]
)
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A copy of the wired cell, as `init` makes it, with motors that do not dawdle."""
    missing = installed_backends()["aravis"]
    if missing:
        pytest.skip(f"the GigE camera is simulated by Aravis: {missing}")
    path = tmp_path / "cell"
    assert invoke(["init", str(path), "--from", "simulated_ur", "--json"]) == 0
    file, faster = path / "cell.toml", f"speed_scale = {_FASTER_THAN_LIFE}\n"
    kinds = ('kind = "ur"\n', 'kind = "theia"\n')
    _edit(file, {kind: kind + faster for kind in kinds})
    if request.param == "one zoom":
        with file.open("a", encoding="utf-8") as cell:
            cell.write(_ONE_ZOOM)
        _edit(path / "tasks" / "paper_object.toml", _TASK)
    return path


def _edit(file: Path, changes: dict[str, str]) -> None:
    text = file.read_text(encoding="utf-8")
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    file.write_text(text, encoding="utf-8")


@pytest.fixture
def simulation(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """The far ends, which stay from one command to the next."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mvp", "simulate", str(folder)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert select.select([process.stdout], [], [], _START_S)[0]
        assert process.stdout.readline().startswith("READY ")
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=60)


@pytest.mark.timeout(3600)
def test_wizards_left_alone_over_real_wires_lead_to_a_run_that_passes(
    folder: Path,
    simulation: subprocess.Popen[str],
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    bundled = "bundled" in request.node.name
    kinds = tuple(kind for kind in FILES if kind != "lens" or not bundled)
    calibrate_all(folder, capsys, kinds)
    assert_as_good_as_stated(folder, kinds)
    capsys.readouterr()
    out = str(folder / "runs")
    code = invoke(["run", str(folder), "--yes", "--json", "--out", out])
    said = capsys.readouterr()
    assert code == 0, said.err
    assert json.loads(said.out)["status"] == "verified"
    assert simulation.poll() is None
