"""Where a part stands in the cell, from one or several pictures taken by the robot.

Each picture gives ``base_from_part = base_from_tool tool_from_camera camera_from_part``,
(26) read backwards. Noise of picture and robot differs from view to view and averages
out; an error of the hand-eye transform is the same in all of them and is carried as
such, so that it can partly cancel when the same transform serves to go to a viewpoint.
All covariances are 6 x 6: translation (mm), then rotation vector (rad), in the axes of
the target frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2

from calibration.poses import Poses, difference, only
from calibration.projection import moved_pose, skew

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray, Pose

_ROUNDS = 10


@dataclass(frozen=True, eq=False)
class HandEye:
    """``tool_from_camera`` with its covariance, and the noise of the robot."""

    tool_from_camera: Pose
    covariance: FloatArray
    robot_covariance: FloatArray


@dataclass(frozen=True, eq=False)
class PartView:
    """One picture's pose of the part, its covariance, and where the tool was."""

    camera_from_part: Pose
    covariance: FloatArray
    base_from_tool: Pose


@dataclass(frozen=True, eq=False)
class LocatedPart:
    """A part in the cell.

    Attributes:
        base_from_part: the weighted mean of all views.
        own_covariance: from pictures and robot, in base axes.
        by_hand_eye: (6, 6), change of the pose for an error of ``tool_from_camera``.
        covariance: all together.
        off: (n, 6), how far each view is from the mean.
        chi_square: of the disagreement of the views.
        probability: of one at least as large if all covariances are right; 1 for one
            view.
    """

    base_from_part: Pose
    own_covariance: FloatArray
    by_hand_eye: FloatArray
    covariance: FloatArray
    off: FloatArray
    chi_square: float
    probability: float


def locate(views: Sequence[PartView], hand_eye: HandEye) -> LocatedPart:
    """Average what several views say, each weighted by what it knows.

    Raises:
        ValueError: no views.
    """
    if not views:
        raise ValueError("a part is located from one view or more")
    each = [
        view.base_from_tool @ hand_eye.tool_from_camera @ view.camera_from_part
        for view in views
    ]
    poses = Poses.of(each)
    noise, levers = _noise(views, poses, hand_eye)
    weights = np.linalg.inv(noise)
    own = np.linalg.inv(weights.sum(axis=0))
    mean = poses[:1]
    for _ in range(_ROUNDS):
        off = difference(poses, mean)
        step = own @ np.einsum("nij,nj->i", weights, off)
        mean = Poses(*moved_pose(mean.rotation, mean.translation_mm, step[None]))
    off = difference(poses, mean)
    by_hand_eye = own @ np.einsum("nij,njk->ik", weights, levers)
    chi_square = float(np.einsum("ni,nij,nj->", off, weights, off))
    freedom = 6 * (len(views) - 1)
    return LocatedPart(
        mean.pose(0, each[0].target, each[0].source),
        own,
        by_hand_eye,
        own + by_hand_eye @ hand_eye.covariance @ by_hand_eye.T,
        off,
        chi_square,
        float(chi2.sf(chi_square, freedom)) if freedom else 1.0,
    )


@dataclass(frozen=True)
class ViewpointError:
    """How far from its plan a camera will stand, as seen from the part.

    Attributes:
        position_mm: root mean square of the distance.
        angle_rad: root mean square of the rotation.
        position_95_mm: exceeded once in twenty, if errors are normal.
        angle_95_rad: likewise.
    """

    position_mm: float
    angle_rad: float
    position_95_mm: float
    angle_95_rad: float


def viewpoint_covariance(
    planned_part_from_camera: Pose, located: LocatedPart, hand_eye: HandEye
) -> FloatArray:
    """Covariance (6, 6) of the camera about a planned viewpoint, in part axes.

    The robot is sent to (20), ``base_from_part part_from_camera camera_from_tool``, with
    what is believed; it stands where the truth puts it.
    """
    part, camera = located.base_from_part, planned_part_from_camera
    tool = part @ camera @ hand_eye.tool_from_camera.inverse()
    to_part = part.rotation.T
    reached = (part @ camera).translation_mm
    by_part = _turned(to_part, _at(reached - part.translation_mm))
    by_tool = _turned(to_part, _at(reached - tool.translation_mm))
    # an error of X moves the camera on the hand, and has moved the located part
    on_hand = _turned(to_part @ tool.rotation, np.eye(6))
    shared = on_hand - by_part @ located.by_hand_eye
    return np.asarray(
        by_part @ located.own_covariance @ by_part.T
        + by_tool @ hand_eye.robot_covariance @ by_tool.T
        + shared @ hand_eye.covariance @ shared.T
    )


def viewpoint_error(covariance: FloatArray) -> ViewpointError:
    """A 6 x 6 covariance in two numbers, and their 95 % limits."""
    position, angle = covariance[:3, :3], covariance[3:, 3:]
    return ViewpointError(
        float(np.sqrt(np.trace(position))),
        float(np.sqrt(np.trace(angle))),
        _limit_95(position),
        _limit_95(angle),
    )


def _noise(
    views: Sequence[PartView], parts: Poses, hand_eye: HandEye
) -> tuple[FloatArray, FloatArray]:
    """Covariances (n, 6, 6) of single views, and levers (n, 6, 6) of the hand-eye."""
    x = only(hand_eye.tool_from_camera)
    tools = Poses.of([view.base_from_tool for view in views])
    cameras = tools @ x
    picture = _turned(cameras.rotation, np.eye(6))
    robot = _at(parts.translation_mm - tools.translation_mm)
    shift = parts.translation_mm - cameras.translation_mm
    levers = _at(shift) @ _turned(tools.rotation, np.eye(6))
    pictures = np.stack([view.covariance for view in views])
    noise = picture @ pictures @ np.swapaxes(picture, 1, 2)
    noise = noise + robot @ hand_eye.robot_covariance @ np.swapaxes(robot, 1, 2)
    return noise, levers


def _at(lever_mm: FloatArray) -> FloatArray:
    """(..., 6, 6): how a step of one frame moves another one at a distance."""
    block = np.zeros((*lever_mm.shape[:-1], 6, 6))
    block[..., :, :] = np.eye(6)
    block[..., :3, 3:] = -skew(lever_mm)
    return block


def _turned(rotation: FloatArray, block: FloatArray) -> FloatArray:
    """A block (6, 6) followed by new axes for both of its halves."""
    both = np.zeros((*rotation.shape[:-2], 6, 6))
    both[..., :3, :3] = both[..., 3:, 3:] = rotation
    return np.asarray(both @ block)


def _limit_95(covariance: FloatArray) -> float:
    """Length that is exceeded once in twenty: a chi-square with the same two moments."""
    mean, spread = np.trace(covariance), 2 * np.trace(covariance @ covariance)
    if mean <= 0:
        return 0.0
    freedom = 2 * mean**2 / spread
    return float(np.sqrt(mean * chi2.ppf(0.95, freedom) / freedom))
