"""The step fit against pictures of half planes that share no code with it."""

from __future__ import annotations

import numpy as np
import pytest

from mvp.imaging.edge_fit import StepFit, StepSamples, fit_step
from mvp.imaging.esf import Optics, angle_bin, spread_at

PIXEL_X = 16.25 / 13.5
SQUARE, WIDE = Optics(1.0, 0.0), Optics(PIXEL_X, 0.0)
ASPECT = {SQUARE: 1.0, WIDE: PIXEL_X}


def half_plane(
    optics: Optics, angle: float, offset: float, blur: float, *, samples: int = 20
) -> tuple[np.ndarray, np.ndarray]:
    """Ideal places (n, 2) and share of light (n,), area-sampled, disc-blurred."""
    y, x = np.mgrid[-30:31, -30:31].astype(np.float64)
    normal = np.array([np.cos(angle), np.sin(angle)])
    inner = (np.arange(samples) + 0.5) / samples - 0.5
    total = np.zeros_like(x)
    for dx in inner:
        for dy in inner:
            t = (x + dx) * ASPECT[optics] * normal[0] + (y + dy) * normal[1] - offset
            if blur:
                u = np.clip(2 * t / blur, -1, 1)
                total += 0.5 + (u * np.sqrt(1 - u * u) + np.arcsin(u)) / np.pi
            else:
                total += t > 0
    places = np.stack([x.ravel() * ASPECT[optics], y.ravel()], axis=1)
    return places, total.ravel() / samples**2


def fitted(
    optics: Optics,
    angle: float,
    offset: float,
    blur: float,
    *,
    snr: float,
    rng: np.random.Generator,
    length: float = 45.0,
    ceiling: float = np.inf,
) -> StepFit:
    places, share = half_plane(optics, angle, offset, blur)
    grey = 0.3 + 0.3 * share + rng.normal(0, 0.3 / snr, len(share))
    grey = np.minimum(grey, ceiling)
    normal = np.array([np.cos(angle), np.sin(angle)])
    t, s = places @ normal, places @ np.array([-normal[1], normal[0]])
    keep = (np.abs(t) < 4 + blur) & (np.abs(s) < length / 2)
    basis = np.stack([np.ones(keep.sum()), s[keep] / (length / 2)], axis=1)
    bins = np.full(int(keep.sum()), int(angle_bin(normal)))
    data = StepSamples(t[keep], basis, basis, grey[keep], bins)
    start = np.array([offset + rng.uniform(-0.5, 0.5), rng.uniform(-0.2, 0.2)])
    first = fit_step(data, optics, place=start, q_px2=4.0, shading=False)
    return fit_step(
        data, optics, place=first.place, q_px2=first.q_px2, shading=snr > 10
    )


@pytest.mark.parametrize("blur", [0.0, 1.0, 3.0])
def test_the_offset_of_a_45_px_edge_is_right_to_0_05_px_rms(blur: float) -> None:
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(8):
        angle, offset = rng.uniform(0, np.pi), rng.uniform(-0.5, 0.5)
        fit = fitted(WIDE, angle, offset, blur, snr=20, rng=rng)
        errors.append(fit.place[0] - offset)
    assert np.sqrt(np.mean(np.square(errors))) < 0.05


@pytest.mark.parametrize("angle", [0.0, np.pi / 2, np.deg2rad(0.4)])
@pytest.mark.parametrize("optics", [SQUARE, WIDE])
def test_an_axis_parallel_edge_is_found_as_well_as_any(
    angle: float, optics: Optics
) -> None:
    rng = np.random.default_rng(4)
    fits = [
        (offset, fitted(optics, angle, offset, 0.6, snr=100, rng=rng))
        for offset in (-0.45, -0.2, 0.1, 0.3)
    ]
    assert max(abs(fit.place[0] - offset) for offset, fit in fits) < 0.05


@pytest.mark.parametrize("blur", [1.5, 3.0, 6.0, 12.0])
def test_blur_from_1_5_px_on_is_right_to_20_percent_at_snr_30(blur: float) -> None:
    rng = np.random.default_rng(5)
    found = [
        np.sqrt(fitted(WIDE, rng.uniform(0, np.pi), 0.1, blur, snr=30, rng=rng).q_px2)
        for _ in range(4)
    ]
    assert np.abs(np.array(found) / blur - 1).max() < 0.2


@pytest.mark.parametrize("blur", [0.0, 0.6, 1.0])
def test_small_blur_is_right_to_0_3_px_or_says_how_uncertain_it_is(blur: float) -> None:
    rng = np.random.default_rng(6)
    for _ in range(4):
        fit = fitted(WIDE, rng.uniform(0, np.pi), 0.1, blur, snr=60, rng=rng)
        found = np.sqrt(max(fit.q_px2, 0.0))
        doubt = 3 * np.sqrt(fit.covariance[2, 2])
        assert abs(found - blur) < 0.3 or abs(fit.q_px2 - blur**2) < doubt


def test_stated_standard_deviations_cover_the_errors() -> None:
    rng = np.random.default_rng(7)
    pulls = []
    for _ in range(25):
        fit = fitted(SQUARE, 0.7, 0.2, 2.0, snr=20, rng=rng)
        pulls.append(
            [
                (fit.place[0] - 0.2) / np.sqrt(fit.covariance[0, 0]),
                (fit.q_px2 - 4.0) / np.sqrt(fit.covariance[2, 2]),
            ]
        )
    spread = np.std(pulls, axis=0)
    assert (spread > 0.6).all()
    assert (spread < 1.5).all()


def test_a_clipped_edge_looks_sharper_and_shifted_so_it_must_be_refused() -> None:
    rng = np.random.default_rng(8)
    whole = fitted(SQUARE, 0.3, 0.0, 3.0, snr=100, rng=rng)
    clipped = fitted(SQUARE, 0.3, 0.0, 3.0, snr=100, rng=rng, ceiling=0.45)
    assert clipped.q_px2 < 0.5 * whole.q_px2
    assert abs(clipped.place[0]) > 0.2


def test_the_spread_function_matches_an_area_sampled_disc() -> None:
    places, share = half_plane(WIDE, 0.5, 0.0, 3.0, samples=40)
    normal = np.array([np.cos(0.5), np.sin(0.5)])
    t = places @ normal
    near = np.abs(t) < 6
    bins = np.full(int(near.sum()), int(angle_bin(normal)))
    spread = spread_at(WIDE, t[near], 9.0, bins)
    assert np.abs(spread.edge - share[near]).max() < 0.004


def test_derivatives_of_the_spread_function_are_its_differences() -> None:
    optics = Optics(1.0, 0.9)
    t = np.linspace(-5, 5, 41)
    bins = np.full(len(t), 7)
    step = 0.01
    for q in (0.2, 4.0, 30.0):
        here = spread_at(optics, t, q, bins)
        by_t = spread_at(optics, t + step, q, bins).edge
        by_t = (by_t - spread_at(optics, t - step, q, bins).edge) / (2 * step)
        assert np.abs(here.by_t - by_t).max() < 0.02
        by_q = spread_at(optics, t, q + step, bins).edge - here.edge
        assert np.abs(here.by_q - by_q / step).max() < 0.02
