"""Where to look from to find out where a part lies.

The plan's own views come first: they show the features sharp and whole. Others follow
that circle the features with the same lens setting, each chosen for what it adds: one
picture knows a part far worse along its line of sight than across it, so that the next
one is wanted from the side. They need not resolve what the task asks for, nor show every
feature; those that are hidden tell nothing. What is out of focus, out of the picture or
out of reach is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from mvp.geometry import Pose
from mvp.optics.views import concatenated, single_view
from mvp.wizard import SightView

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.plan_job import Planned
    from mvp.cell.realise_view import RealisedView
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Views
    from mvp.planning.plan import PlannedView
    from mvp.scene import Feature

MOST_VIEWS = 5
_TILTS_DEG = (12.0, 20.0, 30.0, 40.0)
_SIDES = 12
_ROLLS_DEG = (0, 90, 180, 270)
_SIGMA_PX = 0.2
_NEEDED = frozenset({"focus_near", "focus_far", "field_of_view", "workspace"})
# What is known of the part beforehand: it decides only what the pictures leave open.
_PRIOR_MM, _PRIOR_DEG = 5.0, 3.0
# Arm and hand-eye blur every picture's pose alike: more pictures from one side are idle.
_FLOOR_MM, _FLOOR_DEG = 0.2, 0.03


@dataclass(frozen=True, eq=False)
class _Candidate:
    view: SightView
    information: FloatArray


def locating_views(planned: Planned, most: int = MOST_VIEWS) -> list[SightView]:
    """The plan's views, then others by what they add; most of them at most.

    Args:
        planned: with one view at least.
        most: how many.
    """
    pairs = zip(planned.plan.views, planned.found.views, strict=True)
    own, around = [], []
    for view, realised in pairs:
        points = _points(realised.features)
        own.append(_candidate(_own(view), realised.view, points, planned))
        around += _around(planned, view, realised)
    chosen = own[:most]
    known = _prior() + sum(one.information for one in chosen)
    while len(chosen) < most and around:
        best = min(around, key=lambda one: _doubt_mm(planned, known + one.information))
        around.remove(best)
        chosen.append(best)
        known = known + best.information
    return [one.view for one in chosen]


def _own(view: PlannedView) -> SightView:
    return SightView(
        view.id,
        Pose.from_matrix("part", "camera", np.array(view.part_from_camera)),
        view.d_mm,
        view.lens_steps.model_dump(),
        view.tolerance.position_mm,
        view.tolerance.angle_deg,
    )


def _points(features: Sequence[Feature]) -> FloatArray:
    """Places of the part that the features are about, (k, 3)."""
    return np.concatenate([f.key_points_mm for f in features] or [np.zeros((0, 3))])


def _around(
    planned: Planned, view: PlannedView, realised: RealisedView
) -> list[_Candidate]:
    """Useful views in reach that circle the features, at the same lens setting."""
    problem = realised.problem
    dictated = planned.setting.cell.arm.dictates_roll
    names, poses = _circled(
        view.id,
        realised.view.part_from_camera(),
        problem.target_centre_mm,
        _ROLLS_DEG[:1] if dictated else _ROLLS_DEG,
    )
    setting = realised.setting
    views = concatenated(
        [
            single_view(
                pose,
                d_mm=setting.d_mm,
                f_mm=setting.f_mm,
                a_mm=setting.a_mm,
                e_mm=setting.e_mm,
            )
            for pose in poses
        ]
    )
    good = planned.setting.arm.reachable_and_clear(views)
    for constraint in problem.constraints:
        if constraint.kind in _NEEDED:
            rows = constraint.rows(views, gradient=False)
            good &= (rows.value >= 0).all(axis=1)
    seen = _seen(planned, realised.features, views)
    steps = view.lens_steps.model_dump()
    found = []
    for i in map(int, np.flatnonzero(good & seen.any(axis=1))):
        shown = [f for f, s in zip(realised.features, seen[i], strict=True) if s]
        sight = SightView(names[i], poses[i], setting.d_mm, steps)
        found.append(_candidate(sight, views[i], _points(shown), planned))
    return found


def _seen(planned: Planned, features: Sequence[Feature], views: Views) -> BoolArray:
    """Which features (F,) every view shows whole, (N, F)."""
    factory = planned.setting.factory
    return np.stack(
        [factory.region(f).signed_distance(views.position_mm) > 0 for f in features],
        axis=1,
    )


def _circled(
    name: str, pose: Pose, centre_mm: FloatArray, rolls_deg: Sequence[int]
) -> tuple[list[str], list[Pose]]:
    """The view turned about the features to all sides; some rolls suit the arm better."""
    names, poses = [], []
    for tilt in _TILTS_DEG:
        for side in range(_SIDES):
            angle = 2 * np.pi * side / _SIDES
            axis = pose.rotation @ np.array([np.cos(angle), np.sin(angle), 0.0])
            turn = Rotation.from_rotvec(np.radians(tilt) * axis).as_matrix()
            place = centre_mm + turn @ (pose.translation_mm - centre_mm)
            for roll in rolls_deg:
                rolled = Rotation.from_euler("z", roll, degrees=True).as_matrix()
                words = f"{name}, {tilt:.0f} deg aside at {360 * side // _SIDES} deg"
                names.append(f"{words}, rolled by {roll} deg" if roll else words)
                poses.append(
                    Pose("part", "camera", turn @ pose.rotation @ rolled, place)
                )
    return names, poses


def _candidate(
    view: SightView, views: Views, points: FloatArray, planned: Planned
) -> _Candidate:
    """With the information (6, 6) that its picture gives about the part's pose.

    In part axes, shift and turn about the middle of the part.
    """
    q = views.camera_points(points)[0]
    centre = planned.setting.scene.scene.part.bounds.centre_mm
    sensor = planned.setting.factory.intrinsics.sensor
    f_px = float(views.f_cal_mm[0]) / sensor.pitch_y_mm
    by_q = np.zeros((len(q), 2, 3))
    by_q[:, 0, 0] = by_q[:, 1, 1] = f_px / q[:, 2]
    by_q[:, :, 2] = -f_px * q[:, :2] / q[:, 2:] ** 2
    by_pose = views.rotation[0].T @ _moved(points - centre)
    rows = (by_q @ by_pose).reshape(-1, 6) / _SIGMA_PX
    own = rows.T @ rows
    blurred = np.linalg.inv(own + 1e-9 * _prior()) + _floor()
    return _Candidate(view, np.asarray(np.linalg.inv(blurred), np.float64))


def _moved(arms_mm: FloatArray) -> FloatArray:
    """(k, 3, 6): motion of points by shift and turn."""
    out = np.zeros((len(arms_mm), 3, 6))
    out[:, :, :3] = np.eye(3)
    x, y, z = arms_mm.T
    out[:, 0, 4], out[:, 0, 5] = z, -y
    out[:, 1, 3], out[:, 1, 5] = -z, x
    out[:, 2, 3], out[:, 2, 4] = y, -x
    return out


def _doubt_mm(planned: Planned, information: FloatArray) -> float:
    """How unsure the places of all features are: root mean square, mm."""
    points = np.concatenate([_points(view.features) for view in planned.found.views])
    levers = _moved(points - planned.setting.scene.scene.part.bounds.centre_mm)
    spread = levers @ np.linalg.inv(information) @ np.swapaxes(levers, 1, 2)
    return float(np.sqrt(np.trace(spread, axis1=1, axis2=2).mean()))


def _prior() -> FloatArray:
    return np.diag([_PRIOR_MM**-2] * 3 + [np.radians(_PRIOR_DEG) ** -2] * 3)


def _floor() -> FloatArray:
    return np.diag([_FLOOR_MM**2] * 3 + [np.radians(_FLOOR_DEG) ** 2] * 3)
