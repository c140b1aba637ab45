"""Calibrations with covariances decide the spread of a cell's views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mvp.calibrated import NamedCovariance
from mvp.calibrated.content import content_sha256
from mvp.cell.loading import load_cell, load_task
from mvp.cell.plan_job import make_plan
from mvp.cell.view_uncertainty import view_errors
from mvp.cell.wording import kept_text, probability_lines
from mvp.optics import single_view
from mvp.planning.plan import Plan
from mvp.planning.probability_errors import camera_spread


def measured_cell():
    """The virtual cell as calibrations would leave it: every file has a covariance."""
    cell = load_cell("virtual")
    found = cell.calibrations
    camera = NamedCovariance(
        parameters=["fx_px", "cx_px", "cy_px"],
        matrix=np.diag([1.0, 0.16, 0.09]).tolist(),
    )
    lens = NamedCovariance(parameters=["f_mm at zoom 0"], matrix=[[1e-5]])
    return replace(
        cell,
        calibrations=replace(
            found,
            camera=found.camera.model_copy(update={"covariance": camera}),
            lens_table=found.lens_table.model_copy(update={"covariance": lens}),
        ),
    )


def view_of(cell):
    from mvp.geometry import Pose

    pose = Pose("part", "camera", np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 350.0]))
    return single_view(pose, d_mm=12.9, f_mm=12.5, a_mm=0.8)


def test_the_bundled_cell_keeps_its_stated_errors():
    assert view_errors(load_cell("virtual")) is None


def test_a_chain_with_a_link_of_unknown_quality_stays_as_stated():
    cell = measured_cell()
    found = cell.calibrations
    for name in ("camera", "hand_eye", "part_pose"):
        poor = getattr(found, name).model_copy(update={"covariance": None})
        errors = view_errors(replace(cell, calibrations=replace(found, **{name: poor})))
        assert errors is not None
        assert errors.pose is None
        sigma = np.sqrt(np.diag(errors.covariance(view_of(cell))[0]))
        np.testing.assert_allclose(sigma[:3], 1.0)
        assert sigma[6] == pytest.approx(0.005)


def test_a_part_found_through_this_hand_eye_shares_its_errors():
    cell = measured_cell()
    found = cell.calibrations
    lever = np.eye(6)
    lever[:3, 3:] = 0.3
    shared = {
        "by_hand_eye": lever.tolist(),
        "hand_eye_sha256": content_sha256(found.hand_eye),
    }
    part = found.part_pose.model_copy(update=shared)
    foreign = part.model_copy(update={"hand_eye_sha256": "0" * 64})
    own, other = (
        view_errors(replace(cell, calibrations=replace(found, part_pose=one)))
        for one in (part, foreign)
    )
    np.testing.assert_array_equal(own.pose.part_by_hand_eye, lever)
    np.testing.assert_array_equal(other.pose.part_by_hand_eye, 0)


def test_a_wider_covariance_gives_a_wider_spread():
    cell = measured_cell()
    found = cell.calibrations
    wide = (9 * np.array(found.part_pose.covariance)).tolist()
    wider = found.part_pose.model_copy(update={"covariance": wide})
    near, far = (
        camera_spread(view_errors(c).covariance(view_of(c))[0])
        for c in (cell, replace(cell, calibrations=replace(found, part_pose=wider)))
    )
    assert far.position_mm > 2 * near.position_mm
    assert near.position_mm < near.position_95_mm < 3 * near.position_mm


@pytest.fixture(scope="module")
def planned():
    cell = measured_cell()
    return make_plan(cell, load_task(cell, None))


def test_a_plan_of_a_measured_cell_reckons_with_what_was_measured(planned):
    assert planned.plan.status == "admissible"
    for view in planned.plan.views:
        found = view.probability
        assert found.spread.sources == [
            "camera",
            "hand_eye",
            "part_pose",
            "lens_table",
        ]
        assert found.spread.position_mm < 1.0
        assert set(found.each) == set(view.margins)
        assert found.together <= min(found.each.values()) + 1e-9
        assert found.weakest == view.binding
        assert view.failure_probability == pytest.approx(1 - found.together, abs=2e-3)


def test_a_plan_reads_back_with_its_probabilities(planned):
    text = planned.plan.model_dump_json(by_alias=True)
    assert Plan.model_validate_json(text) == planned.plan


def test_probabilities_are_said_in_words(planned):
    lines = probability_lines(planned.plan.views[0].probability)
    assert "probability" in lines[0]
    assert "mm" in lines[1]
    assert "hand eye" in lines[1]


@pytest.mark.parametrize(
    ("probability", "text"),
    [(1.0, "100 %"), (0.9, "90 %"), (0.997, "99.7 %"), (1 - 3.2e-6, "99.9997 %")],
)
def test_a_probability_shows_as_many_digits_as_it_has(probability, text):
    assert kept_text(probability) == text
