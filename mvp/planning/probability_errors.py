"""From the covariances of a calibrated cell to the errors of a view.

The arm is sent where (20) puts it with what is believed; the camera then stands where
the truth puts it. Seen from the part, to first order, the errors of the part's pose, of
the hand-eye transform and of the arm itself shift and turn the camera together: a part
that lies turned moves a camera half a metre away to the side and turns it so that it
still looks at the part. That is why the nine errors of a view come as one covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import gammaincinv

from mvp.constraints import N_COORDINATES, SHIFT, TURN
from mvp.constraints.base import A, D, F

if TYPE_CHECKING:
    from mvp.constraints import Uncertainty
    from mvp.geometry import FloatArray, Pose
    from mvp.optics import Views

_POSE = slice(0, 6)
_LENS = [F, D, A]


def _none() -> FloatArray:
    return np.zeros((6, 6))


@dataclass(frozen=True, eq=False)
class PoseChain:
    """Believed transforms and what they may be wrong by.

    All covariances are 6 x 6 in the axes of the transform's target: translation (mm),
    then rotation vector (rad).

    Attributes:
        base_from_part: where the part is believed to be.
        tool_from_camera: the hand-eye transform at its reference lens setting.
        part: covariance of ``base_from_part``, all of it.
        hand_eye: of ``tool_from_camera``.
        robot: of ``base_from_tool``: how far the arm is from where it says it is.
        part_by_hand_eye: (6, 6), change of ``base_from_part`` for an error of the
            hand-eye transform, where the part was found through the same one; 0 when
            the two know nothing of each other.
        principal_point_mm: (2,) standard deviations on the sensor, across and down.
        pupil_mm: standard deviation of the entrance pupil along the optical axis.
    """

    base_from_part: Pose
    tool_from_camera: Pose
    part: FloatArray
    hand_eye: FloatArray
    robot: FloatArray
    part_by_hand_eye: FloatArray = field(default_factory=_none)
    principal_point_mm: tuple[float, float] = (0.0, 0.0)
    pupil_mm: float = 0.0

    @property
    def part_alone(self) -> FloatArray:
        """What of the part's covariance does not come from the hand-eye transform."""
        shared = self.part_by_hand_eye @ self.hand_eye @ self.part_by_hand_eye.T
        return np.asarray(self.part - shared)

    def covariance(self, views: Views) -> FloatArray:
        """Of shift (part axes) and turn (camera axes) at every view, (N, 6, 6)."""
        by_part, by_robot, by_hand_eye = self.levers(views)
        shared = by_hand_eye + by_part @ self.part_by_hand_eye
        found = sum(
            lever @ covariance @ np.swapaxes(lever, 1, 2)
            for lever, covariance in (
                (by_part, self.part_alone),
                (by_robot, self.robot),
                (shared, self.hand_eye),
            )
        )
        return np.asarray(found + self._by_lens(views))

    def levers(self, views: Views) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Shift and turn (N, 6, 6) by errors of part, robot and hand-eye.

        With camera c, tool t and part p in base axes: the camera moves by
        v_t + w_t x (c - t) + R_t v_x, the part under it by v_p + w_p x (c - p).
        """
        part, x = self.base_from_part, self.tool_from_camera
        camera = part.rotation @ views.rotation
        tool = camera @ x.rotation.T
        from_part = views.position_mm @ part.rotation.T
        from_tool = tool @ x.translation_mm
        to_part = part.rotation.T
        to_camera = np.swapaxes(camera, 1, 2)
        by_part, by_robot, by_hand_eye = np.zeros((3, len(views), 6, 6))
        by_part[:, :3, :3], by_part[:, :3, 3:] = -to_part, to_part @ _cross(from_part)
        by_part[:, 3:, 3:] = -to_camera
        by_robot[:, :3, :3], by_robot[:, :3, 3:] = to_part, -to_part @ _cross(from_tool)
        by_robot[:, 3:, 3:] = to_camera
        by_hand_eye[:, :3, :3] = to_part @ tool
        by_hand_eye[:, 3:, 3:] = to_camera @ tool
        return by_part, by_robot, by_hand_eye

    def _by_lens(self, views: Views) -> FloatArray:
        """Principal point and pupil offset as the turn and the shift they amount to.

        A principal point that is off turns every ray alike. A pupil offset e changes
        f_cal / z, on which all margins depend, as much as a shift by e along the axis
        does: exactly so at the distance in focus.
        """
        across, down = self.principal_point_mm
        found = np.zeros((len(views), 6, 6))
        found[:, 3, 3] = (down / views.f_cal_mm) ** 2
        found[:, 4, 4] = (across / views.f_cal_mm) ** 2
        axis = views.direction
        found[:, :3, :3] = self.pupil_mm**2 * axis[:, :, None] * axis[:, None]
        return found


@dataclass(frozen=True, eq=False)
class CellErrors:
    """The errors of a view (``ErrorModel``): measured where known, else as stated.

    Attributes:
        stated: independent errors, for what nothing was measured of.
        pose: the calibrated chain; None: shift and turn as stated.
        lens: (3, 3) covariance of f, d and a, mm; None: as stated.
    """

    stated: Uncertainty
    pose: PoseChain | None = None
    lens: FloatArray | None = None

    def covariance(self, views: Views) -> FloatArray:
        """Of the error coordinates at every view, (N, 9, 9)."""
        found = np.zeros((len(views), N_COORDINATES, N_COORDINATES))
        found[:] = np.diag(self.stated.sigma**2)
        if self.pose is not None:
            found[:, _POSE, _POSE] = self.pose.covariance(views)
        if self.lens is not None:
            found[:, np.array(_LENS)[:, None], _LENS] = self.lens
        return found


@dataclass(frozen=True)
class CameraSpread:
    """How far the camera stands from its plan, seen from the part.

    Attributes:
        position_mm: root mean square of the distance.
        angle_rad: root mean square of the turn.
        position_95_mm: exceeded once in twenty, if errors are normal.
        angle_95_rad: likewise.
    """

    position_mm: float
    angle_rad: float
    position_95_mm: float
    angle_95_rad: float


def camera_spread(covariance: FloatArray) -> CameraSpread:
    """Of the covariance (9, 9), or (6, 6), of shift and turn."""
    shift, turn = covariance[SHIFT, SHIFT], covariance[TURN, TURN]
    return CameraSpread(
        float(np.sqrt(np.trace(shift))),
        float(np.sqrt(np.trace(turn))),
        length_95(shift),
        length_95(turn),
    )


def length_95(covariance: FloatArray) -> float:
    """Length that is exceeded once in twenty: a chi-square with the same two moments."""
    mean, spread = np.trace(covariance), 2 * np.trace(covariance @ covariance)
    if mean <= 0:
        return 0.0
    freedom = 2 * mean**2 / spread
    quantile = 2 * gammaincinv(freedom / 2, 0.95)  # of chi-square
    return float(np.sqrt(mean * quantile / freedom))


def _cross(vectors: FloatArray) -> FloatArray:
    """(N, 3, 3) with (v x) as a matrix."""
    out = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = z, -y, x
    return out
