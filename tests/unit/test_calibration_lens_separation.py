"""f, d and e from focus settings; the truth is a lens traced ray by ray."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.lens_table import LensNode, Measured, separate
from calibration.lens_table.nodes import NodeSet
from calibration.lens_table.optics_model import (
    Bases,
    OpticsProblem,
    polynomial,
    same_for,
)
from mvp.errors import CalibrationError
from mvp.optics import (
    focus_distance_mm,
    principal_distance_mm,
    signed_blur_mm,
)
from mvp.testing.paraxial_lens import ParaxialLens

PITCH_MM = 0.0055
THICK = ParaxialLens((1 / 30, -1 / 80, 1 / 20), (0.0, 8.0, 15.0), 6.0, 4.0, 35.0)
TWO, FOUR = (150.0, 1000.0), (150.0, 250.0, 500.0, 1000.0)


def lens_at(u_mm, *, f_mm=12.5, e_mm=8.0):
    """Focused u from the front nodal point."""
    return ParaxialLens.thin(
        f_mm=f_mm, d_mm=f_mm * u_mm / (u_mm - f_mm), e_mm=e_mm, a_mm=2.0
    )


def node_of(
    lens, steps, rng, *, f_cal_sd=0.002, sharp_share=0.005, centre_sd=0.35, **more
):
    """What a calibration and a contrast sweep say about a traced lens."""
    sharp = lens.sharp_from_pupil_mm()
    sigma = np.array([f_cal_sd, centre_sd, centre_sd, 1e-5])
    truth = np.array([float(lens.scale(100.0)) * 100.0, 800.0, 600.0, 2e-3])
    noise = rng.normal(0, 1, 5)
    return LensNode(
        *steps,
        truth + sigma * noise[:4],
        np.diag(sigma**2),
        Measured(sharp * (1 + sharp_share * noise[4]), sharp * sharp_share),
        **more,
    )


def focused(rng, distances, **options):
    lens = {k: options.pop(k) for k in ("f_mm", "e_mm") if k in options}
    return [
        node_of(lens_at(u, **lens), (0, 100 * i), rng, **options)
        for i, u in enumerate(distances)
    ]


def true_d(distances, f_mm=12.5):
    return np.array([f_mm * u / (u - f_mm) for u in distances])


def test_formulas_of_the_thick_lens_are_those_of_traced_rays():
    lens = THICK.focused(20.1)
    f, d, e, a = lens.f_mm, lens.d_mm, lens.e_mm, lens.a_mm
    z = np.array([80.0, 200.0, 900.0])
    np.testing.assert_allclose(lens.scale(z) * z, principal_distance_mm(d, f, e))
    np.testing.assert_allclose(
        lens.sharp_from_pupil_mm(), focus_distance_mm(d, f) - e, rtol=1e-12
    )
    blur = np.abs(signed_blur_mm(z, d, f, a, e))
    np.testing.assert_allclose(lens.blur_mm(z), blur, rtol=1e-9)


@pytest.mark.parametrize("e_mm", [8.0, 0.0, -3.0])
def test_without_noise_the_lens_comes_back_exactly(e_mm):
    rng = np.random.default_rng(0)
    nodes = [
        node_of(lens_at(u, e_mm=e_mm), (0, i), rng, f_cal_sd=1e-9, sharp_share=1e-9)
        for i, u in enumerate(FOUR)
    ]
    found = separate(nodes)
    assert found.f_mm[0] == pytest.approx(12.5, abs=1e-7)
    assert found.e_mm == pytest.approx(e_mm, abs=1e-6)
    np.testing.assert_allclose(found.d_mm, true_d(FOUR), atol=1e-7)


def test_a_lens_of_three_groups_is_separated_as_its_cardinal_points_say():
    rng = np.random.default_rng(3)
    lenses = [THICK.focused(THICK.f_mm + x) for x in (0.2, 0.7, 1.5)]
    found = separate([node_of(lens, (0, i), rng) for i, lens in enumerate(lenses)])
    assert found.f_mm[0] == pytest.approx(THICK.f_mm, abs=0.015)
    assert found.e_mm == pytest.approx(THICK.e_mm, abs=0.3)
    error = found.d_mm - [lens.d_mm for lens in lenses]
    assert (np.abs(error) < 4 * found.d_sigma_mm).all()


def errors_of(trials, distances, seed, **noise):
    """Errors of f, e, d in mm and by their sigma."""
    rng = np.random.default_rng(seed)
    errors, sigmas = [], []
    for _ in range(trials):
        found = separate(focused(rng, distances, **noise))
        off = found.d_mm - true_d(distances)
        errors.append([found.f_mm[0] - 12.5, found.e_mm - 8.0, *off])
        sigmas.append([found.f_sigma_mm[0], found.e_sigma_mm, *found.d_sigma_mm])
    return np.array(errors), np.array(sigmas)


@pytest.mark.parametrize("distances", [TWO, FOUR])
def test_two_or_four_focus_settings_give_f_to_microns_and_e_to_a_twentieth(distances):
    errors, sigmas = errors_of(25, distances, 1)
    rms = np.sqrt((errors**2).mean(axis=0))
    assert rms[0] < 0.0035
    assert rms[1] < 0.08
    assert rms[2:].max() < 0.009
    assert 0.55 < np.mean(np.abs(errors) < sigmas) < 0.80


@pytest.mark.parametrize("trials", [25, pytest.param(30, marks=pytest.mark.full)])
def test_seven_focus_settings_meet_the_bars_of_a_table(trials):
    distances = tuple(np.geomspace(150, 1000, 7))
    errors, sigmas = errors_of(trials, distances, 2)
    rms = np.sqrt((errors**2).mean(axis=0))
    d = true_d(distances)
    assert rms[1] <= 0.3
    assert (rms[2:] <= 0.0005 * d).all()
    depth_of_focus = 0.0135 * d / (12.5 / 16)
    assert (rms[2:] <= 0.1 * depth_of_focus).all()
    assert 0.55 < np.mean(np.abs(errors) < sigmas) < 0.80


@pytest.mark.full
@pytest.mark.parametrize("distances", [TWO, FOUR])
@pytest.mark.parametrize("noise", [(0.002, 0.005), (0.006, 0.01)])
def test_many_separations_are_honest(distances, noise):
    errors, sigmas = errors_of(
        300, distances, 2, f_cal_sd=noise[0], sharp_share=noise[1]
    )
    assert 0.6 < np.mean(np.abs(errors) < sigmas) < 0.76
    assert np.sqrt((errors[:, 1] ** 2).mean()) < 0.3
    ratio = errors.std(axis=0) / sigmas.mean(axis=0)
    assert (ratio < 1.15).all()


def test_the_derivatives_are_those_of_finite_differences():
    rng = np.random.default_rng(4)
    nodes = [
        node_of(lens_at(u, f_mm=f), (z, i), rng, pupil_mm=Measured(float(i), 0.05))
        for z, f in enumerate((12.5, 20.0))
        for i, u in enumerate((150.0, 300.0, 900.0))
    ]
    seen = NodeSet.of(nodes)
    own, one = np.eye(len(seen)), np.ones((len(seen), 1))
    x = polynomial(seen.focus_of, 1)
    problem = OpticsProblem(
        seen,
        Bases(x, same_for(seen.zoom_of), own, one, own),
        (7.0, 1.0),
        pupil_follows=True,
    )
    state = rng.normal(0, 0.1, len(problem.names))
    state[:4] = (12.4, 20.3, 0.6, -0.2)
    steps = 1e-6 * np.eye(len(state))
    numeric = [
        (problem.residuals(state + s) - problem.residuals(state - s)) / 2e-6
        for s in steps
    ]
    exact = problem.jacobian(state)
    np.testing.assert_allclose(np.transpose(numeric), exact, rtol=1e-5, atol=1e-4)


def test_one_focus_setting_is_refused():
    nodes = focused(np.random.default_rng(0), (250.0,))
    with pytest.raises(CalibrationError, match="one focus setting") as caught:
        separate(nodes)
    assert "two focus settings" in caught.value.hint
    assert separate(nodes, e_prior_mm=(8.0, 0.1)).f_mm[0] == pytest.approx(
        12.5, abs=0.02
    )


def test_a_zoom_without_sharp_distance_is_named():
    rng = np.random.default_rng(0)
    nodes = focused(rng, TWO)
    bare = [LensNode(70, n.focus, n.values, n.covariance) for n in nodes]
    with pytest.raises(CalibrationError, match="zoom 70"):
        separate([*nodes, *bare])


def test_a_lens_that_breathes_is_noticed():
    rng = np.random.default_rng(5)
    breathing = [
        node_of(lens_at(u, f_mm=12.5 + 0.1 * i), (0, i), rng)
        for i, u in enumerate(FOUR)
    ]
    assert separate(breathing).test("constant-over-focus").contradicted
    steady = separate(focused(rng, FOUR)).test("constant-over-focus")
    assert steady.tested
    assert not steady.contradicted


def zoomed(rng, *, x_of=lambda f, x: x, e_of=lambda f: 2.4):
    return [
        node_of(
            ParaxialLens.thin(f_mm=f, d_mm=f + x_of(f, x), e_mm=e_of(f), a_mm=2.0),
            (z, i),
            rng,
        )
        for z, f in enumerate((8.0, 12.5, 25.0))
        for i, x in enumerate((0.2, 0.5, 0.8, 1.1))
    ]


def test_a_zoom_is_one_table_only_if_x_and_e_do_not_depend_on_it():
    rng = np.random.default_rng(6)
    good = separate(zoomed(rng))
    assert not any(test.contradicted for test in good.tests)
    assert good.test("parfocal").tested
    np.testing.assert_allclose(good.f_mm, (8.0, 12.5, 25.0), atol=0.01)
    assert good.e_mm == pytest.approx(2.4, abs=0.1)
    other_x = separate(zoomed(rng, x_of=lambda f, x: x * f / 12.5))
    assert other_x.test("parfocal").contradicted
    other_e = separate(zoomed(rng, e_of=lambda f: 2.4 + 0.2 * (f - 8)))
    assert other_e.test("one-pupil-offset").contradicted


def test_a_pupil_that_does_not_move_with_d_is_noticed():
    rng = np.random.default_rng(7)

    def found(share):
        nodes = [
            node_of(lens, (0, i), rng, pupil_mm=Measured(40 + share * lens.d_mm, 0.05))
            for i, lens in enumerate(map(lens_at, FOUR))
        ]
        return separate(nodes).test("pupil-follows")

    assert not found(1.0).contradicted
    assert found(0.3).contradicted


def small_targets(rng, x_of=lambda s: 0.1 + 1e-4 * s):
    """Targets that fill a fifth of the picture: f_cal and centre go together."""
    mix = np.eye(4)
    mix[0, 1] = 0.6
    sigma = np.array([0.018, 6.0, 6.0, 2e-4])
    covariance = np.outer(sigma, sigma) * (mix @ mix.T)
    root = np.linalg.cholesky(covariance)
    nodes, truth = [], []
    for step in range(0, 12000, 1500):
        lens = ParaxialLens.thin(f_mm=12.5, d_mm=12.5 + x_of(step), e_mm=8.0, a_mm=2.0)
        sharp = lens.sharp_from_pupil_mm()
        values = np.array([float(lens.scale(9.0)) * 9.0, 790 + step / 500, 600, 2e-3])
        measured = Measured(sharp * (1 + rng.normal(0, 0.005)), sharp * 0.005)
        values = values + root @ rng.normal(0, 1, 4)
        nodes.append(LensNode(0, step, values, covariance, measured, fill=0.2))
        truth.append([float(lens.scale(9.0)) * 9.0, 790 + step / 500, lens.d_mm])
    return nodes, np.array(truth)


def test_small_targets_are_fitted_together_and_better_for_it():
    rng = np.random.default_rng(8)
    alone, together, inside = [], [], []
    for _ in range(10):
        nodes, truth = small_targets(rng)
        one = separate(nodes, way="per-node")
        both = separate(nodes)
        assert both.way == "global"
        alone.append(one.node_values[:, :2] - truth[:, :2])
        together.append(both.node_values[:, :2] - truth[:, :2])
        inside.append(np.abs(both.d_mm - truth[:, 2]) < both.d_sigma_mm)
    rms = [np.sqrt(np.mean(np.square(e), axis=(0, 1))) for e in (alone, together)]
    assert rms[1][0] < 1.02 * rms[0][0]
    assert rms[1][1] < 0.75 * rms[0][1]
    assert 0.5 < np.mean(inside) < 0.85


def test_a_curved_helicoid_gets_as_high_a_degree_as_it_needs():
    rng = np.random.default_rng(9)
    line, _ = small_targets(rng)
    bent, _ = small_targets(rng, lambda s: 0.1 + 1e-4 * s + 0.5 * (s / 12000) ** 3)
    assert separate(line).degree == 1
    assert separate(bent).degree in (2, 3)


def test_nodes_with_the_same_steps_are_refused():
    nodes = focused(np.random.default_rng(0), TWO)
    with pytest.raises(ValueError, match="same steps"):
        separate([nodes[0], nodes[0]])
