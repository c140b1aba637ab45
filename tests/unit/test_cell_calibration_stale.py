"""A calibration that was made with others than are in place is found and refused."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvp.calibrated import CameraCalibration
from mvp.calibrated.content import inputs_sha256, numbers_sha256
from mvp.cell.calibration_items import file_items
from mvp.cell.calibrations import with_part_pose
from mvp.cell.check_job import load_unjudged
from mvp.cell.loading import load_cell
from mvp.cell.places import bundled_root
from mvp.cli.main import invoke
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

NAMES = ("camera", "lens_table", "hand_eye", "part_pose")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A virtual cell whose files say what they were made with."""
    source = bundled_root() / "virtual"
    folder = shutil.copytree(source, tmp_path / "cell", copy_function=shutil.copyfile)
    found = load_cell(str(folder)).calibrations
    for name in NAMES:
        made = inputs_sha256(name, found.camera, found.lens_table, found.hand_eye)
        changed(
            folder, name, lambda c, made=made: c["provenance"].update(built_on=made)
        )
    return folder


def changed(folder: Path, name: str, edit: Callable[[dict], object]) -> None:
    path = folder / "calibration" / f"{name}.json"
    content = json.loads(path.read_text())
    edit(content)
    path.write_text(json.dumps(content))


def lens_is_measured_anew(folder: Path) -> None:
    def longer(content: dict) -> None:
        values = content["focus_extension_mm"]["values_mm"]
        content["focus_extension_mm"]["values_mm"] = [v + 0.004 for v in values]

    changed(folder, "lens_table", longer)


def stale(folder: Path) -> list[tuple[str, bool]]:
    found = load_cell(str(folder), accept_calibration="a look at it").calibrations
    return [(one.name, one.refused) for one in found.objections if one.stale]


def test_files_that_were_made_with_each_other_are_not_stale(folder: Path) -> None:
    assert load_cell(str(folder)).calibrations.objections == ()


def test_a_newer_lens_table_makes_hand_eye_and_part_stale(folder: Path) -> None:
    lens_is_measured_anew(folder)
    with pytest.raises(CalibrationError) as caught:
        load_cell(str(folder))
    said = caught.value.message.splitlines()
    assert len(said) == 2
    assert "hand_eye.json: this hand_eye calibration is stale" in said[0]
    assert "made with another lens_table calibration than the lens_table in" in said[0]
    assert "lens_table.json, of 2026-" in said[0]
    assert "part_pose.json: this part_pose calibration is stale" in said[1]
    first, then = caught.value.hint.splitlines()
    assert "`mvp-cell calibrate hand-eye CELL` measures it" in first
    assert "`mvp-cell calibrate part CELL` measures it" in then
    accepted = load_cell(str(folder), accept_calibration="a trial").calibrations
    assert accepted.accepted == {"hand_eye": "a trial", "part_pose": "a trial"}


def test_a_new_camera_result_leaves_the_lens_table_as_it_is(folder: Path) -> None:
    changed(folder, "camera", lambda c: c.update(centre_x_px=c["centre_x_px"] + 0.7))
    assert stale(folder) == [("hand_eye", True), ("part_pose", True)]


def test_other_pixels_make_everything_stale(folder: Path) -> None:
    binned = {"width_px": 160, "height_px": 128, "pitch_x_um": 40.0, "pitch_y_um": 40.0}
    changed(folder, "camera", lambda c: c.update(binned))
    assert [name for name, _ in stale(folder)] == [
        "lens_table",
        "hand_eye",
        "part_pose",
    ]
    with pytest.raises(CalibrationError, match="another size or pitch of pixels than"):
        load_cell(str(folder))


def test_a_newer_hand_eye_makes_the_part_stale_but_not_for_who_looks_for_it(
    folder: Path,
) -> None:
    changed(folder, "hand_eye", lambda c: c["matrix"][0].__setitem__(3, 1.25))
    assert stale(folder) == [("part_pose", True)]
    looking = load_cell(str(folder), finds_part=True).calibrations
    assert [one.name for one in looking.warnings] == ["part_pose"]


def test_a_part_pose_of_a_task_is_held_against_the_cell_as_well(folder: Path) -> None:
    found = load_cell(str(folder)).calibrations
    changed(
        folder, "part_pose", lambda c: c["provenance"]["built_on"].update(camera="0")
    )
    with pytest.raises(CalibrationError, match="with another camera calibration"):
        with_part_pose(found, found.files["part_pose"], simulated=True)


def test_words_about_a_result_do_not_make_others_stale(folder: Path) -> None:
    changed(folder, "lens_table", lambda c: c["provenance"].update(temperature_c=21.0))
    changed(folder, "lens_table", lambda c: c["quality"].update(reasons=["as good"]))
    changed(
        folder, "lens_table", lambda c: c["iris_a_mm"].update(approach="from_above")
    )
    assert stale(folder) == []


def test_what_is_as_by_default_has_no_part_in_a_hash() -> None:
    camera = load_cell("virtual").calibrations.camera
    spelt = CameraCalibration.model_validate(camera.model_dump(by_alias=True))
    assert numbers_sha256(spelt) == numbers_sha256(camera)
    bare = camera.model_dump(by_alias=True, exclude_defaults=True)
    assert numbers_sha256(CameraCalibration.model_validate(bare)) == numbers_sha256(
        camera
    )


def test_nominal_values_were_not_made_with_anything(folder: Path) -> None:
    changed(folder, "hand_eye", lambda c: c["provenance"].update(origin="nominal"))
    changed(folder, "hand_eye", lambda c: c["quality"].update(verdict="marginal"))
    lens_is_measured_anew(folder)
    assert stale(folder) == [("part_pose", True)]


def silent(folder: Path) -> None:
    """Files that do not say what they were made with; the lens is a day newer."""
    for name in NAMES:
        changed(folder, name, lambda c: c["provenance"].pop("built_on"))
        changed(folder, name, lambda c: c["provenance"].update(date="2026-03-05"))
    changed(folder, "lens_table", lambda c: c["provenance"].update(date="2026-03-06"))


def test_a_part_that_no_camera_found_does_not_age_with_it(folder: Path) -> None:
    silent(folder)
    changed(folder, "part_pose", lambda c: c.update(by_hand_eye=None))
    assert [name for name, _ in stale(folder)] == ["hand_eye"]


@pytest.mark.parametrize("simulated", [True, False])
def test_where_files_do_not_say_dates_tell(folder: Path, simulated: bool) -> None:
    silent(folder)
    changed(folder, "part_pose", lambda c: c.update(by_hand_eye=np.eye(6).tolist()))
    if not simulated:
        text = (folder / "cell.toml").read_text().partition("[world]")[0]
        text = text.replace("simulated = true", "simulated = false")
        (folder / "cell.toml").write_text(text)
        for name in NAMES:
            changed(folder, name, lambda c: c["provenance"].update(simulated=False))
    refused = not simulated
    assert stale(folder) == [("hand_eye", refused), ("part_pose", refused)]
    known = load_cell(str(folder), accept_calibration="a trial").calibrations
    one = next(one for one in known.objections if one.stale)
    assert "is of 2026-03-05, before the lens_table in place" in one.text


def test_a_run_ends_with_two_and_a_check_lists_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lens_is_measured_anew(folder)
    assert invoke(["run", str(folder), "--yes"]) == 2
    assert "hand_eye calibration is stale" in capsys.readouterr().err
    items = {one.name: one for one in file_items(load_unjudged(str(folder)))}
    for name in ("hand_eye", "part_pose"):
        item = items[f"calibration {name}"]
        assert not item.passed
        assert "is stale" in item.detail
        assert "--accept-calibration" in item.hint
