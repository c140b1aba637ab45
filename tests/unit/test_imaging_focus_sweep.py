"""A focus sweep finds the planned best focus, and says how well it knows it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvp.imaging import ViewExpectation, ViewVerification, expose, verify_view
from mvp.imaging.blur_sweep import (
    BestFocus,
    best_focus,
    focus_sweep,
    planned_best_focus_mm,
    sweep_distances_mm,
)
from tools.picture_trials import VIEW_NAMES, Stage, metered_s, paper_stage

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.imaging import RenderedImage


@pytest.fixture(scope="module")
def stage() -> Stage:
    return paper_stage()


class Bench:
    """A view whose image distance can be set; the lens may be off by ``error_mm``."""

    def __init__(self, stage: Stage, view: str, error_mm: float = 0.0) -> None:
        self.setting, self.plan, _ = stage.planned(view, 0.0)
        self._stage = stage
        self._error_mm = error_mm
        self.expect = cache(self._expect)
        self._drawn = cache(self._draw)

    def _expect(self, d_mm: float) -> ViewExpectation:
        return self._stage.expectation(replace(self.setting, d_mm=d_mm))

    def _draw(self, d_mm: float) -> tuple[RenderedImage, float]:
        true = replace(self.setting, d_mm=d_mm + self._error_mm)
        picture = self._stage.picture(true)
        return picture, metered_s(picture, self.expect(d_mm))

    def sweep(self, seed: int) -> BestFocus:
        rng = np.random.default_rng(seed)
        return focus_sweep(
            self.plan,
            self.expect,
            lambda d_mm: expose(*self._drawn(d_mm), rng=rng),
            full_scale=255.0,
        )


@pytest.mark.parametrize("view", VIEW_NAMES)
def test_a_sweep_is_sharpest_within_10_um_of_the_planned_distance(
    stage: Stage, view: str
) -> None:
    found = Bench(stage, view).sweep(seed=3)
    assert abs(found.d_mm - found.planned_mm) < 0.01
    assert found.sd_mm < 0.0033


@pytest.mark.full
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("view", VIEW_NAMES)
def test_twelve_noisy_sweeps_stay_within_10_um_and_their_stated_uncertainty(
    stage: Stage, view: str, record_property: Callable[[str, object], None]
) -> None:
    bench = Bench(stage, view)
    found = [bench.sweep(seed) for seed in range(100, 112)]
    off_mm = np.array([one.d_mm - one.planned_mm for one in found])
    pulls = off_mm / np.array([one.sd_mm for one in found])
    record_property("off by um", (1e3 * off_mm).round(1).tolist())
    record_property("in units of the stated sd", pulls.round(2).tolist())
    assert np.abs(off_mm).max() < 0.01
    assert np.sqrt(np.mean(pulls**2)) < 1.8
    assert np.abs(pulls).max() < 4


def test_a_lens_that_is_off_by_40_um_is_found_out(stage: Stage) -> None:
    found = Bench(stage, "V_f", error_mm=0.04).sweep(seed=4)
    assert found.d_mm - found.planned_mm == pytest.approx(-0.04, abs=0.01)


def invented(
    like: ViewVerification, squares: np.ndarray, sd: np.ndarray, weighed: np.ndarray
) -> ViewVerification:
    """A verification with other b^2."""
    edges = tuple(
        replace(
            edge,
            blur=replace(
                edge.blur,
                square_px2=float(q),
                square_sd_px2=float(s),
                weighed_px2=float(w),
            ),
        )
        for edge, q, s, w in zip(like.edges, squares, sd, weighed, strict=True)
    )
    return replace(like, edges=edges)


def test_the_stated_uncertainty_covers_the_errors(stage: Stage) -> None:
    setting, plan, exposure_s = stage.planned("V_f1", 0.0)
    like = verify_view(expose(stage.picture(setting), exposure_s), 255.0, plan)
    distances = sweep_distances_mm(plan)
    best = planned_best_focus_mm(plan)
    # Two edges at different depth, one known far better than the other.
    predicted = 21.0 * (distances[:, None] - best - np.array([0.05, -0.02])) ** 2
    sd = np.array([0.8, 0.2])
    rng = np.random.default_rng(8)
    pulls, apart = [], []
    for _ in range(300):
        measured = predicted + 0.2 + sd * rng.standard_normal(predicted.shape)
        sweep = [
            invented(like, q, sd, w) for q, w in zip(measured, predicted, strict=True)
        ]
        found = best_focus(plan, list(distances), sweep)
        pulls.append((found.d_mm - best) / found.sd_mm)
        apart.append(found.sd_mm)
    assert abs(np.mean(pulls)) < 0.2
    assert np.std(pulls) == pytest.approx(1.0, abs=0.2)
    assert np.std(apart) < np.mean(apart)


def test_a_sweep_lies_on_both_sides_and_never_below_the_focal_length(
    stage: Stage,
) -> None:
    for view in VIEW_NAMES:
        _, plan, _ = stage.planned(view, 0.0)
        distances = sweep_distances_mm(plan)
        best = planned_best_focus_mm(plan)
        assert distances.min() > plan.plane.f_mm
        assert np.mean(distances) == pytest.approx(best)
        assert (distances < best).sum() == (distances > best).sum() == 3


def test_a_sweep_that_only_grows_sharper_is_refused(stage: Stage) -> None:
    setting, plan, exposure_s = stage.planned("V_f", 0.0)
    like = verify_view(expose(stage.picture(setting), exposure_s), 255.0, plan)
    distances = sweep_distances_mm(plan)
    steps = np.sqrt(np.arange(1.0, 7.0))[:, None] * np.ones(2)
    sweep = [invented(like, q, 0 * q + 0.01, q) for q in steps]
    with pytest.raises(ValueError, match="no sharpest place"):
        best_focus(plan, list(distances), sweep)
    with pytest.raises(ValueError, match="four pictures"):
        best_focus(plan, list(distances[:2]), sweep[:2])
