"""Factory-calibrated kinematics of one robot: six turning axes where they really are.

Nominal and calibrated arms differ by millimetres at the flange, so the closed form of
the nominal arm is a good start from which a few Newton steps reach the calibrated one.
The calibrated Denavit-Hartenberg values themselves look nothing like the nominal ones:
axes 2, 3 and 4 are almost parallel, and their common normals lie metres away.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray

AXES = 6
FARTHEST_MM = 40.0  # calibration moves the flange by some mm; more is another arm
_STEPS = 15
_LONGEST_STEP_RAD = 0.1
_LENGTH_MM = 500.0  # what weighs as much as one radian
_DAMPING = 1e-12
_POSITION_MM = 1e-6
_ANGLE_RAD = 1e-9


@dataclass(frozen=True, eq=False)
class UrCalibration:
    """Fixed transforms between turning axes, base to flange.

    Attributes:
        fixed: (7, 4, 4), mm; the flange is at
            ``fixed[0] @ turn(q1) @ fixed[1] @ ... @ turn(q6) @ fixed[6]``, where each
            turn is about z.
    """

    fixed: FloatArray

    @classmethod
    def from_dh(
        cls,
        *,
        theta_rad: FloatArray,
        a_mm: FloatArray,
        d_mm: FloatArray,
        alpha_rad: FloatArray,
    ) -> UrCalibration:
        """From the standard convention: turn z, along z, along x, turn x; six each."""
        fixed = np.tile(np.eye(4), (AXES + 1, 1, 1))
        for k in range(AXES):
            fixed[k] = fixed[k] @ _turn_z(theta_rad[k])
            fixed[k + 1] = _along_then_tilt(a_mm[k], d_mm[k], alpha_rad[k])
        return cls(fixed)

    @classmethod
    def from_links(cls, xyz_mm: FloatArray, rpy_rad: FloatArray) -> UrCalibration:
        """From six placements (6, 3) of the joints, each in the frame before it.

        Args:
            xyz_mm: origin of each joint.
            rpy_rad: roll, pitch, yaw about the fixed axes of the frame before it.
        """
        fixed = np.tile(np.eye(4), (AXES + 1, 1, 1))
        for k in range(AXES):
            roll, pitch, yaw = rpy_rad[k]
            fixed[k, :3, :3] = (
                _turn_z(yaw)[:3, :3] @ _turn_y(pitch) @ _turn_x(roll)[:3, :3]
            )
            fixed[k, :3, 3] = xyz_mm[k]
        return cls(fixed)

    def forward(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotations (M, 3, 3) and flange points (M, 3), mm, of joints (M, 6)."""
        matrix, _ = self._chain(joints)
        return matrix[:, :3, :3], matrix[:, :3, 3]

    def refine(
        self, joints: FloatArray, rotation: FloatArray, point_mm: FloatArray
    ) -> FloatArray:
        """Joints (M, 6) that take this robot to M poses, from nearby starts.

        Damped Gauss-Newton steps; nan where they do not arrive, as near a singular
        configuration that the calibrated arm just cannot take.
        """
        q = np.array(joints, dtype=np.float64)
        left = np.arange(len(q))
        for _ in range(_STEPS):
            error, jacobian = self._residual(q[left], rotation[left], point_mm[left])
            far = ~_arrived(error)
            left, error, jacobian = left[far], error[far], jacobian[far]
            if not len(left):
                return q
            q[left] += _step(error, jacobian)
        error, _ = self._residual(q[left], rotation[left], point_mm[left])
        q[left[~_arrived(error)]] = np.nan
        return q

    def _residual(
        self, q: FloatArray, rotation: FloatArray, point_mm: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """What is missing (M, 6), lengths over ``_LENGTH_MM``, and its Jacobian."""
        matrix, axes = self._chain(q)
        missing = rotation @ matrix[:, :3, :3].transpose(0, 2, 1)
        # Small by construction: the antisymmetric part is the rotation vector.
        turn = 0.5 * np.stack(
            [
                missing[:, 2, 1] - missing[:, 1, 2],
                missing[:, 0, 2] - missing[:, 2, 0],
                missing[:, 1, 0] - missing[:, 0, 1],
            ],
            axis=1,
        )
        flange = matrix[:, :3, 3]
        z, origin = axes[..., :3, 2], axes[..., :3, 3]
        lever = np.cross(z, flange[:, None] - origin)
        jacobian = np.concatenate([lever / _LENGTH_MM, z], axis=2).transpose(0, 2, 1)
        error = np.concatenate([(point_mm - flange) / _LENGTH_MM, turn], axis=1)
        return error, jacobian

    def _chain(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The flange (M, 4, 4) and the frames of the axes (M, 6, 4, 4)."""
        q = np.atleast_2d(np.asarray(joints, dtype=np.float64))
        turns = np.tile(np.eye(4), (len(q), AXES, 1, 1))
        cosine, sine = np.cos(q), np.sin(q)
        turns[..., 0, 0] = turns[..., 1, 1] = cosine
        turns[..., 0, 1], turns[..., 1, 0] = -sine, sine
        matrix = np.tile(self.fixed[0], (len(q), 1, 1))
        axes = np.empty((len(q), AXES, 4, 4))
        for k in range(AXES):
            axes[:, k] = matrix
            matrix = matrix @ turns[:, k] @ self.fixed[k + 1]
        return matrix, axes


def _step(error: FloatArray, jacobian: FloatArray) -> FloatArray:
    """Damped Gauss-Newton steps (M, 6), none longer than is still linear."""
    across = jacobian.transpose(0, 2, 1)
    normal = across @ jacobian + _DAMPING * np.eye(AXES)
    step = np.linalg.solve(normal, across @ error[..., None])[..., 0]
    longest = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(
        step * np.minimum(1, _LONGEST_STEP_RAD / np.maximum(longest, 1e-300))
    )


def _arrived(error: FloatArray) -> BoolArray:
    """Which rows (M,) of a residual are as good as zero."""
    position_mm = np.linalg.norm(error[:, :3], axis=1) * _LENGTH_MM
    return np.asarray(
        (position_mm < _POSITION_MM)
        & (np.linalg.norm(error[:, 3:], axis=1) < _ANGLE_RAD)
    )


def _turn_z(angle_rad: float) -> FloatArray:
    matrix = np.eye(4)
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    matrix[:2, :2] = [[c, -s], [s, c]]
    return matrix


def _turn_x(angle_rad: float) -> FloatArray:
    matrix = np.eye(4)
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    matrix[1:3, 1:3] = [[c, -s], [s, c]]
    return matrix


def _turn_y(angle_rad: float) -> FloatArray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _along_then_tilt(a_mm: float, d_mm: float, alpha_rad: float) -> FloatArray:
    matrix = _turn_x(alpha_rad)
    matrix[:3, 3] = [a_mm, 0, d_mm]
    return matrix
