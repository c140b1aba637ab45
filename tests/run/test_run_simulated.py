"""The bundled cells whose drivers and wires are real, end to end."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from drivers._genicam import installed_backends
from mvp.cell.records import RunStarted, read_records
from mvp.cli.main import invoke

if TYPE_CHECKING:
    from pathlib import Path


def run_of(
    cell: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> dict[str, object]:
    """What ``mvp-cell run`` prints, after it has left as it should."""
    code = invoke(["run", cell, "--out", str(out), "--json"])
    said = capsys.readouterr()
    assert code == 0, said.err
    document = json.loads(said.out)
    assert document["status"] == "verified"
    assert document["simulated"] is True
    assert {view["verification"]["verdict"] for view in document["views"]} == {"pass"}
    return dict(document)


def first_record(out: Path) -> RunStarted:
    (folder,) = out.iterdir()
    first = read_records(folder / "records.jsonl")[0]
    assert isinstance(first, RunStarted)
    return first


def test_a_ur_a_theia_lens_and_a_gige_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = installed_backends()["aravis"]
    if missing:
        pytest.skip(f"the GigE camera is simulated by Aravis: {missing}")
    run_of("simulated_ur", tmp_path, capsys)
    first = first_record(tmp_path)
    assert first.simulated
    assert [device.driver for device in first.devices] == ["ur", "theia-mcr", "genicam"]


def test_a_gantry_that_is_homed_an_scf4_lens_and_a_network_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_of("simulated_gantry", tmp_path, capsys)
    first = first_record(tmp_path)
    assert first.simulated
    assert [device.driver for device in first.devices] == ["gantry", "scf4", "opencv"]
    assert all(device.simulated for device in first.devices)
    assert [axis[0] for axis in first.believed_axes] == ["A", "B"]
    assert set(first.believed_axes.values()) == {"nobody: everything is simulated"}


def test_a_gantry_goes_home(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["home", "simulated_gantry", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["joints"] == pytest.approx([150, -250, 480, 0, 0], abs=1e-2)
    assert [axis[0] for axis in document["believed_axes"]] == ["A", "B"]
