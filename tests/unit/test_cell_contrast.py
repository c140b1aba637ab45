"""The cell's light: belief and truth, forecast by roll, choice of the roll, verdicts."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.virtual_light import true_light
from drivers.virtual_settings import LightSettings, WorldErrors
from mvp.cell.contrast import ContrastForecast, SeenContrast, ViewContrast
from mvp.cell.light_config import LampConfig, LightConfig, illumination
from mvp.cell.loading import load_cell, load_task
from mvp.cell.plan_job import Planned, make_plan
from mvp.cell.verification import Expectations
from mvp.geometry import Box, Pose, TriangleMesh, box_mesh, concatenated
from mvp.imaging import (
    Illumination,
    ViewExpectation,
    ViewVerification,
    expect_view,
    expose,
    exposure_for,
    render,
    verify_view,
)
from mvp.imaging.measure_plane import ImagePlane
from mvp.imaging.predict_contrast import contrast_at
from mvp.imaging.predict_outlines import OutlineParts, outline_parts
from mvp.imaging.render_body import RenderBody
from mvp.imaging.render_scene import RenderScene
from mvp.kinematics import realisations
from mvp.optics import Intrinsics, Sensor
from mvp.scene import cad_edges, edge_feature

if TYPE_CHECKING:
    from mvp.planning.plan import PlannedView


@pytest.fixture(scope="module")
def planned() -> Planned:
    cell = load_cell("virtual")
    return make_plan(cell, load_task(cell, None))


@pytest.fixture(scope="module")
def view(planned: Planned) -> PlannedView:
    return planned.plan.views[0]


@pytest.fixture(scope="module")
def contrast(planned: Planned) -> ViewContrast:
    forecast = ContrastForecast.of_cell(planned.setting.factory)
    assert forecast is not None
    realised = planned.found.views[0]
    pose = realised.view.part_from_camera()
    return forecast.of(realised.features, pose, realised.setting)


def pose_of(view: PlannedView) -> Pose:
    return Pose.from_matrix("part", "camera", np.array(view.part_from_camera))


def turned(pose: Pose, turn_rad: float) -> Pose:
    spin = Pose.from_rotvec("camera", "camera", [0, 0, turn_rad], [0, 0, 0])
    return pose @ spin


def seen_at(planned: Planned, view: PlannedView, turn_rad: float) -> ViewExpectation:
    """The verifier's own expectation of the view, taken with another roll."""
    pose = turned(pose_of(view), turn_rad)
    other = view.model_copy(update={"part_from_camera": pose.matrix.tolist()})
    return Expectations(planned.setting).of(other)


def pictured(
    planned: Planned, view: PlannedView, light: Illumination, expected: ViewExpectation
) -> ViewVerification:
    picture = render(
        RenderScene([RenderBody(planned.setting.scene.scene.occluders)]),
        pose_of(view),
        d_mm=view.d_mm,
        f_mm=view.f_mm,
        a_mm=view.a_mm,
        e_mm=view.pupil_offset_mm,
        intrinsics=planned.setting.factory.intrinsics,
        light=light,
    )
    rng = np.random.default_rng(3)
    return verify_view(expose(picture, exposure_for(picture), rng=rng), 255, expected)


# Belief and truth.


def test_a_light_table_without_keys_is_the_default_light():
    assert illumination(LightConfig()) == Illumination()


def test_nothing_is_predicted_for_a_cell_that_states_no_light(planned: Planned):
    assert illumination(None) is None
    factory = planned.setting.factory
    dark = factory.cell.config.model_copy(update={"light": None})
    cell = replace(factory.cell, config=dark)
    assert ContrastForecast.of_cell(replace(factory, cell=cell)) is None


def test_without_errors_the_true_light_is_the_stated_one():
    stated = LightConfig(ambient=0.2, gloss=0.3, reference_mm=400.0)
    found = true_light(stated.belief, None, WorldErrors(), np.zeros(3))
    assert found == illumination(stated)


def test_errors_move_and_dim_the_true_light_but_never_the_ring():
    errors = WorldErrors(light_fraction=-0.5, ambient=0.1)
    found = true_light(LightConfig().belief, None, errors, np.array([1.0, 2.0, 3.0]))
    assert found.lamps[0].position_mm == (0.0, 0.0, 0.0)
    assert found.lamps[1].position_mm == (-149.0, -108.0, 23.0)
    assert found.lamps[1].strength == pytest.approx(0.3)
    assert found.ambient == pytest.approx(0.075)


def test_a_world_with_a_light_of_its_own_does_not_ask_the_cell():
    own = LightSettings(ambient=0.4, lamps=[])
    found = true_light(LightConfig().belief, own, WorldErrors(), np.zeros(3))
    assert found.ambient == 0.4
    assert found.lamps == ()


# Forecast.


@pytest.mark.parametrize("turn_deg", [0.0, 75.0, 200.0])
def test_the_forecast_at_a_roll_is_what_rays_find_from_that_pose(
    planned: Planned, view: PlannedView, contrast: ViewContrast, turn_deg: float
):
    pose = turned(pose_of(view), np.radians(turn_deg))
    by_line = contrast.at(pose).by_line
    expected = seen_at(planned, view, np.radians(turn_deg))
    scene = RenderScene([RenderBody(planned.setting.scene.scene.occluders)])
    for edge in expected.feature_edges:
        share = np.linspace(0.1, 0.9, 13)[:, None]
        places = edge.start_px * (1 - share) + edge.end_px * share
        normals = np.broadcast_to(edge.normal, places.shape)
        away = 1.5 + edge.blur_px / 2
        found = contrast_at(
            places, normals, away, Illumination(), scene, pose, expected.plane
        )
        assert by_line[edge.name] == pytest.approx(np.percentile(found, 25), abs=2e-3)


def test_one_call_for_many_rolls_agrees_with_single_calls(
    view: PlannedView, contrast: ViewContrast
):
    poses = [turned(pose_of(view), t) for t in (0.0, 1.0, 2.5)]
    together = contrast.values(np.stack([p.rotation for p in poses]))
    for pose, values in zip(poses, together, strict=True):
        assert list(contrast.at(pose).by_line.values()) == pytest.approx(list(values))


def test_the_plan_shows_enough_contrast_with_headroom(
    planned: Planned, view: PlannedView
):
    asked = planned.setting.cell.config.light
    assert asked is not None
    assert set(view.contrast) == set(view.features)
    assert min(view.contrast.values()) >= 2 * asked.min_contrast


def test_faint_lines_are_named_in_one_plain_note():
    seen = SeenContrast({"a": 0.02, "b": 0.04, "c": 0.3}, {"x": 0.02}, 0.05)
    (note,) = seen.notes
    assert note.startswith("a will show only 2% contrast (1 more lines are faint)")
    assert seen.rank == pytest.approx(0.2)
    assert SeenContrast({"a": 0.1}, {"x": 0.1}, 0.05).rank == 1.0
    assert SeenContrast({"a": 0.0}, {"x": 0.0}, 0.0).rank == 1.0


# Choice of the roll.


def test_the_roll_with_the_largest_rank_comes_first(planned: Planned):
    realised = planned.found.views[0]
    arm = planned.setting.arm
    where = arm.placement(realised.setting, realised.problem.key_points_mm)
    pose = realised.view.part_from_camera()
    plain = realisations(where, pose)
    assert isinstance(plain, tuple)
    wanted = plain[-1].part_from_camera.rotation[:, 0]
    ranked = realisations(where, pose, rank=lambda r: r[:, :, 0] @ wanted)
    assert isinstance(ranked, tuple)
    assert ranked[0].part_from_camera.rotation[:, 0] == pytest.approx(wanted, abs=1e-6)


# Verdicts.


def test_edges_that_the_light_hides_are_not_measurable_but_never_hidden(
    planned: Planned, view: PlannedView
):
    flat = LightConfig(
        ambient=0.4, lamps=[LampConfig(position_mm=(0, 0, 0), strength=0.01)], gloss=0
    )
    setting = planned.setting
    config = setting.cell.config.model_copy(update={"light": flat})
    expected = Expectations(
        replace(setting, cell=replace(setting.cell, config=config))
    ).of(view)
    assert max(edge.contrast for edge in expected.feature_edges) < 0.03
    light = illumination(flat)
    assert light is not None
    found = pictured(planned, view, light, expected)
    assert (found.verdict, found.cause) == ("not measurable", "low contrast")


def test_the_chosen_roll_is_measured(planned: Planned, view: PlannedView):
    expected = seen_at(planned, view, 0.0)
    assert pictured(planned, view, Illumination(), expected).verdict == "pass"


# Outlines.

PLANE = ImagePlane(
    Intrinsics(Sensor(1280, 1024, 0.005, 0.005), 639.5, 511.5), 12.5, 13.0, 0.8
)
ABOVE = Pose("part", "camera", np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 300.0]))


def parts_of(*points_xy: tuple[float, float]) -> OutlineParts:
    ring = np.column_stack([np.array(points_xy), np.zeros(len(points_xy))])
    return outline_parts((np.vstack([ring, ring[:1]]),), ABOVE, PLANE)


def block(low_mm: list[float], high_mm: list[float]) -> TriangleMesh:
    return box_mesh(Box(np.array(low_mm), np.array(high_mm)), name="block")


def arc(
    x_mm: float, radius_mm: float, from_deg: float, to_deg: float, count: int
) -> list[tuple[float, float]]:
    angle = np.radians(np.linspace(from_deg, to_deg, count))
    return [
        (float(x_mm + radius_mm * np.cos(a)), float(radius_mm * np.sin(a)))
        for a in angle
    ]


def test_a_finely_tessellated_circle_is_a_rim():
    parts = parts_of(*arc(0, 10, 0, 360 * 31 / 32, 32))
    assert (len(parts.rims), len(parts.sides), parts.left_px) == (1, 0, 0.0)


def test_an_octagon_keeps_its_sides():
    parts = parts_of(*arc(0, 30, 0, 315, 8))
    assert (len(parts.rims), len(parts.sides)) == (0, 8)
    assert not any(side.open_ends for side in parts.sides)


def test_a_slot_has_two_sides_with_open_ends_and_says_what_is_left_out():
    parts = parts_of(*arc(20, 5, -90, 90, 13), *arc(-20, 5, 90, 270, 13))
    assert [side.open_ends for side in parts.sides] == [True, True]
    assert parts.left_px == pytest.approx(np.pi * 10 * 2600 / 300, rel=0.02)


def test_a_feature_of_short_chords_alone_is_still_asked_for():
    parts = parts_of((0, 0), (0.5, 0), (0.5, 0.4))
    assert len(parts.sides) == 1


def test_a_contour_is_measured_in_pieces_with_one_background():
    """The near block's far edge is seen against the block behind it and the void."""
    near = block([-30.0, -20.0, 0.0], [30.0, 20.0, 30.0])
    far = block([0.0, 10.0, -60.0], [60.0, 60.0, -1.0])
    mesh = concatenated([near, far])
    top = edge_feature("rim", [-30, 20, 30], [30, 20, 30], mesh)
    expected = expect_view(
        [top],
        mesh,
        cad_edges(mesh),
        ABOVE,
        f_mm=12.5,
        d_mm=13.0,
        a_mm=0.8,
        e_mm=0.0,
        intrinsics=PLANE.intrinsics,
        c_mm=0.0135,
        light=Illumination(),
    )
    first, second = expected.feature_edges
    assert first.asked.length_px == pytest.approx(
        first.length_px + second.length_px, rel=0.05
    )
    assert (first.open_ends, second.open_ends) == (False, True)
