"""The four wizards, left alone over real drivers and wires with simulated far ends."""

from __future__ import annotations

import json
import select
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from drivers._genicam import installed_backends
from mvp.cli.main import invoke
from tests.calibrated_cells import assert_as_good_as_stated, calibrate_all

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_START_S = 120
_FASTER_THAN_LIFE = 10  # motors only: the protocols keep their times
_WHOLE = ""
# The zoom range that the task uses, as somebody would have it who is in a hurry.
_USED = """
[lens_calibration]
zooms = 2
focuses = 4
irises = 3
f_mm = [10, 16]
"""


@pytest.fixture
def folder(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """A copy of the wired cell, as `init` makes it, with motors that do not dawdle."""
    missing = installed_backends()["aravis"]
    if missing:
        pytest.skip(f"the GigE camera is simulated by Aravis: {missing}")
    path = tmp_path / "cell"
    assert invoke(["init", str(path), "--from", "simulated_ur", "--json"]) == 0
    file = path / "cell.toml"
    text = file.read_text(encoding="utf-8")
    for kind in ('kind = "ur"\n', 'kind = "theia"\n'):
        assert text.count(kind) == 1
        text = text.replace(kind, f"{kind}speed_scale = {_FASTER_THAN_LIFE}\n")
    file.write_text(text + request.param, encoding="utf-8")
    return path


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
@pytest.mark.parametrize(
    "folder",
    [
        pytest.param(_USED, id="the zoom that is used"),
        pytest.param(_WHOLE, id="the whole lens", marks=pytest.mark.full),
    ],
    indirect=True,
)
def test_four_calibrations_over_real_wires_and_a_run_that_passes(
    folder: Path,
    simulation: subprocess.Popen[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    calibrate_all(folder, capsys)
    assert_as_good_as_stated(folder)
    capsys.readouterr()
    out = str(folder / "runs")
    code = invoke(["run", str(folder), "--yes", "--json", "--out", out])
    said = capsys.readouterr()
    assert code == 0, said.err
    assert json.loads(said.out)["status"] == "verified"
    assert simulation.poll() is None
