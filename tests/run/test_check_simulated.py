"""``mvp-cell check`` through real drivers: simulated cells, and one that is in use."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from drivers._genicam import installed_backends
from mvp.cell.check_job import load_unjudged
from mvp.cell.in_use import using_devices
from mvp.cell.init_job import copy_cell
from mvp.cell.loading import load_cell
from mvp.cli.main import invoke

if TYPE_CHECKING:
    from pathlib import Path


def checked(cell: str, code: int, capsys: pytest.CaptureFixture[str]) -> dict:
    capsys.readouterr()
    assert invoke(["check", cell, "--json"]) == code
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("cell", ["simulated_ur", "simulated_gantry"])
def test_every_device_of_a_simulated_cell_answers_and_shows_the_world(
    cell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if cell == "simulated_ur" and installed_backends()["aravis"]:
        pytest.skip(installed_backends()["aravis"])
    document = checked(cell, 0, capsys)
    devices = {one["role"]: one for one in document["devices"]}
    assert set(devices) == {"arm", "lens", "camera"}
    assert all(one["simulated"] for one in devices.values())
    known = load_cell(cell).calibrations.camera
    frame = devices["camera"]["frame"]
    assert (frame["width_px"], frame["height_px"]) == (known.width_px, known.height_px)
    assert frame["mean_grey"] > 0.02
    assert devices["arm"]["homed"] is (False if cell == "simulated_gantry" else None)
    warned = {item["name"] for item in document["items"] if item["warning"]}
    assert ("arm hard limits" in warned) is (cell == "simulated_gantry")
    assert ("lens stop" in warned) is (cell == "simulated_ur")  # a Theia runs on
    libraries = [i["detail"] for i in document["items"] if "library" in i["name"]]
    assert any("pyserial" in text for text in libraries)


def test_a_cell_in_use_is_not_disturbed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "cell"
    copy_cell("gantry_scf4_opencv", folder)
    with using_devices(load_unjudged(str(folder)), who="a run"):
        document = checked(str(folder), 2, capsys)
    assert "a run" in document["message"]
