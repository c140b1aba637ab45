"""Results on file: old files load, new ones carry everything, nothing is lost."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from calibration.camera import CameraOptions, calibrate_camera
from calibration.observations import Observations
from calibration.projection import PinholeCamera, project
from calibration.results import camera_calibration, refused
from calibration.verdict import Cause, Verdict
from mvp.calibrated import (
    CameraCalibration,
    LensTableCalibration,
    NamedCovariance,
    Provenance,
    RigidCalibration,
    Validity,
)
from mvp.optics import Sensor

CELLS = Path(__file__).parents[2] / "cell_configs"
KINDS = {
    "camera": CameraCalibration,
    "lens_table": LensTableCalibration,
    "hand_eye": RigidCalibration,
    "part_pose": RigidCalibration,
}


@pytest.mark.parametrize("cell", ["virtual", "simulated_ur", "simulated_gantry"])
@pytest.mark.parametrize("name", KINDS)
def test_every_bundled_file_still_loads(cell, name):
    text = (CELLS / cell / "calibration" / f"{name}.json").read_text()
    found = KINDS[name].model_validate_json(text)
    assert found.provenance.origin in ("measured", "nominal")
    assert found.quality.causes == []


def calibrated():
    rng = np.random.default_rng(0)
    camera = PinholeCamera(2400.0, 2400.0, 640.0, 512.0, k1=-0.1)
    points = np.zeros((80, 3))
    points[:, :2] = np.mgrid[0:10, 0:8].T.reshape(-1, 2) * 20 - [90, 70]
    turns = Rotation.from_euler("xyz", [[33, 0, 0], [0, 33, 10], [-30, 5, 0]], True)
    pixels = project(
        camera, turns.as_matrix()[:, None], np.array([0, 0, 500.0]), points
    )
    pixels = pixels + rng.normal(0, 0.1, pixels.shape)
    seen = Observations.from_views([points] * 3, list(pixels), size_px=(1280, 1024))
    free = ("fx_px", "fy_px", "cx_px", "cy_px", "k1")
    return calibrate_camera(seen, CameraOptions(free=free, sigma_px=0.1))


def test_a_camera_result_survives_its_file():
    found = calibrated()
    written = camera_calibration(
        found,
        sensor=Sensor(1280, 1024, 0.005, 0.005),
        provenance=Provenance(
            date="2026-11-22",
            device_serial="C1",
            method="12 views",
            serial_numbers={"lens": "L7"},
        ),
        validity=Validity(temperature_min_c=15, temperature_max_c=25),
    )
    text = written.model_dump_json(by_alias=True)
    back = CameraCalibration.model_validate_json(text)
    assert back == written
    assert back.quality.condition == pytest.approx(found.estimate.condition)
    assert [view.name for view in back.quality.views] == ["view 1", "view 2", "view 3"]
    assert back.covariance is not None
    spread = np.sqrt(np.diag(back.covariance.matrix))
    assert spread[2] == pytest.approx(back.standard_deviation["centre_x_px"])
    assert "k2" not in back.standard_deviation
    assert json.loads(text)["provenance"]["serial_numbers"] == {"lens": "L7"}
    assert back.quality.weakest_direction


def test_a_refused_camera_says_why_in_codes_and_remarks_are_none():
    causes = (
        Cause("remark", "go", "by the way", ""),
        Cause("vague", "marginal", "it is vague", "look again"),
        Cause("one-axis", "no-go", "one axis only", "turn about another"),
    )
    found = replace(calibrated(), verdict=Verdict(causes))
    stamp = Provenance(date="2026-11-22", device_serial="C1", method="3 views")
    sensor = Sensor(1280, 1024, 0.005, 0.005)
    quality = camera_calibration(found, sensor=sensor, provenance=stamp).quality
    assert [cause.code for cause in quality.causes] == ["one-axis", "vague"]
    assert quality.verdict == "no-go"
    assert quality.next_action == "turn about another"
    assert quality.causes == refused(found.verdict).causes


def test_a_covariance_that_does_not_fit_its_names_is_refused():
    with pytest.raises(ValidationError, match="must be 2 x 2"):
        NamedCovariance(parameters=["a", "b"], matrix=[[1.0]])


def test_a_temperature_range_upside_down_is_refused():
    with pytest.raises(ValidationError, match="above"):
        Validity(temperature_min_c=30, temperature_max_c=20)
