"""``mvp-cell export-camera``: other programs see what the run sees, or are told why not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from mvp.cell.check_job import load_unjudged
from mvp.cell.init_job import copy_cell
from mvp.kinematics import intrinsics_of
from mvp.optics import LensTable, principal_distance_mm
from tests.camera_file_cells import (
    FX_PX,
    STEPS,
    TERMS,
    Capture,
    changed,
    exported,
    told,
)

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """The virtual cell in a folder of its own."""
    copy_cell("virtual", tmp_path / "cell")
    return tmp_path / "cell"


def test_opencv_sees_with_the_exported_file_what_the_run_sees(cell: Path) -> None:
    changed(cell, "camera", **TERMS)
    storage = cv2.FileStorage(str(exported(cell, "opencv")), cv2.FILE_STORAGE_READ)
    matrix = storage.getNode("camera_matrix").mat()
    terms = storage.getNode("distortion_coefficients").mat()
    size = [storage.getNode(f"image_{side}").real() for side in ("width", "height")]
    storage.release()
    assert size == [1280, 1024]
    assert matrix[0, 0] == pytest.approx(FX_PX, abs=1e-9)
    points = np.random.default_rng(5).uniform([-80, -60, 280], [80, 60, 330], (200, 3))
    theirs = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, terms)[0]
    loaded = load_unjudged(str(cell)).calibrations
    lens = LensTable.from_calibration(loaded.lens_table).setting(1300, 3000, 120)
    f_cal = float(principal_distance_mm(lens.d_mm, lens.f_mm, lens.e_mm))
    ours = intrinsics_of(loaded.camera).at(lens.centre_px, lens.k1)
    off = theirs[:, 0] - ours.project(points, f_cal)
    assert np.abs(off).max() < 1e-6


@pytest.mark.parametrize("form", ["ros", "kalibr"])
def test_a_common_reader_finds_numbers_in_the_exported_file(
    form: str, cell: Path
) -> None:
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    terms = TERMS | ({"k3": 0.0} if form == "kalibr" else {})
    changed(cell, "camera", **terms)
    found = yaml.safe_load(exported(cell, form).read_text())
    if form == "ros":
        fx, _, cx, _, fy, cy = found["camera_matrix"]["data"][:6]
        coefficients = found["distortion_coefficients"]["data"]
        assert found["camera_name"] == "virtual"
        assert (found["image_width"], found["image_height"]) == (1280, 1024)
    else:
        fx, fy, cx, cy = found["cam0"]["intrinsics"]
        coefficients = found["cam0"]["distortion_coeffs"]
        assert found["cam0"]["resolution"] == [1280, 1024]
    assert [fx, fy, cx, cy] == pytest.approx([FX_PX, FX_PX, 643.2, 508.7], abs=1e-9)
    assert coefficients == list(terms.values())[: len(coefficients)]


def test_the_file_says_of_which_lens_setting_it_is(cell: Path, capsys: Capture) -> None:
    line = ("export-camera", cell, "--out", cell / "c.yml")
    document = told(capsys, *line, "--at", STEPS)
    assert document["schema"] == "mvp-cell/export-camera/1"
    assert document["lens_steps"] == {"zoom": 1300, "focus": 3000, "iris": 120}
    assert document["principal_distance_mm"] == pytest.approx(FX_PX * 0.005)
    text = (cell / "c.yml").read_text()
    assert "zoom 1300, focus 3000, iris 120" in text
    assert "# measured, 2026-11-22, GO\n" in text
    changed(cell, "camera", reference_fx_px=2600.5, reference_fy_px=2600.25)
    document = told(capsys, *line)
    assert document["lens_steps"] is None
    assert "as it stood when the camera was calibrated" in document["setting"]
    assert "2600.5, 0.0, 643.2, 0.0, 2600.25, 508.7" in (cell / "c.yml").read_text()


def test_a_zoom_with_a_centre_and_k1_of_its_own_is_exported_with_these(
    cell: Path,
) -> None:
    by_zoom = {"steps": [1200, 1400], "k1": [-0.2, -0.3]}
    by_zoom |= {"centre_x_px": [640.0, 642.0], "centre_y_px": [500.0, 504.0]}
    changed(cell, "lens_table", by_zoom=by_zoom)
    text = exported(cell, "kalibr").read_text()
    assert "641.0, 502.0]" in text
    assert "distortion_coeffs: [-0.25, 0.0" in text


@pytest.mark.parametrize(
    ("more", "words", "hint"),
    [
        ((), "no principal distance", "--at 1253,"),
        (("--at", "1300,3000"), "three whole numbers", "ZOOM,FOCUS,IRIS"),
        (("--at", "1300,3000,x"), "three whole numbers", "ZOOM,FOCUS,IRIS"),
        (("--at", "4000,3000,120"), "zoom step 4000 is outside", "3200"),
        (("--at", STEPS, "--to", "tsai"), "no such format", "opencv, ros, kalibr"),
        (("--at", STEPS, "--out", "c.json"), "a YAML file", "c.yaml"),
        (("--at", STEPS, "--out", "."), "a YAML file", "camera.yaml"),
        (("--at", STEPS, "--out", "nowhere/c.yaml"), "nowhere", "permissions"),
    ],
)
def test_what_cannot_be_exported_is_refused(
    more: tuple[str, ...],
    words: str,
    hint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
) -> None:
    monkeypatch.chdir(tmp_path)
    error = told(capsys, "export-camera", "virtual", *more, code=2)
    assert words in error["message"]
    assert hint in error["hint"]
    assert not list(tmp_path.iterdir())


def test_steps_at_which_the_lens_table_does_not_hold_are_refused(
    cell: Path, capsys: Capture
) -> None:
    steps = {"zoom_steps": [0, 1200], "focus_steps": [0, 8000], "iris_steps": [0, 600]}
    changed(cell, "lens_table", validity=steps)
    error = told(capsys, "export-camera", cell, "--at", STEPS, code=2)
    assert "lens_table.json: zoom step 1300" in error["message"]
    assert "0 .. 1200" in error["hint"]


def test_k3_is_named_where_kalibr_cannot_say_it(cell: Path, capsys: Capture) -> None:
    changed(cell, "camera", k3=0.5)
    line = ("export-camera", cell, "--to", "kalibr", "--at", STEPS)
    error = told(capsys, *line, "--out", cell / "c.yaml", code=2)
    assert "no k3 (it is 0.5 here)" in error["message"]
    assert error["where"].endswith("camera.json")
    assert not (cell / "c.yaml").exists()


def test_a_poor_camera_leaves_the_cell_only_with_a_reason(
    tmp_path: Path, capsys: Capture
) -> None:
    copy_cell("ur_theia_genicam", tmp_path / "real")
    steps = load_unjudged(str(tmp_path / "real")).calibrations.lens_table
    axes = (steps.zoom_f_mm, steps.focus_extension_mm, steps.iris_a_mm)
    at = ",".join(str(axis.steps[0]) for axis in axes)
    out = tmp_path / "c.yaml"
    line = ("export-camera", tmp_path / "real", "--at", at, "--out", out)
    error = told(capsys, *line, code=2)
    assert "camera calibration is nominal" in error["message"]
    assert "hand_eye" not in error["message"]
    assert not out.exists()
    document = told(capsys, *line, "--accept-calibration", "only\nto look")
    assert document["verdict"] == "no-go"
    assert any("NO-GO" in warning for warning in document["warnings"])
    assert "# accepted by a person: only to look\n" in out.read_text()
