"""Pictures of the paper's object, verified from image and expectation alone."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvp.geometry import Box, Pose, box_mesh
from mvp.imaging import (
    RenderBody,
    RenderScene,
    Requirement,
    SensorNoise,
    ViewExpectation,
    ViewTolerance,
    ViewVerification,
    expose,
    meter_exposure,
    verify_view,
)
from mvp.scene import PaperObject, paper_object
from tools.picture_trials import (
    FINE,
    HALF_DEPTH_MM,
    PAPER,
    VIEW_NAMES,
    Setting,
    Stage,
    metered_s,
    paper_setting,
    paper_stage,
    smeared,
)

if TYPE_CHECKING:
    from mvp.optics import Sensor

SENSOR = SensorNoise()


@pytest.fixture(scope="module")
def stage() -> Stage:
    return paper_stage()


def frame(
    stage: Stage,
    setting: Setting,
    exposure_s: float,
    *,
    scene: RenderScene | None = None,
    seed: int | None = 1,
) -> np.ndarray:
    rng = None if seed is None else np.random.default_rng(seed)
    return np.asarray(expose(stage.picture(setting, scene), exposure_s, rng=rng))


def verified(
    stage: Stage,
    view: str,
    *,
    true: Setting | None = None,
    scene: RenderScene | None = None,
    seed: int | None = 1,
    expectation: ViewExpectation | None = None,
) -> ViewVerification:
    setting, planned, exposure_s = stage.planned(view, 0.0)
    image = frame(stage, true or setting, exposure_s, scene=scene, seed=seed)
    return verify_view(image, 255.0, expectation or planned)


@pytest.mark.parametrize("view", VIEW_NAMES)
def test_a_faultless_picture_passes_with_both_ends_of_every_edge(
    stage: Stage, view: str
) -> None:
    result = verified(stage, view)
    assert result.verdict == "pass"
    assert result.cause is None
    for edge in result.edges:
        assert edge.measured_px is not None
        assert abs(edge.measured_px - edge.predicted_px) < 0.5
        assert edge.start_px is not None
        assert edge.end_px is not None
        assert abs(edge.offset_px or 0.0) < 0.2
        assert edge.visible_fraction > 0.9


@pytest.mark.parametrize("view", VIEW_NAMES)
def test_without_noise_lengths_are_right_to_a_tenth_of_a_pixel(
    stage: Stage, view: str
) -> None:
    result = verified(stage, view, seed=None)
    for edge in result.edges:
        assert edge.measured_px == pytest.approx(edge.predicted_px, abs=0.1)


@pytest.mark.parametrize("view", VIEW_NAMES)
def test_with_noise_lengths_are_right_to_0_3_px_rms_and_1_px_at_worst(
    stage: Stage, view: str
) -> None:
    setting, expectation, exposure_s = stage.planned(view, 0.0)
    picture = stage.picture(setting)
    errors = []
    for seed in range(6):
        image = expose(picture, exposure_s, rng=np.random.default_rng(seed))
        for edge in verify_view(image, 255.0, expectation).edges:
            assert edge.measured_px is not None
            errors.append(edge.measured_px - edge.predicted_px)
    assert np.sqrt(np.mean(np.square(errors))) < 0.3
    assert np.abs(errors).max() < 1.0


@pytest.mark.parametrize("sensor", [PAPER, FINE])
def test_errors_as_large_as_the_tolerance_are_no_alarm(sensor: Sensor) -> None:
    wide = replace(paper_stage(sensor), tolerance=ViewTolerance(1.0, 0.3, 0.02))
    setting, expectation, exposure_s = wide.planned("V_f1", 0.0)
    shift = np.array([0.33, 0.78, 0.31])
    turn = np.deg2rad([0.15, -0.15, 0.1])
    error = Pose.from_rotvec("camera", "camera", turn, shift)
    image = frame(wide, replace(setting, pose=setting.pose @ error), exposure_s)
    result = verify_view(image, 255.0, expectation)
    assert result.verdict == "pass"
    assert result.notes
    assert result.registration is not None
    assert result.registration.position_mm == pytest.approx(-shift, abs=0.15)


def test_the_document_is_plain_json(stage: Stage) -> None:
    document = verified(stage, "V_f").to_json()
    again = json.loads(json.dumps(document, allow_nan=False))
    assert again["verdict"] == "pass"
    assert {"feature", "predicted_px", "measured_px", "visible_fraction"} <= set(
        again["edges"][0]
    )
    assert again["blur"]["c_px"] == pytest.approx(1.0)


def test_lengths_follow_a_part_that_is_two_percent_larger(stage: Stage) -> None:
    larger = replace(
        stage.mesh,
        vertices_mm=np.asarray(stage.mesh.vertices_mm) * 1.02,
    )
    result = verified(stage, "V_f", scene=RenderScene([RenderBody(larger)]))
    plan = stage.planned("V_f", 0.0)[1]
    for edge, planned in zip(result.edges, plan.feature_edges, strict=True):
        assert edge.predicted_px == pytest.approx(planned.length_px)
        assert edge.measured_px == pytest.approx(1.02 * planned.length_px, abs=0.6)
    assert result.verdict == "fail"


@pytest.mark.parametrize("view", ["V_f", "V_f1"])
def test_an_end_that_is_1_mm_elsewhere_is_found_there(stage: Stage, view: str) -> None:
    cube = Box(np.array([-13.7, 0.0, -12.7]), np.array([12.7, 25.4, 12.7]))
    longer = paper_object(PaperObject(cube=cube))
    result = verified(stage, view, scene=RenderScene([RenderBody(longer)]))
    plan = stage.planned(view, 0.0)[1].feature_edges[0]
    edge = result.edges[0]
    camera = stage.planned(view, 0.0)[0].pose.inverse()
    ends = stage.planned(view, 0.0)[1].plane.project(
        camera.apply(np.array([[-13.7, 0.0, 12.7], [12.7, 0.0, 12.7]]))
    )
    true_px = float(np.linalg.norm(ends[1] - ends[0]))
    assert edge.predicted_px == pytest.approx(plan.length_px)
    assert edge.measured_px == pytest.approx(true_px, abs=0.5)
    assert result.verdict == "fail"
    assert result.cause == "shape"
    assert " px instead of " in result.explanation
    assert "(limit +-" in result.explanation


def test_a_weak_neighbour_beside_the_overhang_does_not_spoil_the_length(
    stage: Stage,
) -> None:
    lengths = [verified(stage, "V_f", seed=seed).edges[0] for seed in range(3)]
    for edge in lengths:
        assert edge.measured_px is None or abs(edge.measured_px - edge.predicted_px) < 1


def test_the_contour_between_parallel_faces_is_measured(stage: Stage) -> None:
    edge = verified(stage, "V_f1").edges[0]
    assert edge.name == "horizontal"
    assert edge.snr > 5
    assert edge.measured_px == pytest.approx(edge.predicted_px, abs=0.5)


def test_light_without_fall_off_is_predicted_to_give_that_contour_no_contrast(
    stage: Stage,
) -> None:
    far = tuple(
        replace(lamp, position_mm=tuple(300 * np.array(lamp.position_mm)))
        for lamp in stage.light.lamps[1:]
    )
    distant = replace(stage.light, ambient=0.4, lamps=far, reference_mm=5e4, gloss=0.0)
    flat = replace(stage, light=distant, kept={})
    setting = paper_setting("V_f1")
    expectation = flat.expectation(setting)
    assert expectation.feature_edges[0].contrast < 0.03
    image = flat.picture(setting)
    result = verify_view(
        expose(image, metered_s(image, expectation), rng=np.random.default_rng(0)),
        255.0,
        expectation,
    )
    assert result.verdict == "not measurable"
    assert result.cause == "low contrast"


def test_a_small_misalignment_within_tolerance_is_a_pass_with_a_note(
    stage: Stage,
) -> None:
    setting, _, _ = stage.planned("V_f", 0.0)
    nudge = Pose("camera", "camera", np.eye(3), np.array([0.35, 0.1, 0.0]))
    result = verified(stage, "V_f", true=replace(setting, pose=setting.pose @ nudge))
    assert result.verdict == "pass"
    assert result.notes
    assert result.registration is not None
    assert result.registration.shift_px[0] < -0.5


def test_the_pose_that_explains_a_misalignment_is_told(stage: Stage) -> None:
    setting, _, _ = stage.planned("V_f2", 0.0)
    moved = Pose("camera", "camera", np.eye(3), np.array([3.0, -2.0, 1.0]))
    result = verified(stage, "V_f2", true=replace(setting, pose=setting.pose @ moved))
    assert result.cause == "misalignment"
    assert result.registration is not None
    assert result.registration.position_mm == pytest.approx((-3, 2, -1), abs=0.6)


def test_a_bright_plate_before_a_feature_is_called_occlusion(stage: Stage) -> None:
    setting, _, _ = stage.planned("V_f", 0.0)
    middle = setting.pose.inverse().apply(np.array([0.0, 0.0, 12.7]))
    place = Pose("camera", "plate", np.eye(3), middle * 0.4)
    half = np.array([2.6, 2.6, 0.5])
    plate = box_mesh(Box(-half, half), name="plate").moved(setting.pose @ place)
    bodies = [RenderBody(stage.mesh), RenderBody(plate, albedo=1.0)]
    result = verified(stage, "V_f", scene=RenderScene(bodies))
    assert result.verdict == "fail"
    assert result.cause == "occlusion"


def test_a_focus_fault_that_scales_the_picture_is_called_defocus(stage: Stage) -> None:
    setting, _, _ = stage.planned("V_f2", 0.0)
    true = replace(setting, d_mm=setting.d_mm + 6 * HALF_DEPTH_MM)
    result = verified(stage, "V_f2", true=true)
    assert result.cause == "defocus"
    assert result.registration is not None
    assert result.registration.scale == pytest.approx(1.10, abs=0.02)
    assert result.registration.found_before < result.registration.found_after


def test_motion_along_a_feature_is_seen_by_the_other_edges(stage: Stage) -> None:
    setting, expectation, exposure_s = stage.planned("V_f", 0.0)
    along = expectation.feature_edges[0].direction / np.array([16.25 / 13.5, 1.0])
    image = stage.picture(setting)
    blurred = replace(image, grey=smeared(image.grey, 7 * along))
    result = verify_view(
        expose(blurred, exposure_s, rng=np.random.default_rng(0)), 255.0, expectation
    )
    assert result.verdict == "fail"
    assert result.cause == "motion"


def test_an_edge_with_a_clipped_side_is_no_proof_of_sharpness(stage: Stage) -> None:
    setting, expectation, exposure_s = stage.planned("V_f1", 0.0)
    image = frame(stage, setting, 1.75 * exposure_s)
    result = verify_view(image, 255.0, expectation)
    assert result.verdict == "fail"
    assert result.cause == "overexposed"
    assert any(edge.blur.measured_px is None for edge in result.edges)


def test_a_promise_of_more_resolution_than_there_is_fails(stage: Stage) -> None:
    _, expectation, _ = stage.planned("V_f1", 0.0)
    demanding = replace(
        expectation,
        edges=tuple(
            replace(e, requirement=Requirement(1.0, 1.0), detail_px=0.8)
            if e.role == "feature"
            else e
            for e in expectation.edges
        ),
    )
    result = verified(stage, "V_f1", expectation=demanding)
    assert result.verdict == "fail"
    assert result.cause == "resolution"


def test_metering_brings_the_features_to_sixty_percent(stage: Stage) -> None:
    setting, expectation, exposure_s = stage.planned("V_f", 0.0)
    picture = stage.picture(setting)
    factor = 0.17
    for _ in range(4):
        image = expose(picture, factor * exposure_s, rng=np.random.default_rng(2))
        factor *= meter_exposure(image, 255.0, expectation)
    assert factor == pytest.approx(1.0, rel=0.05)
    clipped = expose(picture, 9 * exposure_s)
    assert meter_exposure(clipped, 255.0, expectation) <= 0.25


def test_a_picture_of_another_size_is_refused(stage: Stage) -> None:
    _, expectation, _ = stage.planned("V_f", 0.0)
    with pytest.raises(ValueError, match="sensor"):
        verify_view(np.zeros((10, 10)), 255.0, expectation)
