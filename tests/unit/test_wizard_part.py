"""The part wizard at a bench that draws a block's edges instead of rendering them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.part_pose import judge_resection
from calibration.poses import difference, only
from calibration.projection import project
from calibration.wizard.lookout import camera_at
from calibration.wizard.part import PartWizard
from calibration.wizard.part_result import found_of
from calibration.wizard.session_store import SessionStore
from mvp.calibrated import NamedCovariance
from mvp.calibrated.content import content_sha256
from mvp.cell.calibrate_result import keep_result
from mvp.cell.loading import load_cell
from mvp.errors import CalibrationError
from mvp.geometry import Box, Pose, box_mesh
from mvp.kinematics import part_from_camera
from mvp.scene import cad_edges
from mvp.wizard import (
    Allow,
    Refusal,
    SeenPart,
    SessionFacts,
    Shot,
    SightView,
    Stand,
    Way,
    WizardOptions,
    Word,
)
from tests.complete_results import missing_of
from tests.wizard_play import broken_off, taken_back

EYE = np.diag([0.15] * 3 + [4e-4] * 3) ** 2
ROBOT_MM, ROBOT_DEG = 0.08, 0.02
ROBOT = np.diag([ROBOT_MM] * 3 + [np.radians(ROBOT_DEG)] * 3) ** 2
NOISE_PX = 0.05
STEPS = {"zoom": 1200, "focus": 4000, "iris": 100}
PLANNED = {"position_mm": 3.0, "angle_deg": 0.8}
SIDES = [(-0.3, 0.4, -0.9), (0.6, 0.3, -0.8), (0.1, -0.7, -0.7), (-0.7, -0.2, -0.8)]


def nudged(rng, pose, covariance):
    step = rng.multivariate_normal(np.zeros(6), covariance)
    turn = Rotation.from_rotvec(step[3:]).as_matrix()
    return Pose(
        pose.target, pose.source, turn @ pose.rotation, pose.translation_mm + step[:3]
    )


def facts() -> SessionFacts:
    found = load_cell("virtual").calibrations
    small = NamedCovariance(parameters=["cx_px"], matrix=[[0.01]])
    camera = found.camera.model_copy(
        update={
            "covariance": small,
            "standard_deviation": {"centre_x_px": 0.1, "centre_y_px": 0.1, "k1": 1e-4},
        }
    )
    return SessionFacts(
        key="part",
        cell="bench",
        simulated=True,
        date="2026-01-01",
        serials={"arm": "A-1"},
        arm_model="ur5e",
        camera=camera,
        lens_table=found.lens_table,
        hand_eye=found.hand_eye.model_copy(update={"covariance": EYE.tolist()}),
        part_pose=found.part_pose,
        robot={"position_mm": ROBOT_MM, "angle_deg": ROBOT_DEG},
        blur_circle_mm=0.0135,
        workspace_low_mm=(-900, -900, 20),
        workspace_high_mm=(900, 900, 1200),
    )


class DrawnSights:
    """A block of 60 x 40 x 30 mm, and where its edges truly are in every picture.

    Attributes:
        flat: only the outline of the upper face is measured.
        wrong_px: the first edge is taken for a line so far beside it.
        sides: how many views there are.
        astray: so many first pictures show next to nothing of the part.
    """

    def __init__(
        self, bench, *, flat=False, wrong_px=0.0, planned=PLANNED, sides=99, astray=0
    ):
        self.bench, self.flat, self.wrong_px = bench, flat, wrong_px
        self.sides, self.astray = sides, astray
        self.planned = planned
        self.edges = cad_edges(
            box_mesh(Box(np.array([-30.0, -20, 0]), np.array([30.0, 20, 30])), name="b")
        )

    def views(self):
        lens = self.bench.facts.lens_at(STEPS)
        return [
            SightView(
                f"v{i + 1}" if i == 0 else f"aside {i}",
                part_from_camera(-300 * np.array(side) / np.linalg.norm(side), side, i),
                lens.d_mm,
                STEPS,
                **(self.planned if i == 0 else {}),
            )
            for i, side in enumerate(SIDES[: self.sides])
        ]

    def exposure_factor(self, shot, camera_from_part):
        return 2.0 if shot.exposure_s < 0.02 else 1.0

    def measure(self, shot, camera_from_part):
        truth, rng = self.bench.truth_of(shot), self.bench.rng(shot.frame_id)
        camera, edges = camera_at(self.bench.facts, self.bench.true_lens), self.edges
        middle = (edges.start_mm + edges.end_mm) / 2
        to_camera = truth.inverse().translation_mm - middle
        shown = ((edges.normal_a * to_camera).sum(axis=1) > 0) | (
            (edges.normal_b * to_camera).sum(axis=1) > 0
        )
        if self.flat:
            shown &= (edges.start_mm[:, 2] > 29) & (edges.end_mm[:, 2] > 29)
        if self.astray:
            self.astray -= 1
            shown &= np.cumsum(shown) <= 1
        ends = np.stack([edges.start_mm[shown], edges.end_mm[shown]], axis=1)
        share = np.array([0.2, 0.8])[:, None]
        places = (ends[:, :1] * (1 - share) + ends[:, 1:] * share).reshape(-1, 3)
        pixels = project(camera, truth.rotation, truth.translation_mm, places)
        pixels = pixels + rng.normal(0, NOISE_PX, pixels.shape)
        pixels[:2] += self.wrong_px
        count = len(ends)
        none = np.zeros((0, 3))
        return SeenPart(
            ends,
            pixels,
            np.repeat(np.arange(count), 2),
            np.full(2 * count, NOISE_PX),
            tuple(f"edge {i}" for i in np.flatnonzero(shown)),
            np.ones(count, np.bool_),
            none,
            none,
            np.zeros(0),
            np.zeros((0, 2)),
            np.zeros(0),
            (),
            1.0,
        )


class DrawnBench:
    """Goes everywhere at once; told and true poses differ by drawn errors."""

    def __init__(
        self, seed=0, *, refused=(), shifted_mm=None, knocked_after=99, **sights
    ):
        self.facts, self._seed = facts(), seed
        lens = self.facts.lens_at(STEPS)
        self._random = np.random.default_rng([seed, 7])
        self.true_hand = nudged(
            self._random, self.facts.tool_from_camera(lens.d_mm), EYE
        )
        sigma = self.facts.lens_table.d_standard_deviation_mm
        d_mm = lens.d_mm + self._random.normal(0, sigma)
        self.true_lens = replace(lens, d_mm=d_mm)
        placed = np.diag([2.0] * 3 + [0.01] * 3) ** 2
        self.true_part = nudged(self._random, self.facts.base_from_part, placed)
        if shifted_mm is not None:
            moved = Pose("part", "part", np.eye(3), np.array(shifted_mm))
            self.true_part = self.facts.base_from_part @ moved
        self.sights = DrawnSights(self, **sights)
        self.refused, self.asked = refused, 0
        self.knocked_after = knocked_after
        self._tools: list[Pose] = []
        self._truths: dict[int, Pose] = {}

    def rng(self, number):
        return np.random.default_rng([number, 3, self._seed])

    def joints_for(self, base_from_camera, *, d_mm):
        self.asked += 1
        if self.asked in self.refused:
            return Refusal("out of reach")
        tool = base_from_camera @ self.facts.tool_from_camera(d_mm).inverse()
        self._tools.append(tool)
        return Stand(np.array([len(self._tools) - 1.0]), tool)

    def way_to(self, joints):
        return Way(joints[None], 1.0)

    def move(self, joints):
        self._here = joints

    def set_lens(self, *, zoom, focus, iris):
        assert {"zoom": zoom, "focus": focus, "iris": iris} == STEPS

    def shoot(self, exposure_s=None):
        told = self._tools[int(self._here[0])]
        number = len(self._truths) + 1
        self._truths[number] = nudged(self._random, told, ROBOT)
        if len({tool.matrix.tobytes() for tool in self._tools}) > self.knocked_after:
            aside = Pose("part", "part", np.eye(3), np.array([4.0, 4.0, 0.0]))
            self.true_part, self.knocked_after = self.true_part @ aside, 99
        return Shot(
            np.zeros((4, 4), np.uint8),
            255,
            exposure_s or 0.01,
            1.0,
            self._here,
            told,
            STEPS,
            {},
            True,
            number,
        )

    def truth_of(self, shot):
        camera = self._truths[shot.frame_id] @ self.true_hand
        return camera.inverse() @ self.true_part


def carried_out(bench, folder, answers=(), options=None):
    """Outcome, steps shown, store; answers to ``Allow`` in turn, then True."""
    store = SessionStore.create(folder, bench.facts)
    return (*driven(bench, store, answers, options), store)


def driven(bench, store, answers=(), options=None):
    steps = PartWizard().steps(bench, store, options or WizardOptions(auto=True))
    answer, shown, left = None, [], list(answers)
    while True:
        try:
            step = steps.send(answer)
        except StopIteration as stop:
            return stop.value, shown
        shown.append(step)
        answer = None
        if isinstance(step, Allow):
            answer = left.pop(0) if left else True


def only_views(count):
    """So many views, and none that is kept apart."""
    return WizardOptions(auto=True, most_samples=count, verify=False)


def pull(outcome, bench) -> float:
    """Square of the error by the stated covariance; 6 on average."""
    document = outcome.document
    pose = Pose.from_matrix("base", "part", np.array(document.matrix))
    step = difference(only(bench.true_part), only(pose))[0]
    return float(step @ np.linalg.solve(np.array(document.covariance), step))


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    bench = DrawnBench()
    folder = tmp_path_factory.mktemp("part") / "session"
    return (bench, *carried_out(bench, folder))


def test_a_part_is_found_within_its_stated_uncertainty(session):
    bench, outcome, _, _ = session
    assert outcome.quality.verdict == "go", outcome.quality.reasons
    assert pull(outcome, bench) < 16.8  # 99 % of a chi-square with 6 degrees of freedom
    assert outcome.quality.error_95_mm < 0.6
    assert "mm" in outcome.lines[0]


def test_the_result_says_how_it_depends_on_the_hand_eye_transform(session):
    bench, outcome, _, _ = session
    assert outcome.document.hand_eye_sha256 == content_sha256(bench.facts.hand_eye)
    lever = np.array(outcome.document.by_hand_eye)
    total = np.array(outcome.document.covariance)
    alone = total - lever @ EYE @ lever.T
    assert np.linalg.eigvalsh(alone).min() > 0


def test_the_expected_error_at_the_views_of_the_plan_is_compared_with_its_room(session):
    _, outcome, _, _ = session
    (line,) = (text for text in outcome.lines if "v1" in text)
    assert "the plan bears 3.00 mm and 0.80 deg" in line


def test_a_stored_session_gives_the_same_numbers_again(session):
    _, outcome, _, store = session
    again = PartWizard().outcome(SessionStore.open(store.path))
    assert again.document.model_dump_json() == outcome.document.model_dump_json()
    assert again.lines == outcome.lines


def test_a_view_that_was_kept_apart_tests_the_place_in_mm(session):
    _, outcome, _, store = session
    (kept,) = store.usable("verification")
    held = outcome.details["verification"]
    assert [view.name for view in held.views] == [kept.name]
    assert 0.05 < held.ratio < 3
    assert outcome.quality.out_of_sample_mm == pytest.approx(held.error)
    (line,) = (text for text in outcome.lines if "held-out" in text)
    assert f"off by {held.error:.3g} mm" in line


def test_a_part_that_was_knocked_aside_before_the_held_out_view_is_noticed(tmp_path):
    bench = DrawnBench(9, knocked_after=3)
    outcome, _, store = carried_out(bench, tmp_path / "session")
    (kept,) = store.usable("verification")
    causes = {cause.code: cause for cause in outcome.quality.causes}
    assert kept.name in causes["held-out-view-does-not-fit"].message
    assert outcome.quality.verdict != "go"


def test_a_session_without_its_held_out_view_is_not_a_go(tmp_path):
    answers = [True, True, True, Word.FINISH]
    outcome, _, _ = carried_out(DrawnBench(10), tmp_path / "session", answers)
    assert "not-verified" in {cause.code for cause in outcome.quality.causes}


def test_a_view_in_vain_is_tried_again_to_test_the_place_when_no_other_is_left(
    tmp_path,
):
    bench = DrawnBench(12, sides=4, astray=1)
    outcome, _, store = carried_out(bench, tmp_path / "session")
    tried = [(one.name, one.role, one.usable) for one in store.samples]
    assert tried[0] == ("v1", "calibration", False)
    assert tried[-1] == ("v1", "verification", True)
    assert len(tried) == 5
    assert "not-verified" not in {cause.code for cause in outcome.quality.causes}


def test_a_part_that_is_found_for_a_run_is_tested_by_the_run(tmp_path):
    outcome, _, store = carried_out(
        DrawnBench(11), tmp_path / "session", options=only_views(3)
    )
    assert not store.usable("verification")
    assert outcome.quality.verdict == "go"
    assert outcome.quality.out_of_sample_mm < 1.0
    assert any("no view was kept apart" in line for line in outcome.lines)


def test_nothing_is_left_open_in_the_result(session):
    _, outcome, _, store = session
    document = keep_result(store.path / "part_pose.json", store, outcome)
    assert missing_of(json.loads(document.model_dump_json(by_alias=True))) == []
    (before,) = (text for text in outcome.lines if "calibration before" in text)
    assert document.comparison.words in before
    assert document.comparison.alarm == ("ALARM" in before)


def test_residuals_are_kept_place_by_place_and_square_to_edges(session):
    _, outcome, _, _ = session
    found = outcome.details["found"]
    for one, kept in zip(found.pictured, outcome.points, strict=True):
        lengths = np.hypot(kept.dx_px, kept.dy_px)
        whitened = np.abs(one.resection.best.estimate.residuals)
        assert lengths == pytest.approx(whitened * NOISE_PX, abs=2e-4)
        assert kept.view == one.sample.name


def test_a_session_that_broke_off_goes_on_with_the_next_view(tmp_path):
    bench = DrawnBench(1)
    folder = tmp_path / "session"
    carried_out(bench, folder, options=only_views(1))
    store = SessionStore.open(folder, repair=True)
    first = [sample.name for sample in store.samples]
    driven(bench, store, options=only_views(2))
    names = [sample.name for sample in store.samples]
    assert names[:1] == first == ["v1"]
    assert len(set(names)) == len(names) == 2


def test_the_last_view_can_be_taken_back_and_enough_is_enough(tmp_path):
    answers = [True, True, Word.UNDO, True, Word.FINISH]
    _, _, store = carried_out(DrawnBench(2), tmp_path / "session", answers)
    assert [sample.name for sample in store.samples] == ["v1", "aside 1"]


def test_a_view_taken_back_at_the_held_out_one_is_taken_again(tmp_path):
    """Also when the session breaks off there."""
    bench, options = DrawnBench(2), WizardOptions(auto=True)
    store = SessionStore.create(tmp_path / "session", bench.facts)
    steps = PartWizard().steps(bench, store, options)
    shown = broken_off(steps, True, True, True, Word.UNDO)
    views = [step.text.split(": ")[1] for step in shown if isinstance(step, Allow)]
    assert views == ["v1", "aside 1", "aside 2", "aside 3", "aside 2"]
    assert taken_back(shown) == ["aside 2 is taken back"]
    store = SessionStore.open(store.path, repair=True)
    broken_off(PartWizard().steps(bench, store, options), True, True)
    assert [(s.number, s.name, s.role) for s in store.samples] == [
        (1, "v1", "calibration"),
        (2, "aside 1", "calibration"),
        (4, "aside 2", "calibration"),
        (5, "aside 3", "verification"),
    ]


def test_a_view_that_the_arm_cannot_take_is_said_and_left_out(tmp_path):
    bench = DrawnBench(3, refused=(2,))
    two = only_views(2)
    _, shown, store = carried_out(bench, tmp_path / "session", options=two)
    assert any("out of reach" in getattr(step, "text", "") for step in shown)
    assert "aside 1" not in {sample.name for sample in store.samples}


def test_a_dark_picture_of_the_part_is_exposed_longer(session):
    *_, store = session
    assert all(sample.exposure_s >= 0.02 for sample in store.samples)


def test_a_line_that_was_taken_for_another_is_left_out(tmp_path):
    bench = DrawnBench(4, wrong_px=4.0)
    two = WizardOptions(most_samples=2)
    outcome, _, store = carried_out(bench, tmp_path / "session", options=two)
    assert all(sample.extra["sight"]["left_out"] for sample in store.samples)
    assert outcome.quality.verdict == "go"
    assert pull(outcome, bench) < 22.5


def test_a_bench_without_a_picture_says_what_to_look_at(tmp_path):
    bench = DrawnBench(5, refused=(1, 2, 3, 4))
    with pytest.raises(CalibrationError) as caught:
        carried_out(bench, tmp_path / "session")
    assert "part_pose" in caught.value.hint


def test_a_plan_with_less_room_than_the_errors_is_told(tmp_path):
    tight = {"position_mm": 0.02, "angle_deg": 5.0}
    one = only_views(1)
    bench = DrawnBench(6, planned=tight)
    outcome, _, _ = carried_out(bench, tmp_path / "session", options=one)
    causes = {cause.code: cause for cause in outcome.quality.causes}
    assert "room that the plan has" in causes["plan-has-less-room"].message
    assert outcome.quality.verdict == "no-go"


def test_the_mirror_image_of_a_flat_outline_is_reported(tmp_path):
    """From one far picture of one face only; several sides then settle it."""
    bench = DrawnBench(7, flat=True)
    _, _, store = carried_out(bench, tmp_path / "one", options=only_views(1))
    (pictured,) = found_of(store).pictured
    assert len(pictured.resection.branches) > 1
    codes = judge_resection(pictured.sight, pictured.resection).codes()
    assert ("mirror-ambiguity" in codes) == pictured.resection.ambiguous
    more, _, _ = carried_out(
        DrawnBench(7, flat=True),
        tmp_path / "more",
        options=only_views(2),
    )
    assert "mirror-ambiguity" not in {cause.code for cause in more.quality.causes}
    assert pull(more, bench) < 22.5


def test_how_far_the_part_was_off_is_said_in_mm(tmp_path):
    bench = DrawnBench(8, shifted_mm=(3.0, -4.0, 0.0))
    one = only_views(1)
    outcome, _, _ = carried_out(bench, tmp_path / "session", options=one)
    found = outcome.details["found"]
    assert found.moved_mm == pytest.approx(5.0, abs=0.8)


def test_the_report_shows_every_picture(session):
    _, outcome, _, store = session
    page = PartWizard().page(store, outcome)
    assert all(sample.name in page for sample in store.samples)
    assert 'src="http' not in page


@pytest.mark.full
def test_stated_intervals_hold_the_errors_of_many_sessions(tmp_path):
    pulls, ratios = [], []
    for seed in range(60):
        bench = DrawnBench(100 + seed)
        outcome, _, _ = carried_out(bench, tmp_path / str(seed))
        pulls.append(pull(outcome, bench))
        ratios.append(outcome.details["verification"].ratio)
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.25
    assert np.mean(pulls) == pytest.approx(6.0, abs=1.6)
    assert np.mean(np.array(pulls) < 12.59) > 0.86  # 95 % expected
