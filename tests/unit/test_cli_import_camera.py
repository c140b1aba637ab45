"""``mvp-cell import-camera``: what it puts in place, and what that may claim."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from mvp.calibrated import LensTableCalibration, RigidCalibration
from mvp.calibrated.content import inputs_sha256
from mvp.cell.check_job import load_unjudged
from mvp.cell.init_job import copy_cell
from mvp.cell.loading import load_cell
from mvp.cli.main import invoke
from mvp.errors import CalibrationError
from tests.camera_file_cells import (
    FORMATS,
    FX_PX,
    TERMS,
    Capture,
    camera_of,
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


@pytest.mark.parametrize("form", FORMATS)
def test_what_was_exported_is_imported_to_the_last_digit(
    form: str, cell: Path, capsys: Capture
) -> None:
    terms = TERMS | ({"k3": 0.0} if form == "kalibr" else {})
    before = changed(cell, "camera", **terms).read_bytes()
    document = told(capsys, "import-camera", cell, exported(cell, form))
    assert document["schema"] == "mvp-cell/import-camera/1"
    assert document["format"] == form
    assert document["unused"] == []
    found = camera_of(cell)
    assert found.model_dump(by_alias=True) == document["document"]
    assert found.reference_fx_px == pytest.approx(FX_PX, abs=1e-9)
    assert (found.centre_x_px, found.centre_y_px) == (643.2, 508.7)
    assert {name: getattr(found, name) for name in TERMS} == terms
    assert (found.width_px, found.pitch_x_um) == (1280, 5.0)
    (kept,) = (cell / "calibration" / "previous").iterdir()
    assert document["kept"] == str(kept)
    assert kept.read_bytes() == before


def test_an_import_claims_no_more_than_somebody_knows(
    cell: Path, capsys: Capture
) -> None:
    document = told(capsys, "import-camera", cell, exported(cell, "ros"))
    found = camera_of(cell)
    assert found.provenance.origin == "nominal"
    assert (found.provenance.date, found.provenance.device_serial) == ("unknown", "")
    assert found.provenance.temperature_source == "unknown"
    assert found.provenance.simulated
    assert len(found.provenance.input_sha256) == 64
    assert (found.quality.verdict, found.covariance) == ("marginal", None)
    unsaid = " ".join(document["unsaid"])
    for option in ("--serial", "--date", "--temperature-c", "--sigma"):
        assert option in unsaid
    spread = found.standard_deviation
    assert spread["centre_x_px"] == 20.0
    assert spread["fx_px"] == pytest.approx(FX_PX / 100)
    # k1 may move the farthest corner as much as the centre may be off.
    corner = np.hypot(643.2, 514.3 + 1.0) / FX_PX
    assert spread["k1"] * corner**3 * FX_PX == pytest.approx(20, rel=0.01)
    assert "k2" not in spread
    (warning,) = load_cell(str(cell)).calibrations.warnings  # simulated: only warns
    assert "nominal: imported, and nobody says of which camera" in warning.text
    assert document["objections"] == [
        {"calibration": "camera", "text": warning.text, "fix": warning.fix}
        | {"refused": False}
    ]


SAID = ("--serial", "V-CAM-1", "--date", "2026-01-31", "--temperature-c", "21.5")


def test_with_serial_number_and_date_it_counts_as_measured_but_not_as_good(
    cell: Path, capsys: Capture
) -> None:
    sigmas = ("--sigma", "cx_px=0.5", "--sigma", "k2=0.01")
    path = exported(cell, "opencv")
    document = told(capsys, "import-camera", cell, path, *SAID, *sigmas)
    found = camera_of(cell)
    assert found.provenance.origin == "measured"
    assert found.provenance.serial_numbers == {"camera": "V-CAM-1"}
    assert found.provenance.date == "2026-01-31"
    assert found.provenance.temperature_source == "operator"
    assert found.validity.temperature_max_c == 26.5
    assert found.standard_deviation["centre_x_px"] == 0.5
    assert found.standard_deviation["k2"] == 0.01
    (unsaid,) = document["unsaid"]
    assert "cx_px" not in unsaid
    assert document["objections"][0]["refused"]
    with pytest.raises(CalibrationError, match="MARGINAL: imported from opencv"):
        load_cell(str(cell))
    accepted = load_cell(str(cell), accept_calibration="seen").calibrations.accepted
    assert accepted == {"camera": "seen"}


@pytest.mark.parametrize("said", [(), SAID])
def test_a_real_cell_refuses_an_import_until_somebody_accepts_it(
    said: tuple[str, ...], cell: Path, tmp_path: Path, capsys: Capture
) -> None:
    copy_cell("ur_theia_genicam", tmp_path / "real")
    path = exported(cell, "kalibr")
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if line[0] != "#"))  # by another
    document = told(capsys, "import-camera", tmp_path / "real", path, *said)
    assert not camera_of(tmp_path / "real").provenance.simulated
    loaded = load_unjudged(str(tmp_path / "real")).calibrations
    mine = [one for one in loaded.objections if one.name == "camera"]
    assert mine
    assert all(one.refused and one.waivable for one in mine)
    assert [one.text for one in mine] == [
        one["text"] for one in document["objections"] if one["calibration"] == "camera"
    ]


@pytest.mark.parametrize("form", FORMATS)
def test_a_camera_of_a_simulated_cell_does_not_become_a_real_one_by_export_and_import(
    form: str, cell: Path, tmp_path: Path, capsys: Capture
) -> None:
    copy_cell("ur_theia_genicam", tmp_path / "real")
    before = camera_of(tmp_path / "real")
    path = exported(cell, form)
    error = told(capsys, "import-camera", tmp_path / "real", path, *SAID, code=2)
    assert error["message"].startswith(f"{path}: ")
    assert "comes from a simulated cell" in error["message"]
    assert error["hint"]
    assert camera_of(tmp_path / "real") == before


def test_an_import_replaces_a_camera_that_nobody_may_accept(
    cell: Path, tmp_path: Path, capsys: Capture
) -> None:
    real = tmp_path / "real"
    copy_cell("ur_theia_genicam", real)
    text = exported(cell, "ros").read_text()
    (cell / "theirs.yaml").write_text(text.replace(" simulated cell ", " cell "))
    made = camera_of(real).provenance.model_dump() | {"simulated": True}
    changed(real, "camera", provenance=made)
    with pytest.raises(CalibrationError, match="comes from a simulated cell"):
        load_unjudged(str(real))
    told(capsys, "import-camera", real, cell / "theirs.yaml", *SAID)
    assert not camera_of(real).provenance.simulated
    load_unjudged(str(real))


def test_what_was_made_with_the_camera_before_is_named(
    cell: Path, capsys: Capture
) -> None:
    path = exported(cell, "ros")
    files = cell / "calibration"
    camera = camera_of(cell)
    table = LensTableCalibration.model_validate_json(
        (files / "lens_table.json").read_text()
    )
    hand_eye = RigidCalibration.model_validate_json(
        (files / "hand_eye.json").read_text()
    )
    made = hand_eye.provenance.model_dump()
    made["built_on"] = inputs_sha256("hand_eye", camera, table, hand_eye)
    changed(cell, "hand_eye", provenance=made)
    assert not load_cell(str(cell)).calibrations.objections
    document = told(capsys, "import-camera", cell, path)
    (stale,) = [o for o in document["objections"] if o["calibration"] == "hand_eye"]
    assert stale["refused"]
    assert "stale" in stale["text"]
    with pytest.raises(CalibrationError, match="stale"):
        load_cell(str(cell))


def test_values_that_the_lens_table_has_for_every_zoom_are_said_not_to_count(
    cell: Path, capsys: Capture
) -> None:
    path = exported(cell, "ros")
    changed(cell, "lens_table", by_zoom={"steps": [1200, 1400], "k1": [-0.2, -0.3]})
    assert invoke(["import-camera", str(cell), str(path)]) == 0
    assert "has k1 for every zoom: they count instead" in capsys.readouterr().err


def test_the_file_of_opencvs_own_program_is_taken_and_its_other_keys_are_named(
    cell: Path, capsys: Capture
) -> None:
    path = cell / "out_camera_data.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Sun Jan 31 12:00:00 2026")
    storage.write("image_width", 1280)
    storage.write("image_height", 1024)
    storage.write("fisheye_model", 0)
    storage.write("camera_matrix", np.diag([FX_PX, FX_PX, 1.0]) + CENTRE)
    storage.write("distortion_coefficients", np.array([[-0.1], [0.01], [0], [0], [0]]))
    storage.write("avg_reprojection_error", 0.21)
    storage.release()
    document = told(capsys, "import-camera", cell, path)
    assert document["format"] == "opencv"
    assert document["unused"] == [
        "avg_reprojection_error",
        "calibration_time",
        "fisheye_model",
    ]
    assert camera_of(cell).k2 == 0.01


CENTRE = np.array([[0, 0, 640.0], [0, 0, 500.0], [0, 0, 0]])
