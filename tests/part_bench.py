"""A bench for the part wizard that draws a block's edges instead of rendering them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.poses import difference, only
from calibration.projection import project
from calibration.wizard.lookout import camera_at
from calibration.wizard.part import PartWizard
from calibration.wizard.session_store import SessionStore
from mvp.calibrated import NamedCovariance
from mvp.cell.loading import load_cell
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
)

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
