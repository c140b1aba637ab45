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
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag
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
    """One picture's pose of the part, its covariance, and where the tool was.

    Attributes:
        by_camera: (6, c), change of the pose for errors of the intrinsics, which were
            held fixed and are the same in all pictures; None: they are taken as exact.
    """

    camera_from_part: Pose
    covariance: FloatArray
    base_from_tool: Pose
    by_camera: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class LocatedPart:
    """A part in the cell.

    Attributes:
        base_from_part: the weighted mean of all views.
        own_covariance: from pictures, robot and intrinsics, in base axes.
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


def locate(
    views: Sequence[PartView],
    hand_eye: HandEye,
    camera_covariance: FloatArray | None = None,
) -> LocatedPart:
    """Average what several views say, each weighted by what it knows.

    Args:
        views: of a part that does not move.
        hand_eye: through which it was seen.
        camera_covariance: (c, c) of the intrinsics that ``by_camera`` is about.

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
    known = _Known.of(views, poses, hand_eye, camera_covariance)
    mean = poses[:1]
    for _ in range(_ROUNDS):
        step = known.gain @ difference(poses, mean).ravel()
        mean = Poses(*moved_pose(mean.rotation, mean.translation_mm, step[None]))
    off = difference(poses, mean)
    chi_square = float(off.ravel() @ known.weights @ off.ravel())
    freedom = 6 * (len(views) - 1)
    by_hand_eye = known.gain @ known.by_hand_eye
    own = known.gain @ (known.noise + known.by_camera) @ known.gain.T
    return LocatedPart(
        mean.pose(0, each[0].target, each[0].source),
        own,
        by_hand_eye,
        own + by_hand_eye @ hand_eye.covariance @ by_hand_eye.T,
        off,
        chi_square,
        float(chi2.sf(chi_square, freedom)) if freedom else 1.0,
    )


@dataclass(frozen=True, eq=False)
class _Known:
    """What n views know of one pose; all matrices have 6 n rows.

    An error that is the same in all views moves their poses differently and in a known
    way. It is part of the covariance that weighs them, so that views which it moves
    apart do not contradict each other.

    Attributes:
        pictures, robot: (6 n, 6 n) of each view by itself.
        by_camera: (6 n, 6 n) of the intrinsics, the same in all.
        by_hand_eye: (6 n, 6), poses by an error of the hand-eye transform.
        weights: (6 n, 6 n) inverse of all that together.
    """

    pictures: FloatArray
    robot: FloatArray
    by_camera: FloatArray
    by_hand_eye: FloatArray
    weights: FloatArray

    @classmethod
    def of(
        cls,
        views: Sequence[PartView],
        poses: Poses,
        hand_eye: HandEye,
        camera_covariance: FloatArray | None,
    ) -> _Known:
        pictures, robot, levers = _noise(views, poses, hand_eye)
        size = 6 * len(views)
        by_camera = np.zeros((size, size))
        if camera_covariance is not None:
            slopes = _by_camera(views, hand_eye).reshape(size, -1)
            by_camera = slopes @ camera_covariance @ slopes.T
        lever = levers.reshape(size, 6)
        shared = lever @ hand_eye.covariance @ lever.T
        own = block_diag(*pictures), block_diag(*robot)
        weights = np.linalg.inv(own[0] + own[1] + by_camera + shared)
        return cls(*own, by_camera, lever, weights)

    @property
    def noise(self) -> FloatArray:
        """What differs from view to view."""
        return self.pictures + self.robot

    @cached_property
    def gain(self) -> FloatArray:
        """(6, 6 n): the weighted mean of what the views say."""
        all_alike = np.tile(np.eye(6), (len(self.weights) // 6, 1))
        weighted = all_alike.T @ self.weights
        return np.asarray(np.linalg.solve(weighted @ all_alike, weighted))


def _by_camera(views: Sequence[PartView], hand_eye: HandEye) -> FloatArray:
    """(n, 6, c), in base axes."""
    cameras = Poses.of([v.base_from_tool @ hand_eye.tool_from_camera for v in views])
    levers = [v.by_camera for v in views if v.by_camera is not None]
    if len(levers) != len(views):
        raise ValueError("every view needs its by_camera")
    return _turned(cameras.rotation, np.eye(6)) @ np.stack(levers)


def own_shares(
    views: Sequence[PartView], hand_eye: HandEye
) -> tuple[FloatArray, FloatArray]:
    """The two summands (6, 6) of a located part's ``own_covariance``.

    Returns:
        What the pictures and what the poses of the robot contribute, in base axes.

    Raises:
        ValueError: no views.
    """
    poses = Poses.of(
        [
            v.base_from_tool @ hand_eye.tool_from_camera @ v.camera_from_part
            for v in views
        ]
    )
    known = _Known.of(views, poses, hand_eye, None)
    by_picture = known.gain @ known.pictures @ known.gain.T
    by_robot = known.gain @ known.robot @ known.gain.T
    return by_picture, by_robot


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


def _noise(
    views: Sequence[PartView], parts: Poses, hand_eye: HandEye
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Covariances of single views by picture and by robot, and levers of the hand-eye.

    All are (n, 6, 6).
    """
    x = only(hand_eye.tool_from_camera)
    tools = Poses.of([view.base_from_tool for view in views])
    cameras = tools @ x
    picture = _turned(cameras.rotation, np.eye(6))
    robot = _at(parts.translation_mm - tools.translation_mm)
    shift = parts.translation_mm - cameras.translation_mm
    levers = _at(shift) @ _turned(tools.rotation, np.eye(6))
    pictures = np.stack([view.covariance for view in views])
    by_picture = picture @ pictures @ np.swapaxes(picture, 1, 2)
    by_robot = robot @ hand_eye.robot_covariance @ np.swapaxes(robot, 1, 2)
    return by_picture, by_robot, levers


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
