"""Blur of a target's edges in drawn pictures, the sharp distance and the pupil from it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from calibration.lens_table import measure_aperture
from calibration.lens_table.edge_blur import EdgeBlurs, edge_blurs, optics_of
from calibration.lens_table.sharpness import blur_shots, sharp_place
from calibration.projection import PinholeCamera
from calibration.targets import Charuco, CircleGrid, nominal
from mvp.calibrated import TargetPrint
from mvp.errors import CalibrationError
from mvp.geometry import Pose
from mvp.imaging import Illumination, render
from mvp.imaging.printed_target import printed_target
from mvp.optics import Intrinsics, Sensor, principal_distance_mm, signed_blur_mm

PITCH_MM, F_MM, D_MM, E_MM = 0.01, 12.5, 12.95, 2.4
SENSOR = Sensor(400, 320, PITCH_MM, PITCH_MM)
F_CAL = float(principal_distance_mm(D_MM, F_MM, E_MM))
SHARP_MM = F_MM * D_MM / (D_MM - F_MM) - E_MM
TARGET = Charuco(8, 6, nominal(20.0), 13.0)
CAMERA = PinholeCamera(F_CAL / PITCH_MM, F_CAL / PITCH_MM, 199.5, 159.5)
LIGHT = Illumination(ambient=1.0, lamps=(), gloss=0.0)


@cache
def blurs(z_mm, a_mm, tilt_rad=0.0, d_mm=D_MM):
    """Edges as drawn through a real lens, and the discs that they should show, px^2."""
    layout = TargetPrint(
        kind="charuco", columns=8, rows=6, square_mm=20.0, marker_mm=13.0
    )
    pose = Pose.from_rotvec(
        "camera",
        "target",
        np.array([tilt_rad, 0.0, 0.3]),
        np.array([-60.0, -75.0, z_mm]),
    )
    f_cal = float(principal_distance_mm(d_mm, F_MM, E_MM))
    picture = render(
        [printed_target(layout, Pose.identity("world", "target"), texel_mm=0.05)],
        Pose("world", "camera", pose.inverse().rotation, pose.inverse().translation_mm),
        d_mm=d_mm,
        f_mm=F_MM,
        a_mm=a_mm,
        e_mm=E_MM,
        intrinsics=Intrinsics(SENSOR, 199.5, 159.5),
        light=LIGHT,
    )
    grey = np.clip(np.rint(picture.grey * 220), 0, 255).astype(np.uint8)
    camera = PinholeCamera(f_cal / PITCH_MM, f_cal / PITCH_MM, 199.5, 159.5)
    optics = optics_of(f_cal, a_mm, pitch_mm=PITCH_MM, lambda_mm=550e-6)
    found = edge_blurs(
        grey, TARGET, camera, (pose.rotation, pose.translation_mm), optics
    )
    disc = signed_blur_mm(found.depth_mm, d_mm, F_MM, a_mm, E_MM) / PITCH_MM
    return found, np.asarray(disc**2)


@pytest.mark.parametrize(("z_mm", "a_mm"), [(300.0, 4.0), (270.0, 3.0), (460.0, 4.0)])
def test_the_blur_of_edges_is_that_of_the_lens(z_mm, a_mm):
    found, discs = blurs(z_mm, a_mm)
    assert len(found) >= 15
    assert np.median(found.square_px2) == pytest.approx(np.median(discs), rel=0.1)


def test_a_sharp_edge_has_next_to_no_disc():
    found, _ = blurs(SHARP_MM, 4.0)
    assert np.abs(np.median(found.square_px2)) < 0.4


def test_tilted_views_tell_the_sharp_distance_and_the_pupil():
    seen = [blurs(z, 4.0, t)[0] for z, t in ((330.0, 0.5), (400.0, -0.5), (300.0, 0.3))]
    place = sharp_place(EdgeBlurs.joined(seen), F_CAL, PITCH_MM)
    assert place.distance_mm.value == pytest.approx(SHARP_MM, rel=0.012)
    assert abs(place.distance_mm.value - SHARP_MM) < 3 * place.distance_mm.sigma
    assert place.a_mm.value == pytest.approx(4.0, rel=0.15)


@pytest.mark.parametrize("bump_px2", [-0.6, -0.3, 0.3])
@pytest.mark.parametrize("everywhere_px2", [-0.4, 0.0])
def test_a_response_that_is_not_quite_as_assumed_stays_in_the_interval(
    bump_px2, everywhere_px2
):
    """Edges on the near side alone, whose smallest discs are measured wrongly."""
    rng = np.random.default_rng(4)
    depth = rng.uniform(0.76, 1.06, 300) * SHARP_MM
    discs = (2.0 / PITCH_MM * F_CAL * (1 / SHARP_MM - 1 / depth)) ** 2
    off = everywhere_px2 + bump_px2 * np.exp(-discs / 0.7)
    noise = rng.normal(0, np.hypot(0.05, 0.05 * discs))
    seen = EdgeBlurs(depth, discs + off + noise, np.full(300, 0.05))
    found = sharp_place(seen, F_CAL, PITCH_MM).distance_mm
    assert found.value == pytest.approx(SHARP_MM, abs=2 * found.sigma)
    assert found.sigma < 0.02 * SHARP_MM


def test_blur_against_defocus_gives_the_pupil():
    parts, defocus = [], []
    for d_mm in (12.75, 12.95, 13.15):
        found, _ = blurs(340.0, 4.0, 0.4, d_mm)
        parts.append(found)
        f_cal = float(principal_distance_mm(d_mm, F_MM, E_MM))
        defocus.append((d_mm - F_MM) / F_MM - f_cal / found.depth_mm)
    shots = blur_shots(
        EdgeBlurs.joined(parts),
        np.concatenate(defocus),
        pitch_mm=PITCH_MM,
        diffraction_px=0.1,
    )
    found = measure_aperture(shots)
    assert found.a_mm == pytest.approx(4.0, rel=0.03)
    assert found.sharp_at == pytest.approx(0.0, abs=1e-3)


def test_a_target_without_squares_has_no_edges_to_measure():
    discs = CircleGrid(8, 6, nominal(20.0), 10.0)
    pose = np.eye(3), np.array([0.0, 0.0, 300.0])
    optics = optics_of(F_CAL, 4.0, pitch_mm=PITCH_MM, lambda_mm=550e-6)
    found = edge_blurs(np.zeros((320, 400), np.uint8), discs, CAMERA, pose, optics)
    assert len(found) == 0
    with pytest.raises(CalibrationError, match="0 edges") as caught:
        sharp_place(found, F_CAL, PITCH_MM)
    assert "squares" in caught.value.hint


def test_blur_that_does_not_change_tells_nothing():
    rng = np.random.default_rng(0)
    flat = EdgeBlurs(
        rng.uniform(390, 410, 60), rng.normal(1.0, 0.2, 60), np.full(60, 0.2)
    )
    with pytest.raises(CalibrationError, match="hardly changes"):
        sharp_place(flat, F_CAL, PITCH_MM)
