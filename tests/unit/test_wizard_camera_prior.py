"""What the wizards take to be open of the intrinsics, and why it matters."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.hand_eye import (
    CameraPrior,
    Rehearsal,
    RobotNoise,
    calibrate_hand_eye,
    rehearse,
)
from calibration.poses import difference, only
from calibration.projection import PinholeCamera
from calibration.wizard.camera_prior import camera_prior
from calibration.wizard.working import working_setting
from mvp.calibrated import NamedCovariance, ZoomTable
from tests.small_cells import Cell

MOVING = ("cx_px", "cy_px", "k1", "p1", "p2")
SIGMAS = np.array([0.3, 0.3, 2e-3, 6e-5, 7e-5])


@pytest.fixture(scope="module")
def facts():
    cell = Cell("hand-eye")
    yield cell.facts
    cell.close()


def covariance():
    """As from pictures: the centre and the decentring of its axis go together."""
    shares = np.eye(5)
    shares[0, 4] = shares[4, 0] = 0.9
    shares[1, 3] = shares[3, 1] = 0.7
    return shares * np.outer(SIGMAS, SIGMAS)


def told(facts, **updates):
    camera = facts.camera.model_copy(update=updates)
    return facts.model_copy(update={"camera": camera})


def test_everything_that_was_measured_may_move_as_it_goes_together(facts):
    order = [4, 2, 0, 1, 3]
    found = NamedCovariance(
        parameters=[MOVING[place] for place in order],
        matrix=covariance()[np.ix_(order, order)].tolist(),
    )
    facts = told(facts, covariance=found)
    prior = camera_prior(facts, working_setting(facts))
    assert prior.names == ("fx_px", "fy_px", *MOVING)
    np.testing.assert_allclose(prior.covariance[2:, 2:], covariance())
    assert not prior.covariance[:2, 2:].any()


def test_what_nobody_measured_stays_but_for_rounding(facts):
    facts = told(facts, standard_deviation={"centre_x_px": 0.4, "k2": 0.02})
    prior = camera_prior(facts, working_setting(facts))
    assert prior.names == ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2")
    deviations = np.sqrt(np.diag(prior.covariance))[2:]
    np.testing.assert_allclose(deviations, [0.4, 0.05, 1e-4, 0.02])


def test_a_centre_by_zoom_is_as_uncertain_as_the_lens_table_says(facts):
    matrix = covariance().tolist()
    found = NamedCovariance(parameters=list(MOVING), matrix=matrix)
    zoomed = ZoomTable(
        steps=[facts.lens_table.zoom_f_mm.steps[0]],
        centre_x_px=[160.0],
        centre_y_px=[128.0],
        standard_deviation={"centre_x_px": 0.9, "centre_y_px": 0.8},
    )
    facts = told(facts, covariance=found)
    table = facts.lens_table.model_copy(update={"by_zoom": zoomed})
    facts = facts.model_copy(update={"lens_table": table})
    prior = camera_prior(facts, working_setting(facts))
    expected = np.diag(np.square([0.9, 0.8, *SIGMAS[2:]]))
    np.testing.assert_allclose(prior.covariance[2:, 2:], expected)


def error_by_sigma(seen, prior):
    """(6,): of the transform."""
    robot = RobotNoise(0.05, float(np.radians(0.01)))
    solution = calibrate_hand_eye(seen.data, prior, robot).solution
    found = only(solution.moving_from_camera)
    off = difference(found, seen.moving_from_camera)[0]
    return off / np.sqrt(np.diag(solution.covariance))


def test_decentring_held_fixed_turns_hand_eye_more_than_is_stated():
    """A robot without errors shows it; with the decentring free the interval holds."""
    rng = np.random.default_rng(8)
    true = PinholeCamera(2272.0, 2272.0, 799.5, 599.5, -0.1)
    plan = Rehearsal(
        views=8, columns=7, rows=5, pitch_mm=25.0, sigma_px=0.03, camera=true
    )
    free, held = [], []
    for _ in range(3):
        seen = rehearse(plan, rng)
        cx, cy, k1, p1, p2 = rng.multivariate_normal(np.zeros(5), covariance())
        believed = PinholeCamera(
            2272.0, 2272.0, 799.5 + cx, 599.5 + cy, -0.1 + k1, p1=p1, p2=p2
        )
        free.append(error_by_sigma(seen, CameraPrior(believed, MOVING, covariance())))
        some = CameraPrior(believed, MOVING[:3], covariance()[:3, :3])
        held.append(error_by_sigma(seen, some))
    about_x_and_y = slice(3, 5)
    assert np.sqrt(np.mean(np.square(free)[:, about_x_and_y])) < 1.5
    assert np.sqrt(np.mean(np.square(held)[:, about_x_and_y])) > 2
