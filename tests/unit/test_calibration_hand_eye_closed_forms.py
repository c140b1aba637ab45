"""Closed forms for A X = X B: exactness, agreement with OpenCV, accuracy."""

from __future__ import annotations

from typing import get_args

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.hand_eye import (
    Method,
    Rehearsal,
    RobotNoise,
    closed_form,
    observability,
    rehearse,
)
from calibration.hand_eye.motions import all_pairs, usable
from calibration.hand_eye.target_poses import target_poses
from calibration.poses import Poses, difference

METHODS = get_args(Method)
SPEC = RobotNoise(0.2, float(np.radians(0.05)))
THEIRS = {
    "tsai-lenz": cv2.CALIB_HAND_EYE_TSAI,
    "park": cv2.CALIB_HAND_EYE_PARK,
    "daniilidis": cv2.CALIB_HAND_EYE_DANIILIDIS,
}
# Degrees and mm of one trial. How Daniilidis weighs turns against lengths depends on the
# unit of length: OpenCV takes the caller's, ours is as long as the motions are.
APART = {
    "tsai-lenz": (0.005, 0.05),
    "park": (0.03, 0.15),
    "daniilidis": (0.005, 0.05),
    "daniilidis, OpenCV in mm": (0.05, 0.1),
}


def off(pose, truth):
    step = difference(pose, truth)[0]
    return np.degrees(np.linalg.norm(step[3:])), np.linalg.norm(step[:3])


def opencv(fixed, target, method, unit_mm=1.0):
    rotation, translation = cv2.calibrateHandEye(
        list(fixed.rotation),
        list(fixed.translation_mm / unit_mm),
        list(target.rotation),
        list(target.translation_mm / unit_mm),
        method=THEIRS[method],
    )
    return Poses(rotation[None], translation.reshape(1, 3) * unit_mm)


def length_of_motions(fixed, target):
    moves = usable(all_pairs(fixed, target)).moving.translation_mm
    return np.sqrt((moves**2).sum(axis=1).mean())


def opencv_beside(fixed, target):
    """What stands beside ours, by the names of ``APART``."""
    unit = length_of_motions(fixed, target)
    found = {name: opencv(fixed, target, name) for name in ("tsai-lenz", "park")}
    found["daniilidis"] = opencv(fixed, target, "daniilidis", unit)
    found["daniilidis, OpenCV in mm"] = opencv(fixed, target, "daniilidis")
    return found


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "angles", [(0, 0, 0), (20, -70, 110), (180, 0, 0), (0, 0, 180)]
)
def test_without_noise_every_form_is_exact_whatever_the_transform(method, angles):
    rng = np.random.default_rng(3)
    turn = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    x = Poses(turn[None], np.array([[30.0, -20, 110]]))
    fixed = Poses(Rotation.random(12, rng=rng).as_matrix(), rng.normal(0, 300, (12, 3)))
    z = Poses(Rotation.random(1, rng=rng).as_matrix(), np.array([[700.0, 0, 10]]))
    target = x.inverse() @ fixed.inverse() @ z
    assert max(off(closed_form(fixed, target, method), x)) < 1e-9


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("method", METHODS)
def test_without_noise_both_mounts_are_exact(method, mount):
    seen = rehearse(Rehearsal(sigma_px=0.0, mount=mount), np.random.default_rng(1))
    found = closed_form(seen.data.fixed_from_moving, seen.camera_from_target, method)
    assert max(off(found, seen.moving_from_camera)) < 1e-9


def test_the_order_of_views_hardly_matters():
    seen = rehearse(Rehearsal(robot=SPEC), np.random.default_rng(2))
    fixed, target = seen.data.fixed_from_moving, seen.camera_from_target
    order = np.random.default_rng(0).permutation(25)
    for method in METHODS:
        one = closed_form(fixed, target, method)
        other = closed_form(fixed[order], target[order], method)
        turn, shift = off(one, other)
        assert turn < 1e-9
        assert shift < (1e-9 if method == "daniilidis" else 0.1)


def _trials(count):
    errors, apart = [], {name: [] for name in APART}
    for seed in range(count):
        seen = rehearse(Rehearsal(robot=SPEC), np.random.default_rng(seed))
        targets = target_poses(seen.data, Rehearsal().camera).camera_from_target
        fixed = seen.data.fixed_from_moving
        errors.append(off(closed_form(fixed, targets), seen.moving_from_camera))
        for name, theirs in opencv_beside(fixed, targets).items():
            ours = closed_form(fixed, targets, name.partition(",")[0])
            apart[name].append(off(ours, theirs))
    return np.array(errors), {name: np.array(rows) for name, rows in apart.items()}


def test_closed_forms_agree_with_opencv():
    _, apart = _trials(2)
    assert all((rows <= APART[name]).all() for name, rows in apart.items())


@pytest.mark.full
@pytest.mark.timeout(3600)
def test_closed_forms_reach_the_known_accuracy():
    errors, apart = _trials(30)
    rms = np.sqrt((errors**2).mean(axis=0))
    assert rms[0] <= 0.05
    assert rms[1] <= 0.27
    assert (np.quantile(errors, 0.95, axis=0) <= (0.08, 0.40)).all()
    assert all((rows <= APART[name]).all() for name, rows in apart.items())


def test_fewer_than_three_views_are_refused():
    seen = rehearse(Rehearsal(views=2), np.random.default_rng(0))
    with pytest.raises(ValueError, match="three views"):
        closed_form(seen.data.fixed_from_moving, seen.camera_from_target)


def test_rotations_about_one_axis_leave_its_direction_undetermined():
    rng = np.random.default_rng(4)
    angles = rng.uniform(-1, 1, (10, 1)) * [[0.0, 0.0, 1.0]]
    fixed = Poses(Rotation.from_rotvec(angles).as_matrix(), rng.normal(0, 50, (10, 3)))
    found = observability(all_pairs(fixed, fixed.inverse()), "tool")
    assert not found.determined
    assert found.undetermined == (
        "translation along and rotation about the z axis of the tool"
    )
    cause = found.causes()[0]
    assert (cause.code, cause.grade) == ("one-axis", "no-go")
    assert "the x axis of the tool" in cause.action


def test_a_skew_axis_is_named_by_its_numbers():
    axis = np.array([1.0, 1, 0]) / np.sqrt(2)
    turn = Rotation.from_rotvec(np.linspace(-1, 1, 6)[:, None] * axis).as_matrix()
    fixed = Poses(turn, np.zeros((6, 3)))
    found = observability(all_pairs(fixed, fixed.inverse()), "base")
    assert "(0.71, 0.71, 0.00) of the base" in found.undetermined
