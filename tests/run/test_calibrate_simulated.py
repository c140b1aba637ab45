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
from tests.calibrated_cells import (
    FILES,
    assert_as_good_as_stated,
    calibrate_all,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_START_S = 120
_FASTER_THAN_LIFE = 10  # motors only: the protocols keep their times
# Without the lens, whose 90 pictures take as long as all others together.
_SHORT = ("camera", "hand-eye", "part")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
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
    file.write_text(text, encoding="utf-8")
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
    "kinds",
    [
        pytest.param(_SHORT, id="three"),
        pytest.param(tuple(FILES), id="four", marks=pytest.mark.full),
    ],
)
def test_wizards_left_alone_over_real_wires_lead_to_a_run_that_passes(
    folder: Path,
    simulation: subprocess.Popen[str],
    capsys: pytest.CaptureFixture[str],
    kinds: tuple[str, ...],
) -> None:
    calibrate_all(folder, capsys, kinds)
    assert_as_good_as_stated(folder, kinds)
    capsys.readouterr()
    out = str(folder / "runs")
    code = invoke(["run", str(folder), "--yes", "--json", "--out", out])
    said = capsys.readouterr()
    assert code == 0, said.err
    assert json.loads(said.out)["status"] == "verified"
    assert simulation.poll() is None
