"""A hand-eye result as a file."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.hand_eye import (
    Rehearsal,
    RobotNoise,
    calibrate_hand_eye,
    hand_eye_calibration,
    rehearse,
)
from mvp.calibrated import Provenance, RigidCalibration
from mvp.errors import CalibrationError

ROBOT = RobotNoise(0.2, float(np.radians(0.05)))
PLAN = Rehearsal(views=12, robot=ROBOT, columns=5, rows=4, pitch_mm=25.0)
FROM = Provenance(date="2026-01-05", device_serial="c1", method="hand-eye")


def stored(data):
    result = calibrate_hand_eye(data, PLAN.camera, ROBOT)
    return result, hand_eye_calibration(
        result,
        data,
        provenance=FROM,
        stand_off_mm=400.0,
        reference_d_mm=12.9,
        reference_f_mm=12.5,
    )


def test_the_file_holds_the_transform_and_how_good_it_is():
    data = rehearse(PLAN, np.random.default_rng(11)).data
    result, model = stored(data)
    again = RigidCalibration.model_validate_json(model.model_dump_json(by_alias=True))
    found = result.solution
    np.testing.assert_array_equal(again.matrix, found.moving_from_camera.matrix)
    np.testing.assert_array_equal(again.covariance, found.covariance)
    assert (again.target, again.source) == ("tool", "camera")
    assert again.quality.verdict == "go"
    assert again.quality.error_95_mm > found.error_mm(400.0)
    assert [view.name for view in again.quality.views] == list(data.seen.names)


def test_without_a_solution_there_is_no_file():
    data = rehearse(PLAN, np.random.default_rng(11)).data
    with pytest.raises(CalibrationError, match="number of views") as refusal:
        stored(data.of_views(range(4)))
    assert "20 views" in refusal.value.hint
