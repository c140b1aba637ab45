"""What a hand-eye calibration found, how good it is, and what speaks against it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.projection import skew

if TYPE_CHECKING:
    from calibration.estimate import Estimate, WeakDirection
    from calibration.hand_eye.motions import Mount
    from calibration.hand_eye.observability import Observability
    from calibration.hand_eye.readings import ReadingCheck
    from calibration.projection import PinholeCamera
    from calibration.verdict import Verdict
    from mvp.geometry import FloatArray, Pose


@dataclass(frozen=True, eq=False)
class HandEyeSolution:
    """A transform that the views determine.

    Attributes:
        moving_from_camera: ``tool_from_camera`` (camera on the hand) or
            ``base_from_camera`` (beside the robot).
        fixed_from_target: ``base_from_target`` or ``tool_from_target``.
        covariance: (6, 6) of ``moving_from_camera``: translation (mm), rotation vector
            (rad), in the axes of the moving frame.
        weakest: the worst determined combination of these six.
        estimate: of the whole fit, slack of every view included.
        camera: intrinsics, refined when a prior was given.
        closed_forms: what each closed form says, for comparison.
        slack: (n, 6), how far the robot was from its word in each view: mm, rad, base
            axes.
        robot_sigmas: (2,), noise of the robot found: position (mm) and angle (rad), one
            sigma on each axis.
        robot_freedom: (2,), how many independent facts stand behind them.
        sigma_px: noise of the found points.
        left_out_mm: (n,), error at the target in each view left out of the fit.
    """

    moving_from_camera: Pose
    fixed_from_target: Pose
    covariance: FloatArray
    weakest: WeakDirection
    estimate: Estimate
    camera: PinholeCamera
    closed_forms: dict[str, Pose]
    slack: FloatArray
    robot_sigmas: FloatArray
    robot_freedom: FloatArray
    sigma_px: float
    left_out_mm: FloatArray

    @property
    def errors_px(self) -> FloatArray:
        """(m, 2), foretold less found, each view with the arm where it was found."""
        return self.estimate.residuals.reshape(-1, 2) * self.sigma_px

    @property
    def rms_px(self) -> float:
        """Root mean square of the distance of a point, as OpenCV reports it."""
        return float(np.sqrt((self.errors_px**2).sum(axis=1).mean()))

    def error_mm(self, stand_off_mm: float) -> float:
        """Expected error (root mean square) of a point on the axis at a distance."""
        lever = self.moving_from_camera.rotate(np.array([0.0, 0.0, stand_off_mm]))
        jacobian = np.hstack([np.eye(3), -skew(lever)])
        return float(np.sqrt(np.trace(jacobian @ self.covariance @ jacobian.T)))

    @property
    def slack_rms(self) -> tuple[float, float]:
        """Inconsistency of the robot: mm and rad, length over all three axes."""
        squares = (self.slack**2).reshape(-1, 2, 3).sum(axis=2).mean(axis=0)
        return float(np.sqrt(squares[0])), float(np.sqrt(squares[1]))


@dataclass(frozen=True, eq=False)
class HandEyeResult:
    """The verdict, and the solution where the data allow one.

    Attributes:
        mount: camera on the hand or beside the robot.
        verdict: with causes and next action.
        solution: None where the views do not determine a transform or contradict
            themselves so that none is to be believed.
        observability: None with fewer than three views.
        readings: the check of directions, orders and units, where it could be made.
    """

    mount: Mount
    verdict: Verdict
    solution: HandEyeSolution | None = None
    observability: Observability | None = None
    readings: ReadingCheck | None = None
