"""Principal distance and pupil from a squarely faced target and a travel."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.lens_table import (
    TravelPrior,
    TravelShots,
    camera_from_tool,
    measure_travel,
    next_direction,
)
from calibration.lens_table.travel_problem import (
    TravelProblem,
    TravelState,
)
from calibration.projection import PinholeCamera
from mvp.errors import CalibrationError
from mvp.testing.paraxial_lens import ParaxialLens

PITCH_MM, CENTRE = 0.0055, np.array([800.0, 600.0])
LENS = ParaxialLens.thin(f_mm=12.5, d_mm=12.5 * 250 / 237.5, e_mm=8.0, a_mm=1.0)
F_CAL = float(LENS.scale(100.0)) * 100.0
PUPIL_MM = 242.0
PRIOR = TravelPrior((800.0, 600.0), 2.0)


def grid(travel_mm):
    """12 x 9 points that fill 80 % of the short side at the nearest stop."""
    side = 0.8 * 1200 * PITCH_MM / float(LENS.scale(PUPIL_MM - travel_mm / 2))
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 12), np.linspace(-0.5, 0.5, 9))
    return np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) * side


def seen(points, rng, sigma_px):
    """Chief rays of points (m, 3) in camera axes, distorted on the sensor."""
    sensor = points[:, :2] * LENS.scale(points[:, 2])[:, None]
    r2 = (sensor**2).sum(axis=1, keepdims=True)
    distorted = sensor * (1 + 2e-3 / F_CAL**2 * r2)
    return distorted / PITCH_MM + CENTRE + rng.normal(0, sigma_px, sensor.shape)


def travelled(
    rng,
    *,
    travel_mm=75.0,
    sigma_mm=0.02,
    direction=(0.012, -0.012, 1.0),
    tilt=(0.006, 0.006, 0.1),
    sigma_px=0.1,
    stops=9,
):
    along = np.asarray(direction) / np.linalg.norm(direction)
    points = grid(travel_mm)
    travel = np.linspace(-travel_mm / 2, travel_mm / 2, stops)
    pixels = []
    for s in travel:
        turn = Rotation.from_rotvec(rng.normal(0, 1e-4, 3))
        shift = rng.normal(0, sigma_mm, 3) - s * along + [0, 0, PUPIL_MM]
        turned = (turn * Rotation.from_rotvec(tilt)).apply(points)
        pixels.append(seen(turned + shift, rng, sigma_px))
    stated = max(sigma_px, 1e-3), max(sigma_mm, 1e-6)
    return TravelShots(travel, points, np.array(pixels), *stated)


def test_without_noise_f_pupil_and_direction_come_back():
    rng = np.random.default_rng(0)
    shots = travelled(rng, sigma_mm=0.0, sigma_px=0.0)
    found = measure_travel(shots, PRIOR)
    assert found.f_px * PITCH_MM == pytest.approx(F_CAL, rel=1e-4)
    assert found.pupil_to_target_mm == pytest.approx(PUPIL_MM, abs=0.03)
    wanted = np.array([0.012, -0.012]) * F_CAL / PITCH_MM + CENTRE
    np.testing.assert_allclose(found.expansion_px, wanted, atol=0.6)
    assert found.off_axis_rad == pytest.approx(
        np.arctan(np.hypot(0.012, 0.012)), rel=0.02
    )


def trials(count, seed, **options):
    rng = np.random.default_rng(seed)
    errors, sigmas = [], []
    for _ in range(count):
        centre = CENTRE + rng.normal(0, 2, 2)
        prior = TravelPrior((float(centre[0]), float(centre[1])), 2.0)
        found = measure_travel(travelled(rng, **options), prior)
        off = found.pupil_to_target_mm - PUPIL_MM
        errors.append([found.f_px * PITCH_MM - F_CAL, off])
        sigmas.append([found.f_sigma_px * PITCH_MM, found.pupil_sigma_mm])
    return np.array(errors), np.array(sigmas)


def test_a_travel_of_75_mm_gives_d_to_four_microns_and_the_pupil_to_a_tenth():
    errors, sigmas = trials(14, 1)
    rms = np.sqrt((errors**2).mean(axis=0))
    assert rms[0] < 0.0055
    assert rms[1] < 0.11
    assert 0.5 < np.mean(np.abs(errors) < sigmas) < 0.86
    share = sigmas[:, 0].mean() / F_CAL
    assert share == pytest.approx(1.03 * 0.02 / 75, rel=0.1)


@pytest.mark.full
@pytest.mark.parametrize(
    ("travel_mm", "sigma_mm", "f_um", "pupil_mm"),
    [(75.0, 0.02, 3.7, 0.07), (25.0, 0.02, 11.0, 0.22), (25.0, 0.1, 54.0, 1.0)],
)
def test_travels_reach_what_their_length_and_error_allow(
    travel_mm, sigma_mm, f_um, pupil_mm
):
    errors, sigmas = trials(60, 2, travel_mm=travel_mm, sigma_mm=sigma_mm)
    rms = np.sqrt((errors**2).mean(axis=0))
    assert rms[0] < 1.25e-3 * f_um
    assert rms[1] < 1.25 * pupil_mm
    assert 0.55 < np.mean(np.abs(errors) < sigmas) < 0.80


def test_travelling_away_gives_the_same_lens():
    rng = np.random.default_rng(3)
    shots = travelled(rng, direction=(-0.01, 0.02, -1.0))
    found = measure_travel(shots, PRIOR)
    assert found.f_px * PITCH_MM == pytest.approx(F_CAL, abs=0.02)
    assert found.direction_camera[2] < -0.99


def test_the_derivatives_are_those_of_finite_differences():
    rng = np.random.default_rng(4)
    shots = travelled(rng, stops=3)
    known = np.array([0, 800, 600, 0.0]), np.array([np.inf, 2.0, 2.0, 0.01])
    problem = TravelProblem(shots, known)
    turn = Rotation.from_rotvec(rng.normal(0, 1e-5, (3, 3))).as_matrix()
    state = TravelState(
        PinholeCamera(2300.0, 2350.0, 803.0, 598.0, 2e-3),
        Rotation.from_rotvec([0.1, -0.05, 0.4]).as_matrix(),
        np.array([2.0, -3.0, 240.0]),
        np.array([0.02, -0.01, 1.0]) / np.linalg.norm([0.02, -0.01, 1.0]),
        rng.normal(0, 0.02, (3, 3)),
        turn,
    )
    steps = 1e-6 * np.eye(len(problem.names))
    numeric = [
        problem.residuals(problem.moved(state, s))
        - problem.residuals(problem.moved(state, -s))
        for s in steps
    ]
    exact = problem.jacobian(state)
    scale = np.abs(exact).max(axis=0)
    difference = np.abs(np.transpose(numeric) / 2e-6 - exact) / scale
    assert difference.max() < 1e-4


def test_the_axis_is_found_from_three_moves_and_corrected_until_it_is_met():
    rng = np.random.default_rng(5)
    truth = Rotation.from_rotvec([0.3, -0.2, 1.1]).as_matrix()
    moves = 10 * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    places = np.array([3.0, -2.0, 250.0]) - moves @ truth.T
    places[:, 2] *= 1.02
    places += rng.normal(0, 0.1, places.shape)
    guess = camera_from_tool(moves, places)
    direction = guess.T[:, 2]
    angles = []
    for _ in range(3):
        found = measure_travel(travelled(rng, direction=truth @ direction), PRIOR)
        angles.append(np.degrees(found.off_axis_rad))
        direction = next_direction(direction, guess, found.direction_camera)
    axis = truth.T[:, 2]
    assert np.degrees(np.arccos(direction @ axis)) < 0.15
    assert angles[-1] < 0.15


def test_moves_in_a_plane_cannot_find_the_axis():
    moves = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [10, 10, 0.0]])
    with pytest.raises(CalibrationError, match="three directions"):
        camera_from_tool(moves, -moves)


def test_a_target_that_does_not_grow_is_refused():
    rng = np.random.default_rng(6)
    with pytest.raises(CalibrationError, match="changed its size") as caught:
        measure_travel(travelled(rng, travel_mm=1.0), PRIOR)
    assert "fifth" in caught.value.hint


def test_a_travel_makes_a_node_with_its_own_uncertainty():
    found = measure_travel(travelled(np.random.default_rng(7)), PRIOR)
    node = found.node((0, 100), pitch_x_mm=PITCH_MM)
    assert node.f_cal_mm == pytest.approx(F_CAL, abs=0.02)
    assert node.f_cal_sigma_mm == pytest.approx(found.f_sigma_px * PITCH_MM)
    assert node.pupil_mm.value == pytest.approx(-PUPIL_MM, abs=0.4)
