"""Rules about the picture as a whole: which one accuses, of what, and in which words."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvp.imaging import (
    RenderBody,
    RenderScene,
    SensorNoise,
    ViewExpectation,
    ViewVerification,
    expose,
    verify_view,
)
from mvp.imaging.cause import CHECK_FIRST, Evidence, picture_fault
from mvp.imaging.measure_view import residual_rms_px
from mvp.imaging.register import Alignment
from tools.picture_trials import Stage, paper_stage

if TYPE_CHECKING:
    from mvp.imaging.expectation import ExpectedEdge

SENSOR = SensorNoise()


@pytest.fixture(scope="module")
def stage() -> Stage:
    return paper_stage()


def evidence(
    alignment: Alignment | None = None,
    residual_px: float = 0.05,
    *,
    kept: bool = False,
    scale_sd: float = 0.0005,
) -> Evidence:
    return Evidence(
        alignment or Alignment(),
        residual_px,
        None,
        (),
        1.0,
        kept=kept,
        witnesses=13,
        scale_sd=scale_sd,
    )


def photographed(
    stage: Stage, view: str, part_scale: float, expectation: ViewExpectation | None
) -> ViewVerification:
    setting, planned, exposure_s = stage.planned(view, 0.0)
    mesh = stage.mesh
    part = replace(mesh, vertices_mm=mesh.vertices_mm * part_scale)
    picture = stage.picture(setting, RenderScene([RenderBody(part)]))
    image = expose(picture, exposure_s, rng=np.random.default_rng(5))
    return verify_view(np.asarray(image), 255.0, expectation or planned)


def aside(edge: ExpectedEdge, offset_px: float) -> ExpectedEdge:
    """An edge expected beside the place where the picture shows it."""
    away = offset_px * edge.normal
    return replace(edge, start_px=edge.start_px + away, end_px=edge.end_px + away)


def test_an_edge_that_is_itself_unknown_adds_nothing_to_the_residual() -> None:
    left = np.array([0.02, -0.03, 0.01, -1.44])
    vague = residual_rms_px(left, np.array([0.01, 0.01, 0.05, 22.0]))
    sharp = residual_rms_px(left, np.full(4, 0.01))
    assert vague < 0.03
    assert sharp == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-6)


def test_other_edges_out_of_place_do_not_fail_features_that_are_in_theirs(
    stage: Stage,
) -> None:
    _, planned, _ = stage.planned("V_f", 0.0)
    signs = iter([1, -1] * 20)
    edges = tuple(
        aside(edge, 0.7 * next(signs)) if edge.role == "auxiliary" else edge
        for edge in planned.edges
    )
    result = photographed(stage, "V_f", 1.0, replace(planned, edges=edges))
    registration = result.registration
    assert registration is not None
    assert registration.residual_px is not None
    assert registration.residual_px > 0.35
    assert result.verdict == "pass", result.explanation
    assert any("residual of" in note and "limit" in note for note in result.notes)


def test_a_residual_accuses_with_its_number_and_its_limit(stage: Stage) -> None:
    _, planned, _ = stage.planned("V_f", 0.0)
    tight = replace(planned, tolerance=replace(planned.tolerance, position_mm=0.0))
    found = picture_fault(evidence(residual_px=0.43), tight)
    assert found is not None
    assert found.cause == "misalignment"
    assert "residual of 13 edges 0.43 px, limit 0.35 px" in found.explanation
    assert picture_fault(evidence(residual_px=0.43, kept=True), tight) is None


def test_only_the_broken_rules_are_told(stage: Stage) -> None:
    _, planned, _ = stage.planned("V_f", 0.0)
    found = picture_fault(
        evidence(Alignment(0.2, 0.1, np.deg2rad(0.9), 1.001)), planned
    )
    assert found is not None
    assert found.cause == "misalignment"
    assert found.explanation == (
        "the picture is turned by 0.90 deg (limit 0.50 deg) against the plan"
    )


def test_another_size_alone_is_the_zoom_or_the_part_and_must_be_sure(
    stage: Stage,
) -> None:
    _, planned, _ = stage.planned("V_f", 0.0)
    larger = Alignment(0.3, 0.2, np.deg2rad(0.08), 1.023)
    found = picture_fault(evidence(larger), planned)
    assert found is not None
    assert found.cause == "zoom"
    assert "scaled by +2.3% (limit 1.0%)" in found.explanation
    assert picture_fault(evidence(larger, scale_sd=0.02), planned) is None
    turned = replace(larger, roll_rad=np.deg2rad(0.9))
    both = picture_fault(evidence(turned), planned)
    assert both is not None
    assert both.cause == "misalignment"


@pytest.mark.parametrize("part_scale", [0.98, 1.02])
def test_a_part_of_another_size_is_called_so(stage: Stage, part_scale: float) -> None:
    result = photographed(stage, "V_f1", part_scale, None)
    assert result.cause == "zoom", result
    assert "scaled by" in result.explanation
    for word in ("zoom", "focus", "part"):
        assert word in CHECK_FIRST["zoom"]
    assert result.check_first == CHECK_FIRST["zoom"]
