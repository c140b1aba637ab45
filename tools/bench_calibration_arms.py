"""Whole hand-eye sessions with many arms: do the stated intervals hold?

    python tools/bench_calibration_arms.py --seeds 29 --first 0

The wizard chooses its views on the uncalibrated virtual cell, where lens, camera, hand-eye,
target and arm are drawn anew for every seed; points are drawn with noise where the truth
puts them, instead of being found in pictures. The views of a session are then taken once
more with other truths, with an arm without errors, and with arms whose errors change over
seven and over thirty degrees of a joint.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calibration.poses import difference, only
from calibration.projection import CAMERA_NAMES, PinholeCamera, project
from calibration.targets.detect import Detection
from calibration.wizard.hand_eye import HandEyeWizard
from calibration.wizard.hand_eye_result import outcome_of
from calibration.wizard.lookout import camera_at, layout_of
from calibration.wizard.session_store import Finding, SessionStore
from calibration.wizard.working import working_setting
from drivers.virtual_arm_truth import true_flange
from drivers.virtual_settings import WorldErrors
from mvp.calibrated import NamedCovariance
from mvp.cell.calibrate_facts import target_facts
from mvp.cell.check_job import load_unjudged
from mvp.geometry import Pose
from mvp.kinematics import arm_model, inverse
from mvp.wizard import (
    Allow,
    Ask,
    Refusal,
    SessionFacts,
    Shot,
    Stand,
    Way,
    WizardOptions,
)
from tools.bench_calibration_sessions import coverage

NOISE_PX = 0.04
D_SIGMA_MM, K1 = 0.006, -0.06
# What a session of the camera wizard leaves open; the decentring goes with the centre.
LEFT_OPEN = {
    "cx_px": 0.35,
    "cy_px": 0.3,
    "k1": 0.002,
    "k2": 0.03,
    "p1": 6e-5,
    "p2": 7e-5,
}
TOGETHER = {("k1", "k2"): -0.9, ("cx_px", "p2"): 0.9, ("cy_px", "p1"): 0.7}
HAND_DEG, HAND_MM, TARGET_DEG, TARGET_MM = 0.4, 1.5, 0.7, 2.5
LOW_MM, HIGH_MM, BORDER_PX = 30.0, 700.0, 6.0
AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class Arm:
    """Errors of an arm; ``per_rad``: how quickly they change with the joints."""

    mm: float = 0.05
    deg: float = 0.01
    per_rad: float = 8.0


ARMS = {
    "no errors": Arm(0.0, 0.0),
    "over 7 deg": Arm(),
    "over 30 deg": Arm(per_rad=2.0),
}


class PointsBench:
    """See ``mvp.wizard.Bench``; its pictures are points."""

    drives_straight = True

    def __init__(self, seed: int, arm: Arm) -> None:
        rng = np.random.default_rng([78, seed])
        self.facts = _facts(seed)
        self._arm, self._seed = arm, seed
        self._setting = working_setting(self.facts)
        lens = self.facts.lens_at(self._setting.by_name)
        near = camera_at(self.facts, lens)
        share = 1 + rng.normal(0, D_SIGMA_MM) / lens.d_mm
        off = rng.multivariate_normal(np.zeros(len(LEFT_OPEN)), _left_open())
        values = dict(zip(CAMERA_NAMES, near.values, strict=True))
        for name, value in zip(LEFT_OPEN, off, strict=True):
            values[name] += value
        values["fx_px"] *= share
        values["fy_px"] *= share
        self._camera = PinholeCamera.from_values(list(values.values()))
        believed = self.facts.tool_from_camera(lens.d_mm)
        self.hand = believed @ _small("camera", HAND_DEG, HAND_MM, rng)
        target = self.facts.target
        self._place = target.base_from_target @ _small(
            "target", TARGET_DEG, TARGET_MM, rng
        )
        self._size = 1 + rng.normal(0, target.square_sigma_mm) / target.square_mm
        self._points = layout_of(target).points_mm
        self.arm = arm_model(self.facts.arm_model)
        self.joints = np.radians([0.0, -90, 90, -90, -90, 0])
        self.seen: dict[int, Detection] = {}
        self._noise = np.random.default_rng([79, seed])

    def rng(self, number: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, number])

    def standing(self) -> Stand:
        return Stand(self.joints, self.arm.forward(self.joints))

    def joints_for(self, pose: Pose, *, d_mm: float) -> Stand | Refusal:
        tool = pose @ self.facts.tool_from_camera(d_mm).inverse()
        found = inverse(self.arm, tool, near=self.joints)
        if not found or not LOW_MM < pose.translation_mm[2] < HIGH_MM:
            return Refusal("out of reach")
        best = min(found, key=lambda j: float(np.abs(j - self.joints).max()))
        return Stand(best, self.arm.forward(best))

    def way_to(self, joints: np.ndarray) -> Way:
        return Way(np.asarray(joints)[None], 1.0)

    def move(self, joints: np.ndarray) -> Stand:
        self.joints = np.asarray(joints)
        return self.standing()

    def set_lens(self, **_: object) -> None:
        """It stays at the one setting of the session."""

    def shoot(self, exposure_s: float | None = None) -> Shot:
        number, stand = len(self.seen) + 1, self.standing()
        self.seen[number] = self._found()
        picture = np.zeros((4, 4), np.uint8)
        steps = self._setting.by_name
        told = stand.joints, stand.base_from_tool
        return Shot(picture, 255, 0.01, 1.0, *told, steps, {}, True, number)

    def _found(self) -> Detection:
        """Where the truth puts the points that are in the picture."""
        errors = WorldErrors(arm_mm=self._arm.mm, arm_deg=self._arm.deg)
        with patch("drivers.virtual_arm_truth._PER_RAD", self._arm.per_rad):
            tool = true_flange(self.arm, self.joints, errors, self._seed)
        there = (tool @ self.hand).inverse() @ self._place
        pose = there.rotation, there.translation_mm
        pixels = project(self._camera, *pose, self._points * self._size)
        sensor = self.facts.sensor
        far = np.array([sensor.width_px, sensor.height_px]) - 1 - BORDER_PX
        ids = np.flatnonzero(((pixels > BORDER_PX) & (pixels < far)).all(axis=1))
        found = pixels[ids] + self._noise.normal(0, NOISE_PX, (len(ids), 2))
        spacing, window = np.full(len(ids), 40.0), np.full(len(ids), 5)
        return Detection(ids, self._points[ids], found, spacing, window)


def session(bench: PointsBench, folder: Path) -> SessionStore:
    """A whole session of the wizard that is left alone."""
    store = SessionStore.create(folder, bench.facts)

    def found_in(shot: Shot, *_: object, **__: object) -> Detection:
        return bench.seen[shot.frame_id]

    with patch("calibration.wizard.lookout.found_in", found_in):
        steps = HandEyeWizard().steps(bench, store, WizardOptions(auto=True))
        step = next(steps, None)
        while step is not None:
            answer = True if isinstance(step, Allow) else None
            answer = step.default if isinstance(step, Ask) else answer
            try:
                step = steps.send(answer)
            except StopIteration:
                step = None
    return store


def again(store: SessionStore, bench: PointsBench, folder: Path) -> SessionStore:
    """The same views with another truth."""
    copy = SessionStore.create(folder, bench.facts)
    for sample in store.samples:
        bench.move(np.array(sample.joints))
        shot = bench.shoot()
        finding = Finding(bench.seen[shot.frame_id])
        copy.add(shot, finding, name=sample.name, role=sample.role)
    return copy


def ratios(store: SessionStore, bench: PointsBench) -> np.ndarray:
    """(6,): errors of the transform by their stated sigmas."""
    found = outcome_of(store).document
    pose = Pose.from_matrix("tool", "camera", np.array(found.matrix))
    off = difference(only(pose), only(bench.hand))[0]
    return off / np.sqrt(np.diag(np.array(found.covariance)))


def _facts(seed: int) -> SessionFacts:
    """The uncalibrated cell, after its camera and lens were calibrated."""
    cell = load_unjudged("virtual_uncalibrated")
    told, config = cell.calibrations, cell.config
    known = NamedCovariance(parameters=list(LEFT_OPEN), matrix=_left_open().tolist())
    camera = told.camera.model_copy(update={"covariance": known, "k1": K1})
    lens = told.lens_table.model_copy(update={"d_standard_deviation_mm": D_SIGMA_MM})
    stated = config.uncertainty
    return SessionFacts(
        key="hand-eye",
        cell="drawn",
        simulated=True,
        date="2026-01-01",
        seed=seed,
        serials={"arm": "A-1", "lens": "L-1", "camera": "C-1"},
        arm_model=config.kinematics.model,
        camera=camera,
        lens_table=lens,
        hand_eye=told.hand_eye,
        part_pose=told.part_pose,
        robot={
            "position_mm": stated.robot_position_mm,
            "angle_deg": stated.robot_angle_deg,
        },
        target=target_facts(config.target),
        blur_circle_mm=config.optics.blur_circle_um / 1000,
        workspace_low_mm=config.workspace.low_mm,
        workspace_high_mm=config.workspace.high_mm,
        temperature_c=20.0,
    )


def _left_open() -> np.ndarray:
    """Covariance of what the camera calibration leaves open."""
    names, sigmas = list(LEFT_OPEN), np.array(list(LEFT_OPEN.values()))
    shares = np.eye(len(names))
    for (one, other), share in TOGETHER.items():
        place = names.index(one), names.index(other)
        shares[place] = shares[place[::-1]] = share
    return np.asarray(shares * np.outer(sigmas, sigmas))


def _small(frame: str, deg: float, mm: float, rng: np.random.Generator) -> Pose:
    turn, shift = np.radians(rng.normal(0, deg, 3)), rng.normal(0, mm, 3)
    return Pose.from_rotvec(frame, frame, turn, shift)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=29)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    rows: dict[str, list[tuple[str, float]]] = {}
    for seed in range(asked.first, asked.first + asked.seeds):
        with tempfile.TemporaryDirectory() as folder:
            bench = PointsBench(seed, Arm())
            store = session(bench, Path(folder) / "session")
            found = {"whole session": ratios(store, bench)}
            for name, arm in ARMS.items():
                other = PointsBench(1000 + seed, arm)
                views = again(store, other, Path(folder) / name)
                found[f"again, {name}"] = ratios(views, other)
        for name, values in found.items():
            print(seed, name, np.round(values, 2), file=sys.stderr, flush=True)
            mine = zip((f"hand-eye {axis}" for axis in AXES), values, strict=True)
            rows.setdefault(name, []).extend(mine)
    for name, of in rows.items():
        print(f"\n{name}\n", *coverage(of), sep="\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
