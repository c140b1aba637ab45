"""Blur budget against diffraction integrals and sampled discs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import j1

from mvp.optics import (
    BlurBudget,
    airy_diameter_mm,
    airy_fwhm_mm,
    smallest_pupil_mm,
    working_f_number,
)

WAVELENGTH = 550e-6


def airy(x):
    return (2 * j1(x) / x) ** 2


def test_airy_sizes_follow_from_the_bessel_function():
    n_w = 16.0
    to_mm = WAVELENGTH * n_w / np.pi
    zero = brentq(j1, 3.0, 4.5)
    half = brentq(lambda x: airy(x) - 0.5, 1.0, 2.5)
    assert airy_diameter_mm(n_w, 1.0, WAVELENGTH) == pytest.approx(
        2 * zero * to_mm, rel=1e-4
    )
    assert airy_fwhm_mm(n_w, 1.0, WAVELENGTH) == pytest.approx(
        2 * half * to_mm, rel=1e-3
    )


def test_the_papers_lens_diffracts_about_as_much_as_it_may_defocus():
    assert working_f_number(13.07, 0.78125) == pytest.approx(16.73, abs=0.01)
    assert airy_fwhm_mm(13.07, 0.78125, WAVELENGTH) * 1e3 == pytest.approx(9.5, abs=0.1)


def test_at_the_smallest_pupil_the_airy_disc_is_as_wide_as_c():
    a = smallest_pupil_mm(13.0, 0.0135, WAVELENGTH)
    assert airy_diameter_mm(13.0, a, WAVELENGTH) == pytest.approx(0.0135)


def test_standard_deviations_are_those_of_sampled_profiles():
    rng = np.random.default_rng(5)
    budget = BlurBudget.of(
        -0.02, d_mm=13.0, a_mm=0.8, wavelength_mm=WAVELENGTH, pixel_mm=0.0135
    )
    radius = 0.01 * np.sqrt(rng.random(400_000))
    disc = radius * np.cos(rng.uniform(0, 2 * np.pi, 400_000))
    pixel = rng.uniform(-0.00675, 0.00675, 400_000)
    spot = rng.normal(0, budget.diffraction_sigma_mm, 400_000)
    assert budget.defocus_sigma_mm == pytest.approx(disc.std(), rel=0.01)
    assert budget.pixel_sigma_mm == pytest.approx(pixel.std(), rel=0.01)
    assert budget.optical_sigma_mm == pytest.approx((disc + spot).std(), rel=0.01)
    assert budget.total_sigma_mm == pytest.approx((disc + spot + pixel).std(), rel=0.01)


def test_without_diffraction_the_spread_is_the_blur_circle():
    budget = BlurBudget(np.array([-0.02, 0.03]), np.zeros(2), np.zeros(2))
    assert budget.spread_mm == pytest.approx([0.02, 0.03])
