"""Nodes from pictures: points carried through a traced lens by their chief rays."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.lens_table import (
    Measured,
    PixelGrid,
    filled_share,
    node_from_views,
    separate,
)
from calibration.observations import Observations
from mvp.testing.paraxial_lens import ParaxialLens

PITCH_MM, F_MM, E_MM = 0.0055, 12.5, 8.0
PIXELS = PixelGrid(PITCH_MM, PITCH_MM, 0.1)
K1_PER_MM2 = -2e-3


def lens_at(u_mm):
    d = F_MM * u_mm / (u_mm - F_MM)
    return ParaxialLens.thin(f_mm=F_MM, d_mm=d, e_mm=E_MM, a_mm=1.0)


def f_cal_of(lens):
    return float(lens.scale(100.0)) * 100.0


def pictures(
    lens, u_mm, rng, *, views=5, tilt_deg=30.0, fill=0.8, centre=(806.0, 595.0)
):
    """A board of 12 x 9 at its sharp distance, tilted about axes all around."""
    z = u_mm - E_MM
    side = fill * 1200 * PITCH_MM / float(lens.scale(z))
    x, y = np.meshgrid(np.linspace(-0.65, 0.65, 12), np.linspace(-0.5, 0.5, 9))
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) * side
    pixels = []
    for angle in rng.uniform(0, 1) + 2 * np.pi * np.arange(views) / views:
        about = np.radians(tilt_deg) * np.array([np.cos(angle), np.sin(angle), 0])
        turned = Rotation.from_rotvec(about).apply(points) + np.array([0, 0, z])
        sensor = turned[:, :2] * lens.scale(turned[:, 2])[:, None]
        r2 = (sensor**2).sum(axis=1, keepdims=True)
        found = sensor * (1 + K1_PER_MM2 * r2) / PITCH_MM + centre
        pixels.append(found + rng.normal(0, 0.1, found.shape))
    return Observations.from_views([points] * views, pixels, size_px=(1600, 1200))


def test_a_node_has_the_traced_principal_distance_centre_and_distortion():
    rng = np.random.default_rng(1)
    lens = lens_at(250.0)
    node, camera = node_from_views(pictures(lens, 250.0, rng), (0, 5), PIXELS)
    sigma = np.sqrt(np.diag(node.covariance))
    truth = [f_cal_of(lens), 806.0, 595.0, K1_PER_MM2]
    assert (np.abs(node.values - truth) < 4 * sigma).all()
    assert sigma[0] < 0.0035
    assert node.fill == pytest.approx(0.75, abs=0.06)
    assert camera.verdict.grade == "go"


def test_fill_is_measured_along_the_short_side():
    seen = Observations.from_views(
        [np.zeros((2, 3))],
        [np.array([[0.0, 100.0], [1500.0, 400.0]])],
        size_px=(1600, 1200),
    )
    assert filled_share(seen) == pytest.approx(0.25)


def test_pictures_at_four_focus_settings_give_f_d_and_e():
    rng = np.random.default_rng(2)
    nodes, truth = [], []
    for i, u in enumerate((150.0, 250.0, 500.0, 1000.0)):
        lens = lens_at(u)
        far = lens.sharp_from_pupil_mm()
        sharp = Measured(far * (1 + rng.normal(0, 0.005)), 0.005 * far)
        seen = pictures(lens, u, rng)
        nodes.append(node_from_views(seen, (0, i), PIXELS, sharp_mm=sharp, folds=0)[0])
        truth.append(lens.d_mm)
    found = separate(nodes)
    assert found.way == "per-node"
    assert abs(found.f_mm[0] - F_MM) < 0.008
    assert abs(found.e_mm - E_MM) < 0.2
    assert (np.abs(found.d_mm - truth) < 4 * found.d_sigma_mm).all()
    assert (found.d_sigma_mm < 0.0006 * np.array(truth)).all()


def trials(count, seed, u_mm=250.0, **options):
    rng = np.random.default_rng(seed)
    lens = lens_at(u_mm)
    truth = f_cal_of(lens)
    nodes = [
        node_from_views(pictures(lens, u_mm, rng, **options), (0, 0), PIXELS, folds=0)
        for _ in range(count)
    ]
    nodes = [node for node, _ in nodes]
    error = np.array([node.f_cal_mm for node in nodes]) - truth
    return error, np.array([node.f_cal_sigma_mm for node in nodes])


# Views, tilt in degrees, fill of the short side: at most so many um RMS.
NODES = {(5, 30, 0.8): 2.6, (10, 30, 0.8): 1.8, (10, 15, 0.8): 6.0, (10, 30, 0.4): 8.0}


@pytest.mark.full
def test_the_error_of_a_node_is_that_of_its_views():
    """Shares of 30 trials scatter by 9 %: those within one sigma count together."""
    inside = []
    for (views, tilt_deg, fill), most_um in NODES.items():
        error, sigma = trials(30, 3, views=views, tilt_deg=tilt_deg, fill=fill)
        assert 1e3 * np.sqrt((error**2).mean()) < most_um
        inside.append(np.abs(error) < sigma)
    assert 0.55 <= np.mean(inside) <= 0.80
