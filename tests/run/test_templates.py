"""Templates for real hardware: they load, say what to edit, and move nothing."""

from __future__ import annotations

import json
import re
import socket
from typing import TYPE_CHECKING

import pytest

from mvp.cell.hardware import check_driver_configs
from mvp.cell.init_job import copy_cell, lines_to_edit
from mvp.cell.loading import load_cell, load_task
from mvp.cell.places import bundled_names, template_names
from mvp.cli.main import invoke
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(params=template_names())
def template(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A copy, with nobody at its addresses."""
    folder = tmp_path / "cell"
    copy_cell(request.param, folder)
    file = folder / "cell.toml"
    text = file.read_text()
    file.write_text(
        text.replace("192.0.2.10", "127.9.9.9").replace("192.0.2.20", "127.9.9.8")
    )
    return folder


def test_there_are_two_and_none_is_taken_for_a_cell() -> None:
    assert template_names() == ["gantry_scf4_opencv", "ur_theia_genicam"]
    assert not set(template_names()) & set(bundled_names())


def test_it_is_a_complete_cell_for_real_hardware(template: Path) -> None:
    cell = load_cell(str(template), accept_calibration="a look at the template")
    assert not cell.config.simulated
    assert cell.config.world is None
    check_driver_configs(cell)
    assert load_task(cell, None).config.features


def test_its_calibrations_are_refused_as_nominal(template: Path) -> None:
    with pytest.raises(CalibrationError, match="NO-GO: nominal"):
        load_cell(str(template))


def test_it_says_which_lines_to_edit(template: Path) -> None:
    lines = dict(lines_to_edit(template))
    assert len(lines) >= 15
    edited = "\n".join(lines.values())
    for word in ("payload|axes", r"\bport =", "home_joints_deg", "NOMINAL"):
        assert re.search(word, edited), word


def test_check_fails_helpfully_where_nobody_answers(
    template: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert invoke(["check", str(template), "--json"]) == 4
    document = json.loads(capsys.readouterr().out)
    failed = {i["name"]: i for i in document["items"] if not i["passed"]}
    assert set(failed) == {
        *(
            f"calibration {n}"
            for n in ("camera", "lens_table", "hand_eye", "part_pose")
        ),
        *("arm", "lens", "camera"),
    }
    assert all(item["hint"] for item in failed.values())
    assert document["devices"] == []


def test_a_run_ends_before_it_reaches_any_device(
    template: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.9.9.9", 30004)) as robot:
        robot.settimeout(0.2)
        capsys.readouterr()
        assert invoke(["run", str(template), "--yes", "--json"]) == 2
        assert "nominal" in json.loads(capsys.readouterr().out)["message"]
        with pytest.raises(TimeoutError):
            robot.accept()


def test_init_from_a_template_lists_the_lines_and_names_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    assert invoke(["init", str(folder), "--from", "ur_theia_genicam"]) == 0
    said = capsys.readouterr().err
    assert "host =" in said
    assert "mvp-cell check" in said


def test_a_template_cannot_be_run_in_place(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["check", "ur_theia_genicam"]) == 2
    assert "init DIR --from ur_theia_genicam" in capsys.readouterr().err.replace(
        "\n", " "
    )
