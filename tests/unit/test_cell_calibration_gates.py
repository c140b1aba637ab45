"""Which calibrations a run and a check refuse, in which words, and what may be accepted."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvp.cell.calibrated_devices import accepted_on_devices, require_size
from mvp.cell.calibration_gates import of_serials, of_views
from mvp.cell.hardware import build_devices, opened
from mvp.cell.loading import load_cell
from mvp.cell.places import bundled_names, bundled_root
from mvp.cell.world_building import WorldBodies
from mvp.cli.main import invoke
from mvp.devices import Frame
from mvp.errors import CalibrationError, DeviceFault
from mvp.planning.plan import LensSteps, PlannedView
from mvp.testing import block

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

BODIES = WorldBodies(block((-10.0, -10.0, 0.0), (10.0, 10.0, 10.0)), ())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the virtual cell, with small pictures."""
    source = bundled_root() / "virtual"
    folder = shutil.copytree(source, tmp_path / "cell", copy_function=shutil.copyfile)
    small = {"width_px": 160, "height_px": 128, "pitch_x_um": 40.0, "pitch_y_um": 40.0}
    small |= {"centre_x_px": 80.0, "centre_y_px": 64.0}
    changed(folder, "camera", lambda c: c.update(small))
    return folder


@pytest.fixture
def real(tmp_path: Path) -> Path:
    """A real cell as it would be if everything had been measured."""
    source = bundled_root() / "templates" / "ur_theia_genicam"
    folder = shutil.copytree(source, tmp_path / "real", copy_function=shutil.copyfile)
    for path in (folder / "calibration").glob("*.json"):
        change(path, lambda c: c.update(quality={"verdict": "go"}))
        change(path, lambda c: c["provenance"].update(origin="measured"))
    return folder


def change(path: Path, edit: Callable[[dict], object]) -> None:
    content = json.loads(path.read_text())
    edit(content)
    path.write_text(json.dumps(content))


def changed(folder: Path, name: str, edit: Callable[[dict], object]) -> None:
    change(folder / "calibration" / f"{name}.json", edit)


def refusal(folder: Path, *, accept: str = "") -> CalibrationError:
    with pytest.raises(CalibrationError) as caught:
        load_cell(str(folder), accept_calibration=accept)
    return caught.value


def on_devices(folder: Path, *, accept: str = "") -> dict[str, str]:
    """What a run accepts once its devices have answered."""
    cell = load_cell(str(folder), accept_calibration=accept)
    devices = build_devices(cell, BODIES, {})
    with opened(devices) as infos:
        return accepted_on_devices(cell, devices, infos, [])


def checked(
    folder: Path, capsys: pytest.CaptureFixture[str], code: int, *more: str
) -> list[dict]:
    capsys.readouterr()
    assert invoke(["check", str(folder), "--json", *more]) == code
    return json.loads(capsys.readouterr().out)["items"]


@pytest.mark.parametrize("name", [n for n in bundled_names() if "uncal" not in n])
def test_nothing_speaks_against_a_bundled_cell(name: str) -> None:
    found = load_cell(name).calibrations
    assert found.objections == ()
    assert found.accepted == {}


def test_a_nominal_calibration_warns_in_a_simulated_cell() -> None:
    found = load_cell("virtual_uncalibrated").calibrations
    assert [one.name for one in found.warnings] == [
        "camera",
        "lens_table",
        "hand_eye",
        "part_pose",
    ]
    assert all("is nominal" in one.text for one in found.warnings)
    assert "mvp-cell calibrate hand-eye CELL" in found.warnings[2].fix
    assert found.accepted == {}


def test_a_nominal_calibration_is_refused_in_a_real_cell(real: Path) -> None:
    changed(real, "lens_table", lambda c: c["provenance"].update(origin="nominal"))
    error = refusal(real)
    assert "lens_table calibration is nominal" in error.message
    assert "`mvp-cell calibrate lens CELL`" in error.hint
    loaded = load_cell(str(real), accept_calibration="first light")
    assert loaded.calibrations.accepted == {"lens_table": "first light"}


def test_a_no_go_is_refused_even_when_it_is_nominal(folder: Path) -> None:
    def poor(content: dict) -> None:
        content["provenance"]["origin"] = "nominal"
        content["quality"] = {"verdict": "no-go", "reasons": ["mirrored"]}

    changed(folder, "camera", poor)
    assert "NO-GO: mirrored" in refusal(folder).message


def test_everything_that_is_wrong_is_told_at_once(folder: Path) -> None:
    for name in ("camera", "hand_eye"):
        changed(folder, name, lambda c: c.update(quality={"verdict": "no-go"}))
    message = refusal(folder).message
    assert "camera calibration is NO-GO" in message
    assert "hand_eye calibration is NO-GO" in message


def test_every_missing_file_is_named(folder: Path) -> None:
    for name in ("camera", "part_pose"):
        (folder / "calibration" / f"{name}.json").unlink()
    message = refusal(folder, accept="never mind").message
    assert "calibration.camera" in message
    assert "calibration.part_pose" in message


def test_a_simulated_calibration_is_never_accepted_in_a_real_cell(real: Path) -> None:
    changed(real, "camera", lambda c: c["provenance"].update(simulated=True))
    assert "comes from a simulated cell" in refusal(real, accept="a trial").message


@pytest.mark.parametrize(
    ("role", "wrong"),
    [("camera", "V-CAM-9"), ("lens", "V-LENS-9"), ("arm", "V-ARM-9")],
)
def test_every_device_that_took_part_must_be_there(
    folder: Path, role: str, wrong: str
) -> None:
    changed(
        folder,
        "hand_eye",
        lambda c: c["provenance"].update(serial_numbers={role: wrong}),
    )
    with pytest.raises(CalibrationError, match=f"made with {role} {wrong}"):
        on_devices(folder)
    accepted = on_devices(folder, accept="same make")
    assert accepted == {"hand_eye": "same make"}


@pytest.mark.parametrize(
    ("made_with", "connected", "said"),
    [
        ("", "V-CAM-1", "names no camera; nobody can tell"),
        ("V-CAM-1", "", "was made with camera V-CAM-1; the camera that is connected"),
        ("", "", "names no camera"),
    ],
)
def test_a_serial_number_that_nobody_tells_is_a_warning(
    folder: Path, made_with: str, connected: str, said: str
) -> None:
    changed(folder, "camera", lambda c: c["provenance"].update(device_serial=made_with))
    found = load_cell(str(folder)).calibrations
    (warning,) = of_serials(found, {"camera": connected, "lens": "V-LENS-1"})
    assert said in warning.text
    assert not warning.refused
    changed(folder, "camera", lambda c: c["provenance"].update(origin="nominal"))
    found = load_cell(str(folder)).calibrations
    assert not list(of_serials(found, {"camera": connected, "lens": "V-LENS-1"}))


def test_a_table_from_the_other_side_is_refused(folder: Path) -> None:
    changed(
        folder,
        "camera",
        lambda c: c.update(validity={"approach": "from_above"}),
    )
    with pytest.raises(CalibrationError, match="focus coming from above") as caught:
        on_devices(folder)
    assert "camera.json" in caught.value.message
    assert "calibrate camera" in caught.value.hint


def test_out_of_its_temperature_a_calibration_is_refused(folder: Path) -> None:
    text = (folder / "cell.toml").read_text()
    warm = text.replace("temperature_c = 20.0 ", "temperature_c = 26.0 ")
    (folder / "cell.toml").write_text(warm)
    with pytest.raises(CalibrationError, match="from 15 to 25 deg C, but it is 26"):
        on_devices(folder)
    ranges = {"temperature_min_c": 10.0, "temperature_max_c": 30.0}
    for name in ("camera", "hand_eye", "part_pose"):
        changed(folder, name, lambda c: c.update(validity=ranges))
    steps = {axis: [0, 9000] for axis in ("zoom_steps", "focus_steps", "iris_steps")}
    changed(folder, "lens_table", lambda c: c.update(validity=ranges | steps))
    assert on_devices(folder) == {}
    stated = "[conditions]\ntemperature_c = 31.0\n\n[workspace]"
    (folder / "cell.toml").write_text(warm.replace("[workspace]", stated))
    with pytest.raises(CalibrationError, match="it is 31 deg C"):
        on_devices(folder)


def test_an_unknown_temperature_is_a_warning(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (folder / "cell.toml").read_text()
    (folder / "cell.toml").write_text(text.replace("temperature_c = 20.0 ", ""))
    assert on_devices(folder) == {}
    items = checked(folder, capsys, 0)
    warned = [one for one in items if one["warning"]]
    assert [one["name"] for one in warned] == ["calibrated devices"]
    assert warned[0]["detail"].count("nobody knows how warm") == 4


@pytest.mark.parametrize(
    ("reference", "said"),
    [
        ({"reference_f_mm": 50.0, "reference_d_mm": 51.0}, "f = 50 mm"),
        ({"reference_f_mm": 12.5, "reference_d_mm": 15.5}, "d = 15.5 mm"),
    ],
)
def test_hand_eye_of_another_lens_is_refused(
    folder: Path, reference: dict[str, float], said: str
) -> None:
    changed(folder, "hand_eye", lambda c: c.update(reference))
    error = refusal(folder)
    assert f"hand-eye was measured at {said}" in error.message
    assert "calibrate hand-eye" in error.hint


def test_hand_eye_with_a_tube_is_carried_over(folder: Path) -> None:
    with_tube = {"reference_f_mm": 12.5, "reference_d_mm": 18.0}
    changed(folder, "hand_eye", lambda c: c.update(with_tube))
    assert load_cell(str(folder)).calibrations.objections == ()


def test_hand_eye_without_a_lens_setting_warns(folder: Path) -> None:
    changed(folder, "hand_eye", lambda c: c.pop("reference_d_mm"))
    (warning,) = load_cell(str(folder)).calibrations.warnings
    assert "does not say at which lens setting" in warning.text


def test_check_lists_every_calibration_and_ends_with_two(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed(folder, "camera", lambda c: c.update(quality={"verdict": "marginal"}))
    changed(folder, "part_pose", lambda c: c.update(quality={"verdict": "no-go"}))
    serial = {"serial_numbers": {"lens": "V-LENS-9"}}
    changed(folder, "lens_table", lambda c: c["provenance"].update(serial))
    items = checked(folder, capsys, 2)
    bad = {one["name"]: one for one in items if not one["passed"]}
    assert list(bad) == [
        "calibration camera",
        "calibration part_pose",
        "calibrated devices",
    ]
    assert "MARGINAL" in bad["calibration camera"]["detail"]
    assert all("--accept-calibration" in one["hint"] for one in bad.values())
    accept = ("--accept-calibration", "a trial")
    items = checked(folder, capsys, 0, *accept)
    assert sum("accepted: a trial" in one["detail"] for one in items) == 3


def test_a_step_outside_of_the_validity_is_refused(folder: Path) -> None:
    steps = {
        "zoom_steps": [0, 3200],
        "focus_steps": [1000, 7000],
        "iris_steps": [0, 600],
    }
    changed(folder, "lens_table", lambda c: c.update(validity=steps))
    found = load_cell(str(folder)).calibrations

    def view(focus: int) -> PlannedView:
        steps = LensSteps(zoom=10, focus=focus, iris=20)
        return PlannedView.model_construct(id="v1", lens_steps=steps)

    (objection,) = of_views(found, [view(7001)])
    assert "v1 needs focus step 7001, but the table holds from 1000 to 7000" in (
        objection.text
    )
    assert list(of_views(found, [view(7000)])) == []


def test_a_picture_of_another_mode_of_the_camera_is_refused(folder: Path) -> None:
    known = load_cell(str(folder)).calibrations.camera
    frame = Frame(np.zeros((128, 160), np.uint8), 255, 0.0, 0.01, 0.1, 1)
    require_size(frame, known, "camera")
    turned = replace(frame, pixels=frame.pixels.T)
    with pytest.raises(DeviceFault, match="pictures have 128 x 160 px, but") as caught:
        require_size(turned, known, "camera")
    assert "calibrate the camera at this size" in caught.value.hint
