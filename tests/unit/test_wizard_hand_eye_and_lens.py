"""The hand-eye and lens wizards on a small virtual cell whose truth is known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from calibration.hand_eye import HandEyeData, Rehearsal, RobotNoise, rehearse
from calibration.hand_eye import calibrate_hand_eye as calibrated
from calibration.wizard.hand_eye import HandEyeWizard
from calibration.wizard.lens_node_result import node_of, plan_of
from calibration.wizard.lens_plan import Grid, focus_steps, plan_nodes, zoom_steps
from calibration.wizard.lens_travel import travelled
from calibration.wizard.lookout import Lookout
from calibration.wizard.session_store import SessionStore
from calibration.wizard.verification import (
    HeldOutView,
    Verification,
    verify_hand_eye,
)
from mvp.calibrated import (
    LensTableCalibration,
    Provenance,
    Quality,
    RigidCalibration,
    TargetPrint,
)
from mvp.cell.calibrate_result import keep_result
from mvp.errors import CalibrationError
from mvp.geometry import Pose
from mvp.imaging.printed_target import printed_target
from mvp.kinematics import tool_from_camera_at
from mvp.optics import LensTable, principal_distance_mm
from mvp.testing import example_belief, virtual_cell
from mvp.testing.virtual_bench import VirtualBench
from mvp.wizard import Allow, Ask, SessionFacts, WizardOptions, Word
from tests.complete_results import missing_of

WIDTH, HEIGHT = 320, 256
BOARD = {
    "kind": "charuco",
    "columns": 9,
    "rows": 7,
    "square_mm": 20.0,
    "marker_mm": 13.0,
}
REFERENCE_D, REFERENCE_F = 12.93, 12.5
ROBOT = RobotNoise(0.1, float(np.radians(0.02)))


def stamp():
    return Provenance(
        date="2026-01-01", device_serial="", method="example", simulated=True
    )


def rigid(schema, pose, **reference):
    return RigidCalibration(
        schema=schema,
        provenance=stamp(),
        quality=Quality(verdict="go"),
        target=pose.target,
        source=pose.source,
        matrix=pose.matrix.tolist(),
        **reference,
    )


def changed(table, **factors):
    """A lens whose values are those of the table times a factor."""
    moved = {
        name: getattr(table, name).model_copy(
            update={"values_mm": [v * factor for v in getattr(table, name).values_mm]}
        )
        for name, factor in factors.items()
    }
    return table.model_copy(update=moved)


class Cell:
    """A virtual cell that is not quite what its facts say."""

    def __init__(self, key, *, e_mm=2.0, f_share=1.0, x_share=1.0, forbids=None):
        base = example_belief(width_px=WIDTH, height_px=HEIGHT, e_mm=e_mm)
        self.hand = Pose.from_rotvec(
            "tool", "camera", np.radians([0.5, -0.4, 25.0]), [2.0, -2.0, 105.0]
        )
        table = base.lens_table
        truth = changed(table, zoom_f_mm=f_share, focus_extension_mm=x_share)
        belief = replace(
            base,
            lens_table=truth,
            tool_from_camera=self.hand,
            reference_d_mm=REFERENCE_D,
        )
        self.target = Pose.from_rotvec(
            "base",
            "target",
            np.array([np.pi, 0.0, 0.0]),
            np.array([-580.0, -60.0, 5.0]),
        )
        self.truth = LensTable.from_calibration(truth)
        self.cell = virtual_cell(belief=belief, clock_speed=5000.0)
        body = printed_target(TargetPrint(**BOARD), self.target, texel_mm=0.2)
        self.cell.world.place_targets((body,))
        self.facts = self._facts(key, table, base.camera)
        self.bench = VirtualBench(self.cell, self.facts, forbids or (lambda _: ""))

    def _facts(self, key, table: LensTableCalibration, camera):
        rough = Pose.from_rotvec(
            "tool", "camera", np.radians([0.0, 0.0, 25.0]), [0.0, 0.0, 104.0]
        )
        part = Pose.identity("base", "part")
        place = self.target.translation_mm + np.array([4.0, -3.0, 2.0])
        return SessionFacts(
            key=key,
            cell="small",
            simulated=True,
            date="2026-01-01",
            seed=3,
            serials={"arm": "A-1", "lens": "L-1", "camera": "C-1"},
            arm_model="ur5e",
            camera=camera,
            lens_table=table,
            hand_eye=rigid(
                "mvp-cell/hand-eye/1",
                rough,
                reference_d_mm=REFERENCE_D,
                reference_f_mm=REFERENCE_F,
            ),
            part_pose=rigid("mvp-cell/part-pose/1", part),
            robot={"position_mm": 0.05, "angle_deg": 0.01},
            target={
                **BOARD,
                "square_sigma_mm": 0.005,
                "position_mm": tuple(place),
                "rotation_deg": (180.0, 0.0, 0.0),
            },
            blur_circle_mm=0.0135,
            workspace_low_mm=(-1000, -1000, 0),
            workspace_high_mm=(1000, 1000, 1500),
        )

    def close(self):
        self.bench.close()


def driven(wizard, cell, store, answers=None, most=None):
    """All steps of a wizard, and its outcome; motion is allowed unless told otherwise."""
    steps, answer = [], None
    generator = wizard.steps(
        cell.bench, store, WizardOptions(auto=True, most_samples=most)
    )
    while True:
        try:
            step = generator.send(answer)
        except StopIteration as end:
            return steps, end.value
        steps.append(step)
        answer = None
        if isinstance(step, Allow):
            answer = next(answers, True) if answers else True
        if isinstance(step, Ask):
            answer = step.default


@pytest.fixture(scope="module")
def hand_eye(tmp_path_factory):
    too_high = 520.0
    cell = Cell(
        "hand-eye",
        forbids=lambda pose: "too high" if pose.translation_mm[2] > too_high else "",
    )
    store = SessionStore.create(tmp_path_factory.mktemp("s") / "one", cell.facts)
    answers = iter([True, True, False, True, Word.UNDO, True])
    steps, outcome = driven(HandEyeWizard(), cell, store, answers, most=8)
    yield cell, store, steps, outcome
    cell.close()


def test_hand_eye_comes_out_within_what_is_stated(hand_eye):
    cell, store, _, outcome = hand_eye
    assert {cause.code for cause in outcome.quality.causes} == {"few-views"}
    solution = outcome.details["result"].solution
    lens = cell.truth.setting(**store.samples[0].lens_steps)
    true = tool_from_camera_at(cell.hand, d_mm=lens.d_mm, reference_d_mm=REFERENCE_D)
    point = np.array([0.0, 0.0, outcome.details["stand_off_mm"]])
    off = solution.moving_from_camera.apply(point) - true.apply(point)
    assert np.linalg.norm(off) < 3 * solution.error_mm(float(point[2]))
    assert np.linalg.norm(off) < 0.5


def test_the_file_says_to_which_lens_setting_hand_eye_belongs(hand_eye):
    cell, store, _, outcome = hand_eye
    lens = cell.facts.lens_at(store.samples[0].lens_steps)
    document = outcome.document
    assert document.reference_d_mm == pytest.approx(lens.d_mm)
    assert document.reference_f_mm == pytest.approx(lens.f_mm)
    assert document.provenance.origin == "measured"
    assert document.provenance.serial_numbers["arm"] == "A-1"
    assert document.provenance.device_serial == "A-1"


def test_no_view_is_proposed_where_the_bench_forbids_it(hand_eye):
    cell, _, _, _ = hand_eye
    d_mm = REFERENCE_D
    for joints in cell.bench.moves:
        camera = cell.bench.arm.forward(joints) @ cell.facts.tool_from_camera(d_mm)
        assert camera.translation_mm[2] < 521.0


def test_what_was_refused_or_taken_back_is_no_sample(hand_eye):
    _, store, steps, _ = hand_eye
    allowed = [step for step in steps if isinstance(step, Allow)]
    assert len(allowed) == len(cell_moves(hand_eye)) + 2
    numbers = [sample.number for sample in store.samples]
    assert len(numbers) == len(set(numbers))
    assert store.count == len(cell_moves(hand_eye)) - 1


def cell_moves(hand_eye):
    return hand_eye[0].bench.moves


def test_a_session_gives_the_same_numbers_again(hand_eye):
    _, store, _, outcome = hand_eye
    again = HandEyeWizard().outcome(SessionStore.open(store.path))
    assert again.document == outcome.document


def test_held_out_views_had_no_part(hand_eye):
    _, store, _, outcome = hand_eye
    held = outcome.details["verification"]
    assert len(held.views) == 4
    names = {view.name for view in held.views}
    assert names.isdisjoint(view.name for view in outcome.quality.views)
    assert held.ratio < 3
    assert len(store.usable("verification")) == 4


def test_nothing_is_left_open_in_the_result(hand_eye):
    _, store, _, outcome = hand_eye
    document = keep_result(store.path / "hand_eye.json", store, outcome)
    assert missing_of(json.loads(document.model_dump_json(by_alias=True))) == []
    lengths = np.concatenate([np.hypot(p.dx_px, p.dy_px) for p in outcome.points])
    assert outcome.quality.rms_px == pytest.approx(
        np.sqrt((lengths**2).mean()), rel=0.01
    )


def test_a_session_without_a_usable_view_says_what_to_do(tmp_path, hand_eye):
    store = SessionStore.create(tmp_path / "empty", hand_eye[0].facts)
    with pytest.raises(CalibrationError, match="no picture") as caught:
        HandEyeWizard().outcome(store)
    assert "light" in caught.value.hint


# ------------------------------------------------------------------------ verification


def test_held_out_errors_are_as_large_as_foretold_and_a_slipped_camera_is_seen():
    rng = np.random.default_rng(5)
    told = rehearse(Rehearsal(views=26, robot=ROBOT), rng)
    camera = Rehearsal().camera
    found = calibrated(told.data.of_views(range(20)), camera, ROBOT).solution
    held = told.data.of_views(range(20, 26))
    good = verify_hand_eye(found, held)
    assert 0.4 < good.ratio < 1.8
    assert not good.causes()
    slipped = HandEyeData(
        held.base_from_tool,
        replace(held.seen, pixels=held.seen.pixels + np.array([12.0, 0.0])),
        held.mount,
        held.sigma_px,
    )
    bad = verify_hand_eye(found, slipped)
    assert bad.ratio > 3
    (cause,) = bad.causes()
    assert cause.code == "held-out-view-does-not-fit"
    assert "view" in cause.message


def test_a_result_without_held_out_views_is_not_verified():
    nothing = Verification("d", ())
    assert [cause.code for cause in nothing.causes()] == ["not-verified"]
    assert np.isnan(nothing.error)
    one = Verification("d", (HeldOutView("v", 0.02, 0.01),))
    assert one.ratio == pytest.approx(2.0)
    assert not one.causes()
    assert "2.0 times" in one.words


# ------------------------------------------------------------------------------- lens


def test_nodes_are_planned_where_the_target_is_sharp_in_reach():
    cell = Cell("lens")
    try:
        grid = Grid(zooms=3, focuses=4, irises=3)
        plans = plan_nodes(cell.facts, grid, (150.0, 600.0))
        assert {plan.zoom for plan in plans} <= set(zoom_steps(cell.facts, 3))
        assert len({plan.zoom for plan in plans}) >= 2
        assert all(150 <= plan.sharp_mm <= 600 for plan in plans)
        steps = focus_steps(cell.facts, 4, zoom_steps(cell.facts, 3), (150.0, 600.0))
        assert {plan.focus for plan in plans} <= set(steps)
        with pytest.raises(CalibrationError, match="hardly any") as caught:
            plan_nodes(cell.facts, grid, (20.0, 25.0))
        assert "nearer" in caught.value.hint
    finally:
        cell.close()


@pytest.mark.full
def test_a_node_without_depth_of_field_is_measured_by_a_travel(tmp_path):
    cell = Cell("lens")
    try:
        store = SessionStore.create(tmp_path / "lens", cell.facts)
        zoom = cell.facts.table.zoom.nearest_step(12.5)
        focus = cell.facts.table.focus.nearest_step(0.33)
        iris = cell.facts.table.iris.nearest_step(3.0)
        store.remember("nodes", [[zoom, focus, iris, 470.0, 0]])
        (plan,) = plan_of(store)
        lookout = Lookout(cell.bench, store)
        lookout.set_lens(plan.steps)
        drained(travelled(lookout, plan))
        found = node_of(store, plan)
        true = cell.truth.setting(zoom, focus, iris)
        f_cal = float(principal_distance_mm(true.d_mm, true.f_mm, true.e_mm))
        assert found is not None
        assert found.pictures is None
        assert abs(found.node.f_cal_mm - f_cal) < 3 * found.node.f_cal_sigma_mm
        assert found.node.pupil_mm is not None
        assert store.usable("travel")
    finally:
        cell.close()


def drained(generator):
    answer = None
    while True:
        try:
            step = generator.send(answer)
        except StopIteration:
            return
        answer = True if isinstance(step, Allow) else None
