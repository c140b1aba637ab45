"""``mvp-cell check``: all devices at once, warnings beside failures."""

from __future__ import annotations

import json
import shutil
import threading
from typing import TYPE_CHECKING

import pytest

from mvp.cell.check_devices import picture_item
from mvp.cell.check_items import CheckedFrame
from mvp.cell.places import bundled_root
from mvp.cli.main import invoke
from tests.distributions import install

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """A virtual cell of one's own, with small pictures."""
    folder = tmp_path / "cell"
    shutil.copytree(bundled_root() / "virtual", folder, copy_function=shutil.copyfile)
    return folder


def checked(cell: Path, capsys: pytest.CaptureFixture[str], code: int) -> dict:
    capsys.readouterr()
    assert invoke(["check", str(cell), "--json"]) == code
    return json.loads(capsys.readouterr().out)


def items_of(document: dict) -> dict[str, dict]:
    return {item["name"]: item for item in document["items"]}


def judged(file: Path, verdict: str, *reasons: str) -> None:
    content = json.loads(file.read_text())
    content["quality"] = {"verdict": verdict, "reasons": list(reasons)}
    file.write_text(json.dumps(content))


def test_a_good_cell_is_told_with_versions_ages_and_a_picture(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = checked(cell, capsys, 0)
    assert document["schema"] == "mvp-cell/check/1"
    assert document["passed"]
    arm, lens, camera = document["devices"]
    assert [one["role"] for one in document["devices"]] == ["arm", "lens", "camera"]
    assert arm["serial"] == "V-ARM-1"
    assert arm["data_age_ms"] >= 0
    assert lens["homed"] is False
    assert (camera["frame"]["width_px"], camera["frame"]["height_px"]) == (1280, 1024)
    assert 0 < camera["frame"]["mean_grey"] <= 1
    items = items_of(document)
    assert "opencv-contrib-python-headless" in items["OpenCV"]["detail"]
    assert "Python" in items["program"]["detail"]


def test_poor_calibrations_fail_beside_devices_that_are_away(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    judged(cell / "calibration" / "camera.json", "no-go", "nominal values")
    judged(cell / "calibration" / "hand_eye.json", "marginal", "few poses")
    with (cell / "cell.toml").open("a") as file:
        file.write("\n[world.faults.camera]\nunreachable = true\n")
    document = checked(cell, capsys, 4)
    failed = [item["name"] for item in document["items"] if not item["passed"]]
    assert failed == ["calibration camera", "calibration hand_eye", "camera"]
    assert "nominal values" in items_of(document)["calibration camera"]["detail"]
    assert [one["role"] for one in document["devices"]] == ["arm", "lens"]


def test_a_calibration_that_a_person_accepted_is_a_warning(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    judged(cell / "calibration" / "camera.json", "marginal", "few poses")
    capsys.readouterr()
    command = ["check", str(cell), "--json", "--accept-calibration", "a trial"]
    assert invoke(command) == 0
    document = json.loads(capsys.readouterr().out)
    item = items_of(document)["calibration camera"]
    assert item["warning"]
    assert "a trial" in item["detail"]


def test_pictures_of_another_size_than_the_calibration_fail() -> None:
    seen = CheckedFrame(
        width_px=640,
        height_px=512,
        exposure_s=0.01,
        round_trip_ms=5,
        mean_grey=0.5,
        saturated_fraction=0,
    )
    item = picture_item(seen, (1280, 1024))
    assert not item.passed
    assert "640 x 512" in item.detail
    assert "1280 x 1024" in item.detail


def test_opencv_installed_twice_is_a_warning(
    cell: Path,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    install(tmp_path / "site", "opencv-python", "4.9.0")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    item = items_of(checked(cell, capsys, 0))["OpenCV"]
    assert item["warning"]
    assert "opencv-python 4.9.0" in item["detail"]


def test_nothing_is_left_running_after_a_check(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = threading.active_count()
    checked(cell, capsys, 0)
    assert threading.active_count() <= before
